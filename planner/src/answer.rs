//! A plan as JSON: the output of `planner plan` and `planner serve`.

use schema::{Grid, Pose};
use serde::Serialize;
use utoipa::ToSchema;

use crate::Planner;
use crate::plan::{DroppedCandidate, Funnel, Plan, RankedGrasp, RejectReason};

/// Version of the answer's layout.
pub const FORMAT: &str = "graspmill-plan/1";

/// A plan.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Answer {
    /// Layout of this document: `graspmill-plan/1`.
    pub format: &'static str,
    /// SHA-256 of the network's weights file.
    pub model: String,
    /// The order of the grasps: `paper`, `vgn-random`, `vgn-best` or `flattest`.
    pub policy: &'static str,
    /// Name of the hand.
    pub gripper: String,
    /// The workspace.
    pub grid: GridAnswer,
    /// The grasps, best first.
    pub grasps: Vec<GraspAnswer>,
    /// Why there are no grasps; null if there are.
    pub reason: Option<String>,
    /// Warnings for the caller.
    pub warnings: Vec<String>,
    /// The objects, from the top.
    pub objects: Vec<ObjectAnswer>,
    /// The plane under the objects; null if none was found.
    pub plane: Option<PlaneAnswer>,
    /// The number of candidates left after each stage.
    pub funnel: Funnel,
    /// Dropped candidates with reasons, best first; empty unless requested.
    pub dropped: Vec<DroppedAnswer>,
}

/// The workspace: a cube, its origin at a lower corner, z up.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct GridAnswer {
    /// Its side, in metres.
    pub size_m: f32,
    /// Voxels along a side.
    pub resolution: usize,
    /// Height of the table's top in the training data, in metres.
    pub table_z_m: f32,
}

impl GridAnswer {
    pub(crate) fn new(grid: &Grid) -> Self {
        Self { size_m: grid.size_m, resolution: grid.resolution, table_z_m: grid.table_z_m }
    }
}

/// A rigid transform `target_from_source`.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct PoseAnswer {
    /// Metres.
    pub position_m: [f32; 3],
    /// Unit quaternion x, y, z, w.
    pub quaternion_xyzw: [f32; 4],
}

/// A grasp: +z approach, +y closing, origin midway between the finger tips' ends.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct GraspAnswer {
    /// 1 is the best.
    pub rank: usize,
    /// The grasp in the workspace.
    pub workspace_from_grasp: PoseAnswer,
    /// The grasp in the robot's base frame; null if `base_from_workspace` was not given.
    pub base_from_grasp: Option<PoseAnswer>,
    /// Distance between the fingers' inner faces when holding, in metres.
    pub width_m: f32,
    /// Grasp quality, smoothed, between 0 and 1.
    pub quality: f32,
    /// Index into `objects`; null without an object.
    pub object: Option<usize>,
    /// Eq. 8's ρ in metres: weighted distance to the object's centroid over quality; null without an object.
    pub rho_m: Option<f32>,
    /// Support of the hand: the smaller number of cloud points under a finger, reduced with the distance from the
    /// middle; null without refinement.
    pub support: Option<f32>,
    /// The voxel of the detection: x, y, z.
    pub voxel: [usize; 3],
}

/// A cluster of the surface cloud.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct ObjectAnswer {
    /// Mean of its points in the workspace, in metres.
    pub centroid_m: [f32; 3],
    /// Number of its points.
    pub point_count: usize,
}

/// A plane: normal · x = offset, in the workspace.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct PlaneAnswer {
    /// Unit normal, upwards.
    pub normal: [f32; 3],
    /// Metres.
    pub offset_m: f32,
    /// Points of the cloud within the threshold.
    pub inlier_count: usize,
}

/// A candidate that was dropped.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct DroppedAnswer {
    /// `far_from_surface`, `width`, `quality`, `suppressed`, `collision`, `no_hand`, `no_object` or `beyond_limit`.
    pub why: &'static str,
    /// The reason as text, with the numbers.
    pub told: String,
    /// Its pose in the workspace.
    pub workspace_from_grasp: PoseAnswer,
    /// Predicted width in metres.
    pub width_m: f32,
    /// Smoothed quality before any mask.
    pub quality: f32,
    /// The voxel of the detection: x, y, z.
    pub voxel: [usize; 3],
}

impl Answer {
    /// The answer for a plan.
    #[must_use]
    pub fn new(plan: &Plan, planner: &Planner) -> Self {
        let plane = plan.cloud.plane.as_ref().map(|found| PlaneAnswer {
            normal: found.plane.normal.to_array(),
            offset_m: found.plane.offset_m,
            inlier_count: found.inliers.len(),
        });
        Self {
            format: FORMAT,
            model: planner.model_id.clone(),
            policy: plan.policy.name(),
            gripper: planner.config.gripper.name.clone(),
            grid: GridAnswer::new(&plan.grid),
            grasps: plan.grasps.iter().enumerate().map(|(at, grasp)| grasp_answer(at + 1, grasp)).collect(),
            reason: plan.reason.clone(),
            warnings: plan.warnings.clone(),
            objects: plan
                .objects
                .iter()
                .map(|o| ObjectAnswer { centroid_m: o.centroid_m.to_array(), point_count: o.point_count })
                .collect(),
            plane,
            funnel: plan.funnel,
            dropped: plan.dropped.iter().map(dropped_answer).collect(),
        }
    }
}

impl PoseAnswer {
    fn new(pose: &Pose) -> Self {
        Self { position_m: pose.translation.to_array(), quaternion_xyzw: pose.rotation.to_array() }
    }
}

fn grasp_answer(rank: usize, grasp: &RankedGrasp) -> GraspAnswer {
    GraspAnswer {
        rank,
        workspace_from_grasp: PoseAnswer::new(&grasp.grasp.workspace_from_grasp),
        base_from_grasp: grasp.base_from_grasp.as_ref().map(PoseAnswer::new),
        width_m: grasp.grasp.width_m,
        quality: grasp.quality,
        object: grasp.object,
        rho_m: grasp.rho_m,
        support: grasp.support,
        voxel: grasp.voxel,
    }
}

fn dropped_answer(dropped: &DroppedCandidate) -> DroppedAnswer {
    let (why, told) = dropped.reason.word_and_text();
    DroppedAnswer {
        why,
        told,
        workspace_from_grasp: PoseAnswer::new(&dropped.grasp.workspace_from_grasp),
        width_m: dropped.grasp.width_m,
        quality: dropped.quality,
        voxel: dropped.voxel,
    }
}

impl RejectReason {
    /// The reason as one word, for programs, and as text.
    fn word_and_text(self) -> (&'static str, String) {
        let (word, text) = match self {
            Self::FarFromSurface => ("far_from_surface", "far from any surface that was seen, or on its other side"),
            Self::Width { width_voxels } => {
                return ("width", format!("a width of {width_voxels:.2} voxels is outside the limits"));
            }
            Self::Quality => ("quality", "quality below the threshold"),
            Self::Suppressed => ("suppressed", "a better grasp is near"),
            Self::Collision { points } => {
                return ("collision", format!("the hand would pass through {points} points of the cloud"));
            }
            Self::NoHand => ("no_hand", "no hand about it closes on anything flat by a free way"),
            Self::NoObject => ("no_object", "belongs to no object"),
            Self::BeyondLimit => ("beyond_limit", "beyond the requested number of grasps"),
        };
        (word, text.to_owned())
    }
}
