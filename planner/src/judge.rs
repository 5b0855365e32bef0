//! The judge decides: hands are proposed on what was seen, and the network says how each attempt would end.

use hands::Proposer;
use network::judge::{Crop, JudgeInputs, JudgeNetwork, OUTCOMES, PaddedGrid, Scope, probabilities};
use program::Failure;
use rayon::prelude::*;
use schema::{Grasp, Grid, Gripper, Outcome, Purpose, Stream, VoxelGrid};

use crate::config::JudgeParams;

/// Hands that one thread judges together.
const TOGETHER: usize = 32;

/// A judge, prepared for planning.
#[derive(Debug, Clone)]
pub(crate) struct Judge {
    network: JudgeNetwork,
    crop: Crop,
    proposer: Proposer,
}

/// A hand and how its attempt would end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Judged {
    pub hand: Grasp,
    /// Probabilities in the order of [`Outcome::ALL`].
    pub outcomes: [f32; OUTCOMES],
}

impl Judged {
    /// The probability that it holds.
    pub(crate) fn quality(&self) -> f32 {
        self.outcomes[Outcome::Held as usize]
    }

    /// The likeliest outcome and its probability.
    pub(crate) fn likeliest(&self) -> (Outcome, f32) {
        let outcomes = Outcome::ALL.into_iter().zip(self.outcomes);
        outcomes.fold((Outcome::Held, self.quality()), |best, one| if one.1 > best.1 { one } else { best })
    }
}

impl Judge {
    /// Prepares a judge for a hand on a grid.
    ///
    /// # Errors
    /// If it was trained for another hand or another grid.
    pub(crate) fn new(vector: &[f32], scope: &Scope, gripper: &Gripper, grid: &Grid) -> Result<Self, Failure> {
        scope.must_match(gripper, grid)?;
        let proposer = Proposer::new(gripper, scope.pregrasp_distance_m);
        Ok(Self { network: JudgeNetwork::new(vector), crop: Crop::new(scope), proposer })
    }

    /// Proposes hands in a scene and judges them, best first. `scene` names the stream of the proposals.
    pub(crate) fn hands(
        &self,
        field: &VoxelGrid,
        views: usize,
        params: &JudgeParams,
        [seed, scene]: [u64; 2],
    ) -> Vec<Judged> {
        let mut stream = Stream::new(seed, scene, Purpose::Proposals, 0);
        let hands = self.proposer.propose(field, params.proposals, &mut stream);
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
