//! The paper's voxel network in training: a sample is a voxel, the one that holds the grasp's origin.

pub mod augmentation;
pub mod closing_loss;
#[cfg(feature = "graph")]
pub mod graph;
pub mod loss;
mod parts;
pub mod step;

use std::sync::Arc;

use network::head::Head;
use network::receptive_field::RESOLUTION;
use network::{GraspOrigin, VoxelParams};
use schema::{AttemptRecord, Grid};

use crate::batch::{Batch, Scene};
use crate::config::VoxelConfig;
use crate::data::Shard;
use crate::data::split_bits::{FAILED, HELD};
use crate::device::Device;
use crate::method::{Epoch, Method};
use crate::results::{SampleResult, StepResult};
use augmentation::Augmentation;
use loss::{ClassWeights, Target};

type Sample = crate::batch::Sample<VoxelSample>;

/// A supervised voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelSample {
    /// The voxel that holds the grasp's origin: x, y, z, below 40.
    pub voxel: [usize; 3],
    /// The result of the attempt there.
    pub target: Target,
}

/// The voxel network, its device, and how samples are made for it. What changes samples is only applied in training.
#[derive(Debug, Clone)]
pub struct Voxel {
    /// Where the network has a grasp's origin, and how it doubles grids.
    pub params: VoxelParams,
    /// What computes.
    pub device: Device,
    /// Rotations and shifts of scenes.
    pub augmentation: Augmentation,
    /// How much more a success counts than a failure.
    pub positive_weight: f64,
}

impl Voxel {
    /// Without changes to samples.
    #[must_use]
    pub const fn new(params: VoxelParams, device: Device) -> Self {
        Self { params, device, augmentation: Augmentation::OFF, positive_weight: 1.0 }
    }

    /// As a recipe trains it.
    #[must_use]
    pub fn in_training(config: &VoxelConfig, device: Device) -> Self {
        let VoxelConfig { network, training, augmentation } = *config;
        let positive_weight = training.positive_weight;
        Self { augmentation, positive_weight, ..Self::new(network.params(), device) }
    }
}

impl Method for Voxel {
    type Data = VoxelSample;

    fn takes(grid: &Grid) -> bool {
        grid.resolution == RESOLUTION
    }

    /// Those whose grasp is inside the grid, one per attempt. The yaws at a point of VGN's sampler are one
    /// sample, if the head answers with one orientation.
    fn samples(&self, shard: &Shard<'_>, attempts: &[AttemptRecord], _: usize) -> (Vec<Sample>, u64) {
        let all = match self.params.head {
            Head::Quaternion => schema::samples_of(attempts),
            Head::Closings => attempts.to_vec(),
        };
        let inside = all.iter().filter_map(|attempt| at_voxel(shard, attempt, self.params.origin));
        let samples: Vec<Sample> = inside.collect();
        let outside = (all.len() - samples.len()) as u64;
        (samples, outside)
    }

    fn mark(data: &VoxelSample) -> u8 {
        if data.target.label == 1 { HELD } else { FAILED }
    }

    fn change(&self, epoch: &Epoch, scene: &Scene<VoxelSample>, own: &mut [Sample]) -> Arc<[f32]> {
        let weights = ClassWeights::new(self.positive_weight, epoch.train.held, epoch.train.samples);
        let heights = || scene.samples.iter().map(|sample| sample.data.voxel[2]);
        let heights = heights().min().unwrap_or_default()..=heights().max().unwrap_or_default();
        let motion = self.augmentation.draw(epoch.seed, epoch.number, scene.number.into(), heights);
        for VoxelSample { voxel, target } in own.iter_mut().map(|sample| &mut sample.data) {
            target.quality_weight = weights.of(target.label);
            target.rotation = motion.rotation(target.rotation);
            target.tips_voxels = motion.offset(target.tips_voxels);
            *voxel = motion.voxel(*voxel);
        }
        motion.grid(&scene.grid)
    }

    fn step(&self, vector: &[f32], batch: &Batch<VoxelSample>) -> StepResult {
        step::step(vector, batch, &self.params, &self.device)
    }

    fn evaluate(&self, vector: &[f32], batch: &Batch<VoxelSample>) -> Vec<SampleResult> {
        step::evaluate(vector, batch, &self.params, &self.device)
    }
}

/// The sample of an attempt, or `None` if its grasp's origin is outside the grid.
fn at_voxel(shard: &Shard<'_>, attempt: &AttemptRecord, origin: GraspOrigin) -> Option<Sample> {
    let grid = &shard.dataset.info().grid;
    let (pose, label) = (&attempt.workspace_from_grasp, attempt.label());
    let voxel = origin.voxel_of(pose, grid)?;
    // Only a held object's width is a target.
    let width_m = attempt.width_m.filter(|_| label == 1).unwrap_or(0.0);
    let (rotation, width_voxels) = (pose.rotation, width_m / grid.voxel_size_m());
    let tips_voxels = ((pose.translation - grid.centre_m(voxel)) / grid.voxel_size_m()).to_array();
    let target = Target { label, rotation, width_voxels, tips_voxels, quality_weight: 1.0 };
    Some(Sample { id: shard.id(attempt), grid: 0, data: VoxelSample { voxel, target } })
}

#[cfg(test)]
mod tests {
    use schema::Rule;

    use super::*;
    use crate::batch::SampleId;

    pub(super) fn sample(grid: usize, voxel: [usize; 3], target: Target) -> Sample {
        let id = SampleId { scene: 0, attempt: 0, rule: Rule::of_the_paper()[0] };
        Sample { id, grid, data: VoxelSample { voxel, target } }
    }
}
