//! The judge decides: hands are proposed on what was seen, and the network says how each attempt would end.

use network::Architecture;
use network::checkpoint::Checkpoint;
use network::judge::{Crop, JudgeInputs, JudgeNetwork, OUTCOMES, PaddedGrid, probabilities};
use program::{ExitCode, Failure};
use rayon::prelude::*;
use schema::{Grasp, Grid, Gripper, Outcome, Stream, VoxelGrid};

use crate::Proposer;

/// Hands that one thread judges together.
const TOGETHER: usize = 32;

/// A judge, prepared for a hand on a grid.
#[derive(Debug, Clone)]
pub struct Judge {
    network: JudgeNetwork,
    crop: Crop,
    proposer: Proposer,
}

/// A hand and how its attempt would end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judged {
    /// The hand.
    pub hand: Grasp,
    /// Probabilities in the order of [`Outcome::ALL`].
    pub outcomes: [f32; OUTCOMES],
}

impl Judged {
    /// The probability that it holds.
    #[must_use]
    pub fn quality(&self) -> f32 {
        self.outcomes[Outcome::Held as usize]
    }

    /// The likeliest outcome and its probability.
    #[must_use]
    pub fn likeliest(&self) -> (Outcome, f32) {
        let outcomes = Outcome::ALL.into_iter().zip(self.outcomes);
        outcomes.fold((Outcome::Held, self.quality()), |best, one| if one.1 > best.1 { one } else { best })
    }

    /// Whether its tips are nearer than this to those of another hand.
    #[must_use]
    pub fn is_near(&self, other: &Self, apart_m: f32) -> bool {
        let [here_m, there_m] = [self, other].map(|judged| judged.hand.workspace_from_grasp.translation);
        (here_m - there_m).length() < apart_m
    }
}

impl Judge {
    /// Prepares the judge of a checkpoint.
    ///
    /// # Errors
    /// If these are another network's weights, or the judge was trained for another hand or another grid.
    pub fn new(checkpoint: &Checkpoint, gripper: &Gripper, grid: &Grid) -> Result<Self, Failure> {
        let Architecture::Judge(scope) = &checkpoint.architecture else {
            let why = "these weights are the paper's network's, which answers for voxels, not a judge's";
            return Err(Failure::new(ExitCode::Config, why));
        };
        scope.must_match(gripper, grid)?;
        let proposer = Proposer::new(gripper, scope.pregrasp_distance_m);
        Ok(Self { network: JudgeNetwork::new(&checkpoint.vector), crop: Crop::new(scope), proposer })
    }

    /// Proposes hands in a scene that is seen from `views`, and judges them, best first.
    #[must_use]
    pub fn hands(&self, field: &VoxelGrid, views: usize, proposals: usize, stream: &mut Stream) -> Vec<Judged> {
        let hands = self.proposer.propose(field, proposals, stream);
        let grid = PaddedGrid::from(field);
        let parts: Vec<Vec<Judged>> = hands.par_chunks(TOGETHER).map(|hands| self.judge(&grid, views, hands)).collect();
        let mut judged = parts.concat();
        judged.sort_by(|a, b| b.quality().total_cmp(&a.quality()));
        judged
    }

    fn judge(&self, grid: &PaddedGrid, views: usize, hands: &[Grasp]) -> Vec<Judged> {
        let mut inputs = JudgeInputs::with_capacity(hands.len());
        for Grasp { workspace_from_grasp, .. } in hands {
            inputs.push(&self.crop, grid, workspace_from_grasp, views, [false; 2]);
        }
        let seen = self.network.forward(&inputs);
        let judged = hands.iter().zip(seen.logits());
        judged.map(|(hand, logits)| Judged { hand: *hand, outcomes: probabilities(&logits) }).collect()
    }
}
