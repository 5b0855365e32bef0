//! The paper's voxel network in training: a sample is a voxel, the one that holds the grasp's origin.

pub mod augmentation;
pub mod closing_loss;
mod errors;
#[cfg(feature = "graph")]
pub mod graph;
pub mod loss;
mod parts;
pub mod step;

use std::sync::Arc;

use network::head::Head;
use network::receptive_field::RESOLUTION;
use network::{GraspOrigin, VoxelParams};
use schema::{AttemptRecord, Axis, Grid, ObjectRecord, Pose, ShapeKind, Vec3};
use shards::DatasetInfo;

use crate::batch::{Batch, Scene};
use crate::config::VoxelConfig;
use crate::data::split_bits::{FAILED, HELD};
use crate::data::{Rows, Shard};
use crate::device::Device;
use crate::judge::scores::HandScores;
use crate::method::{Epoch, Method};
use crate::results;
use crate::scores::GraspErrors;
use augmentation::Augmentation;
use errors::errors;
use loss::{ClassWeights, Target};

type Sample = crate::batch::Sample<VoxelSample>;
/// The predicted orientation as a unit quaternion xyzw.
pub type Answer = [f32; 4];
/// A voxel's losses and prediction.
pub type SampleResult = results::SampleResult<Answer>;
type StepResult = results::StepResult<Answer>;
type Found = results::Found<VoxelSample, Answer>;

/// A supervised voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelSample {
    /// The voxel that holds the grasp's origin: x, y, z, below 40.
    pub voxel: [usize; 3],
    /// The result of the attempt there.
    pub target: Target,
    /// By which turns of its orientation the hand grips the object as well.
    pub closings: Closings,
}

