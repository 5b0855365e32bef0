//! The judge in training: a sample is a grasp, wherever its origin is.

mod sample;
pub mod scores;
pub mod step;

pub use sample::JudgeSample;

use std::sync::Arc;

use network::judge::{Crop, Scope};
use schema::{AttemptRecord, Grid, Gripper, Purpose, Stream};

use crate::batch::{Batch, Scene};
use crate::data::Shard;
use crate::data::split_bits::{FAILED, HELD, HITS_TABLE};
use crate::method::{Epoch, Method};
use crate::results::{SampleResult, StepResult};
use sample::{Found, Sample};
use scores::{JudgeScores, judge_scores};

/// A judge of some grippers: those of the first dataset, then those of the next.
#[derive(Debug, Clone)]
pub struct Judge {
    /// How it sees each gripper.
    pub crops: Vec<Crop>,
}

impl Judge {
    /// The judge of a checkpoint, for these grippers.
    #[must_use]
    pub fn new<'a>(scope: &Scope, grippers: impl Iterator<Item = &'a Gripper>) -> Self {
        Self { crops: grippers.map(|gripper| Crop::new(gripper, scope.pregrasp_distance_m, &scope.grid)).collect() }
    }
}

impl Method for Judge {
    type Data = JudgeSample;

    fn takes(_: &Grid) -> bool {
        true
    }

    fn samples(&self, shard: &Shard<'_>, attempts: &[AttemptRecord], views: usize) -> (Vec<Sample>, u64) {
        let count = shard.dataset.info().grippers().len() as u64;
        let sample = |attempt: &AttemptRecord| {
            let AttemptRecord { scene_id, workspace_from_grasp, outcome, robustness, .. } = *attempt;
            let crop = shard.first_gripper + (scene_id % count) as usize;
            let data = JudgeSample {
                crop: crop as u32, // datasets have far fewer grippers
                workspace_from_grasp,
                views: views as u8,
                mirrored: [false; 2],
                outcome,
                robustness,
                hits_table: self.crops[crop].hits_table(&workspace_from_grasp),
            };
            Sample { id: shard.id(attempt), grid: 0, data }
        };
        (attempts.iter().map(sample).collect(), 0)
    }

    fn mark(data: &JudgeSample) -> u8 {
        let by_label = if data.outcome.label() == 1 { HELD } else { FAILED };
        if data.hits_table { HITS_TABLE } else { by_label }
    }

    /// Mirrors half of them in each direction.
    fn change(&self, epoch: &Epoch, scene: &Scene<JudgeSample>, own: &mut [Sample]) -> Arc<[f32]> {
        for sample in own {
            let number = scene.first_attempt + u64::from(sample.id.attempt);
            let mut draw = Stream::new(epoch.seed, number, Purpose::Mirror, epoch.number);
            sample.data.mirrored = [(); 2].map(|()| draw.unit() < 0.5);
        }
        scene.grid.clone()
    }

    fn step(&self, vector: &[f32], batch: &Batch<JudgeSample>) -> StepResult {
        step::step(vector, batch, &self.crops)
    }

    fn evaluate(&self, vector: &[f32], batch: &Batch<JudgeSample>) -> Vec<SampleResult> {
        step::evaluate(vector, batch, &self.crops)
    }

    fn own_scores(found: &[Found]) -> Option<JudgeScores> {
        Some(judge_scores(found))
    }
}
