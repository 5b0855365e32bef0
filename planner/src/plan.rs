//! The plan: ranked grasps, the objects they belong to, and what became of every candidate.

use perception::FoundPlane;
use schema::{Grasp, Grid, Pose, Vec3};
use serde::Serialize;
use utoipa::ToSchema;

/// A ranked grasp.
#[derive(Debug, Clone, PartialEq)]
pub struct RankedGrasp {
    /// The grasp in the workspace.
    pub grasp: Grasp,
    /// Its pose in the robot's base frame, if that is known.
    pub base_from_grasp: Option<Pose>,
    /// Smoothed grasp quality, in [0, 1].
    pub quality: f32,
    /// The voxel it was found in.
    pub voxel: [usize; 3],
    /// Number of the object it belongs to (in [`Plan::objects`]), if it belongs to one.
    pub object: Option<usize>,
    /// Eq. 8's ρ in metres, if it belongs to an object.
    pub rho_m: Option<f32>,
    /// Points of the cloud on which the finger lies flat that has fewer, less the farther off the middle; if hands were refined.
    pub support: Option<f32>,
}

/// A cluster of the cloud. Objects are numbered top-down: the one with the highest centroid is 0.
#[derive(Debug, Clone, PartialEq)]
pub struct SeenObject {
    /// Mean of its points, in the workspace.
    pub centroid_m: Vec3,
    /// How many points it has.
    pub point_count: usize,
}

/// What a point of the cloud belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PointLabel {
    /// The segmented plane.
    Plane,
    /// An object, by its number in [`Plan::objects`].
    Object(usize),
    /// Neither: noise, or a cluster too small to count.
    Noise,
}

/// The surface cloud, segmented.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentedCloud {
    /// Points in the workspace, in metres.
    pub points_m: Vec<Vec3>,
    /// One label a point.
    pub labels: Vec<PointLabel>,
    /// The plane under the objects, if there is one.
    pub plane: Option<FoundPlane>,
}

/// Why a candidate is not among the ranked grasps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Drop {
    /// Farther from the seen surface than the config allows, or on its other side.
    FarFromSurface,
    /// The predicted width is outside the limits.
    Width {
        /// Predicted width, in voxels.
        width_voxels: f32,
    },
    /// Quality below ε.
    Quality,
    /// A neighbour within the suppression window is better.
    Suppressed,
    /// The hand, on its way, would pass through this many points of the cloud.
    Collision {
        /// Points inside the swept hand.
        points: usize,
    },
    /// No hand about it closes on anything flat by a free way.
    NoHand,
    /// Belongs to no object, and the config drops such.
    NoObject,
    /// Beyond the number of grasps that was asked for.
    BeyondLimit,
}

/// A candidate that was dropped.
#[derive(Debug, Clone, PartialEq)]
pub struct DroppedCandidate {
    /// The grasp in the workspace.
    pub grasp: Grasp,
    /// Smoothed quality before any mask.
    pub quality: f32,
    /// The voxel it was found in.
    pub voxel: [usize; 3],
    /// Why.
    pub drop: Drop,
}

/// How many candidates were left after each stage.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, ToSchema)]
pub struct Funnel {
    /// Voxels of the grid.
    pub voxels: usize,
    /// Near enough to the surface.
    pub near_surface: usize,
    /// With a width within the limits.
    pub width_within_limits: usize,
    /// With a quality of ε or more.
    pub quality_reached: usize,
    /// Best within their suppression window: VGN's detections.
    pub detections: usize,
    /// For which a hand was found on the cloud (all, if hands are not refined).
    pub hands_found: usize,
    /// Whose hand hits nothing (all, if that was not checked).
    pub collision_free: usize,
    /// Given.
    pub ranked: usize,
}

/// A plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The workspace.
    pub grid: Grid,
    /// The grasps, best first.
    pub grasps: Vec<RankedGrasp>,
    /// The objects, top-down.
    pub objects: Vec<SeenObject>,
    /// The cloud in which they were found.
    pub cloud: SegmentedCloud,
    /// What became of the voxels.
    pub funnel: Funnel,
    /// Why there are no grasps; `None` if there are.
    pub reason: Option<String>,
    /// What the caller should know.
    pub warnings: Vec<String>,
    /// If that was asked for, the candidates that were dropped, best first: what was good enough and had a better neighbour,
    /// collided, or was beyond a limit, and peaks of the smoothed quality, of half of ε or more, that were out before.
    pub dropped: Vec<DroppedCandidate>,
    /// How long each stage took, in milliseconds, in order.
    pub timings_ms: Vec<(&'static str, f64)>,
}
