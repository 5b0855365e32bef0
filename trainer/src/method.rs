//! What a method of training decides: the paper's voxel network, or a judge.

use std::fmt::Debug;
use std::sync::Arc;

use schema::{AttemptRecord, Grid};

use crate::batch::{Batch, Sample, Scene};
use crate::data::Shard;
use crate::judge::scores::JudgeScores;
use crate::results::{Found, SampleResult, StepResult};
use crate::split::LabelCount;

/// What decides how training samples are changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Epoch {
    /// The run's seed.
    pub seed: u64,
    /// The epoch, from 0.
    pub number: u32,
    /// Labels of all training samples.
    pub train: LabelCount,
}

/// A sample of a method and its result.
pub type FoundBy<M> = Found<<M as Method>::Data>;

/// A method, with what it needs besides the weights.
pub trait Method: Debug + Send + Sync {
    /// What a sample has besides its grid.
    type Data: Copy + Debug + Send + Sync + 'static;

    /// The samples of a scene of a shard, seen from `views` (in a survey none), by attempt; and how many have none.
    fn samples(&self, shard: &Shard<'_>, attempts: &[AttemptRecord], views: usize) -> (Vec<Sample<Self::Data>>, u64);

    /// How a sample's attempt ended, as its mark before the split.
    fn mark(data: &Self::Data) -> u8;

    /// Whether it can learn from grids of this kind.
    fn takes(grid: &Grid) -> bool;

    /// Changes training samples of a scene for an epoch, and gives the grid that goes with them.
    fn change(&self, epoch: &Epoch, scene: &Scene<Self::Data>, own: &mut [Sample<Self::Data>]) -> Arc<[f32]>;

    /// Loss and gradient of a batch.
    fn step(&self, vector: &[f32], batch: &Batch<Self::Data>) -> StepResult;

    /// Losses and predictions of a batch, without a gradient.
    fn evaluate(&self, vector: &[f32], batch: &Batch<Self::Data>) -> Vec<SampleResult>;

    /// A judge's scores.
    fn own_scores(_: &[FoundBy<Self>]) -> Option<JudgeScores>
    where
        Self: Sized,
    {
        None
    }
}