/// By which turns about its approach a hand grips the same object as well.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Closings {
    /// By half a turn, which only exchanges the fingers.
    Half,
    /// By a quarter turn: a box that fits between the fingers across either pair of its sides.
    Quarter,
    /// By any: a cylinder that is approached along its axis.
    Any,
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
    type Answer = Answer;

    fn takes(grid: &Grid) -> bool {
        grid.resolution == RESOLUTION
    }

    /// Those whose grasp is inside the grid, one per attempt. The yaws at a point of VGN's sampler are one
    /// sample, if the head answers with one orientation.
    fn samples(&self, shard: &Shard<'_>, rows: Rows<'_>) -> (Vec<Sample>, u64) {
        let all = match self.params.head {
            Head::Quaternion => schema::samples_of(rows.attempts),
            Head::Closings => rows.attempts.to_vec(),
        };
        let inside = all.iter().filter_map(|attempt| at_voxel(shard, attempt, rows.objects, self.params.origin));
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
        for VoxelSample { voxel, target, .. } in own.iter_mut().map(|sample| &mut sample.data) {
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

    fn own_scores(found: &[Found], voxel_size_m: f32) -> ([GraspErrors; 2], Option<HandScores>) {
        // Those with more than the paper's ε = 0.9.
        let sure = found.iter().filter(|(_, result)| result.quality_logit > libm::logf(9.0));
        ([errors(found.iter(), voxel_size_m), errors(sure, voxel_size_m)], None)
    }
}

/// The sample of an attempt, or `None` if its grasp's origin is outside the grid.
fn at_voxel(
    shard: &Shard<'_>,
    attempt: &AttemptRecord,
    objects: &[ObjectRecord],
    origin: GraspOrigin,
) -> Option<Sample> {
    let DatasetInfo { grid, gripper, .. } = shard.dataset.info();
    let (pose, label) = (&attempt.workspace_from_grasp, attempt.label());
    let voxel = origin.voxel_of(pose, grid)?;
    // Only a held object's width is a target.
    let width_m = attempt.width_m.filter(|_| label == 1).unwrap_or(0.0);
    let (rotation, width_voxels) = (pose.rotation, width_m / grid.voxel_size_m());
    let tips_voxels = ((pose.translation - grid.centre_m(voxel)) / grid.voxel_size_m()).to_array();
    let target = Target { label, rotation, width_voxels, tips_voxels, quality_weight: 1.0 };
    // A damaged table may name an object that its scene does not have.
    let object = objects.get(attempt.object_id as usize).filter(|_| label == 1);
    let closings = object.map_or(Closings::Half, |object| closings(pose, object, gripper.opening_m_max));
    Some(Sample { id: shard.id(attempt), grid: 0, data: VoxelSample { voxel, target, closings } })
}

/// By which turns a hand holds its object as well: those about an axis of the object along which it approaches.
fn closings(workspace_from_grasp: &Pose, object: &ObjectRecord, opening_m_max: f32) -> Closings {
    let Some(solid) = object.shape.as_solid() else { return Closings::Half };
    let object_from_workspace = object.workspace_from_object.rotation.inverse();
    let along = |grasp_axis: Vec3| {
        let axis = object_from_workspace * (workspace_from_grasp.rotation * grasp_axis);
        Axis::ALL.into_iter().find(|own| own.of(axis).abs() > NEAR_COS)
    };
    let Some(approach) = along(Vec3::Z) else { return Closings::Half };
    let fits = |axis: Axis| axis.of(solid.extents_m) <= opening_m_max - FINGER_ROOM_M;
    let across = || Axis::ALL.into_iter().filter(|axis| *axis != approach).all(fits);
    match solid.kind {
        ShapeKind::Cylinder if approach == Axis::Z => Closings::Any,
        ShapeKind::Cuboid if along(Vec3::Y).is_some() && across() => Closings::Quarter,
        _ => Closings::Half,
    }
}

/// Cosine of the largest angle between an axis of the hand and the object's: 30°, three deviations of the paper's
/// tilts.
const NEAR_COS: f32 = 0.866;
/// How much wider than an object the fingers must open to go about it with a few degrees of tilt.
const FINGER_ROOM_M: f32 = 0.01;

#[cfg(test)]
mod tests {
    use schema::{Quat, Rule, Solid, axis_angle, pose_from_parts};

    use super::*;
    use crate::batch::SampleId;

    pub(super) fn sample(grid: usize, voxel: [usize; 3], target: Target) -> Sample {
        let id = SampleId { scene: 0, attempt: 0, rule: Rule::of_the_paper()[0] };
        Sample { id, grid, data: VoxelSample { voxel, target, closings: Closings::Half } }
    }

    /// A box of 40 × 60 × 90 mm and cylinders, gripped along each axis with a few degrees of tilt.
    #[test]
    fn what_fits_between_the_fingers_may_be_gripped_by_more_turns() {
        let closings_of = |kind: ShapeKind, extents_m: [f32; 3], rotation: Quat| {
            let workspace_from_object = pose_from_parts(axis_angle(Vec3::X, 0.4), Vec3::splat(0.1));
            let object = ObjectRecord {
                scene_id: 0,
                object_id: 0,
                shape: Solid::new(kind, Vec3::from_array(extents_m)).unwrap().into(),
                mass_kg: 0.1,
                friction: 1.0,
                workspace_from_object,
            };
            let tilted = rotation * axis_angle(Vec3::Y, 0.2);
            closings(&(workspace_from_object * pose_from_parts(tilted, Vec3::ZERO)), &object, 0.08)
        };
        let (along_z, along_x) = (Quat::IDENTITY, axis_angle(Vec3::Y, core::f32::consts::FRAC_PI_2));
        let cuboid = |extents_m, rotation| closings_of(ShapeKind::Cuboid, extents_m, rotation);
        assert_eq!(cuboid([0.04, 0.06, 0.09], along_z), Closings::Quarter);
        assert_eq!(cuboid([0.04, 0.06, 0.09], along_x), Closings::Half, "90 mm are too broad");
        assert_eq!(cuboid([0.04, 0.075, 0.09], along_z), Closings::Half, "75 mm leave no room");
        assert_eq!(cuboid([0.04, 0.06, 0.09], axis_angle(Vec3::Z, 0.7)), Closings::Half, "over a corner");
        assert_eq!(cuboid([0.04, 0.06, 0.09], axis_angle(Vec3::X, 0.8)), Closings::Half, "over an edge");
        let cylinder = |rotation| closings_of(ShapeKind::Cylinder, [0.04, 0.04, 0.06], rotation);
        assert_eq!([cylinder(along_z), cylinder(along_x)], [Closings::Any, Closings::Half]);
        assert_eq!(closings_of(ShapeKind::TriPrism, [0.04, 0.06, 0.05], along_z), Closings::Half);
    }
}
