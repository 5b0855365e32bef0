//! The plan: ranked grasps, their objects, and the rejected candidates.

use perception::FoundPlane;
use schema::{Grasp, Grid, Pose, Vec3};
use serde::Serialize;
use utoipa::ToSchema;

use crate::config::Policy;

/// A ranked grasp.
#[derive(Debug, Clone, PartialEq)]
pub struct RankedGrasp {
    /// The grasp in the workspace.
    pub grasp: Grasp,
    /// Its pose in the robot's base frame, if the base is known.
    pub base_from_grasp: Option<Pose>,
    /// Smoothed grasp quality, in [0, 1].
    pub quality: f32,
    /// The voxel of the detection.
    pub voxel: [usize; 3],
    /// Index of its object in [`Plan::objects`], if it has one.
    pub object: Option<usize>,
    /// Eq. 8's ρ in metres, if it has an object.
    pub rho_m: Option<f32>,
    /// Support of the hand if refined: the smaller number of points under a finger, reduced with the distance from the
    /// middle.
    pub support: Option<f32>,
}

/// A cluster of the cloud. Objects are numbered from the top: the one with the highest centroid is 0.
#[derive(Debug, Clone, PartialEq)]
pub struct SeenObject {
    /// Mean of its points, in the workspace.
    pub centroid_m: Vec3,
    /// Number of its points.
    pub point_count: usize,
}

/// The segment of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PointLabel {
    /// The segmented plane.
    Plane,
    /// An object, by its index in [`Plan::objects`].
    Object(usize),
    /// Neither: noise or a too small cluster.
    Noise,
}

/// The surface cloud, segmented.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentedCloud {
    /// Points in the workspace, in metres.
    pub points_m: Vec<Vec3>,
    /// One label per point.
    pub labels: Vec<PointLabel>,
    /// The plane under the objects, if there is one.
    pub plane: Option<FoundPlane>,
}

/// Why a candidate is not among the ranked grasps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RejectReason {
    /// Further from the observed surface than allowed, or on its other side.
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
    /// The hand would pass through this many points of the cloud on its way.
    Collision {
        /// Points inside the swept hand.
        points: usize,
    },
    /// No hand at the position has both a free way and flat surfaces between its fingers.
    NoHand,
    /// It has no object, and the config drops such grasps.
    NoObject,
    /// Beyond the requested number of grasps.
    BeyondLimit,
}

/// A candidate that was dropped.
#[derive(Debug, Clone, PartialEq)]
pub struct DroppedCandidate {
    /// The grasp in the workspace.
    pub grasp: Grasp,
    /// Smoothed quality before any mask.
    pub quality: f32,
    /// The voxel of the detection.
    pub voxel: [usize; 3],
    /// Why.
    pub reason: RejectReason,
}

/// The number of candidates left after each stage.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, ToSchema)]
pub struct Funnel {
    /// Voxels of the grid.
    pub voxels: usize,
    /// Voxels near the surface.
    pub near_surface: usize,
    /// Of those, with a width within the limits.
    pub width_within_limits: usize,
    /// Of those, with a quality of ε or more.
    pub quality_reached: usize,
    /// Of those, the best within their suppression window: VGN's detections.
    pub detections: usize,
    /// Of those, with a hand found on the cloud (all, if hands are not refined).
    pub hands_found: usize,
    /// Of those, without a collision (all, if collisions were not checked).
    pub collision_free: usize,
    /// Returned grasps.
    pub ranked: usize,
}

/// A plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The workspace.
    pub grid: Grid,
    /// The order of the grasps.
    pub policy: Policy,
    /// The grasps, best first.
    pub grasps: Vec<RankedGrasp>,
    /// The objects, from the top.
    pub objects: Vec<SeenObject>,
    /// The segmented cloud.
    pub cloud: SegmentedCloud,
    /// Counts by stage.
    pub funnel: Funnel,
    /// Why there are no grasps; `None` if there are.
    pub reason: Option<String>,
    /// Warnings for the caller.
    pub warnings: Vec<String>,
    /// On request, the dropped candidates, best first: those above the threshold that had a better neighbour, collided
    /// or were beyond a limit, and local maxima of the smoothed quality of at least ε/2 that were rejected before.
    pub dropped: Vec<DroppedCandidate>,
    /// Times of the stages in milliseconds, in order.
    pub timings_ms: Vec<(&'static str, f64)>,
}
