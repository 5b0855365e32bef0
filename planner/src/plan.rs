//! The plan: ranked grasps, their objects, and the rejected candidates. As JSON it is the output of `graspmill plan`
//! and `graspmill serve`.

use perception::{FoundPlane, TableCandidate};
use schema::{Lattice, Outcome, Pose, Vec3};
use serde::{Serialize, Serializer};
use settings::words;

use crate::config::Policy;
use crate::doubt::Doubt;
use crate::frame::FoundTable;

/// Version of the plan's layout as JSON.
pub const FORMAT: &str = "graspmill-plan/3";

/// A grasp: +z approach, +y closing, origin midway between the finger tips' ends.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct RankedGrasp {
    /// 1 is the best.
    pub rank: usize,
    /// The grasp in the workspace.
    #[serde(serialize_with = "pose")]
    pub workspace_from_grasp: Pose,
    /// The grasp in the optical frame of the first camera, or of the sensor of a cloud whose table was found; null if
    /// neither is known.
    #[serde(serialize_with = "pose")]
    pub camera_from_grasp: Option<Pose>,
    /// The grasp in the robot's base frame; null if `base_from_workspace` was not given.
    #[serde(serialize_with = "pose")]
    pub base_from_grasp: Option<Pose>,
    /// The robot's flange at the grasp, in the workspace; null if the gripper's file has no `flange_from_grasp`.
    #[serde(serialize_with = "pose")]
    pub workspace_from_flange: Option<Pose>,
    /// The robot's flange at the grasp, in the robot's base frame; null if either is not known.
    #[serde(serialize_with = "pose")]
    pub base_from_flange: Option<Pose>,
    /// Distance between the fingers' inner faces when holding, in metres: measured on what was seen between them, or
    /// a network of voxels' answer; null where an end of it was not seen.
    pub width_m: Option<f32>,
    /// Share of the ends of what is between the fingers, at all heights, that were seen; null if nothing was measured.
    pub width_seen_share: Option<f32>,
    /// How far to open the gripper, in metres: for what is between the fingers and some room; all the way where that
    /// is unknown.
    pub opening_m: f32,
    /// What the gripper's driver is to be told for that; left out if the gripper's file has no `joint`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint_position: Option<f32>,
    /// Grasp quality, smoothed, between 0 and 1.
    pub quality: f32,
    /// Of a judge: if the grasp holds, the share of repeats with heavier objects, less friction and slightly moved
    /// grasps that would hold, too; null of one that did not learn it, and of networks of voxels.
    pub robustness: Option<f32>,
    /// Index into `objects`; null without an object.
    pub object: Option<usize>,
    /// Eq. 8's ρ in metres: weighted distance to the object's centroid over quality; null without an object.
    pub rho_m: Option<f32>,
    /// The voxel of the detection: x, y, z; null for a judge's grasp.
    pub voxel: Option<[usize; 3]>,
    /// Why it comes after those of which nothing is to be doubted: `no_depth`, `bent_table` or `cut_by_border`; left
    /// out of these.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub doubt: Option<Doubt>,
}

impl RankedGrasp {
    /// A grasp of this width and quality that is not ranked yet.
    #[must_use]
    pub fn new(workspace_from_grasp: Pose, width_m: Option<f32>, quality: f32, voxel: Option<[usize; 3]>) -> Self {
        Self { workspace_from_grasp, width_m, quality, voxel, ..Self::default() }
    }
}

/// Writes a rigid transform `target_from_source`, or an optional one: metres, and a unit quaternion x, y, z, w.
fn pose<'a, S: Serializer>(pose: impl Into<Option<&'a Pose>>, serializer: S) -> Result<S::Ok, S::Error> {
    let Some(Pose { rotation, translation, .. }) = pose.into() else { return serializer.serialize_none() };
    let (position_m, quaternion_xyzw) = (translation.to_array(), rotation.to_array());
    serializer.collect_map([("position_m", &position_m[..]), ("quaternion_xyzw", &quaternion_xyzw[..])])
}

/// A cluster of the surface cloud. Objects are numbered from the top: the one with the highest centroid is 0.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct ObjectCluster {
    /// Mean of its points in the workspace, in metres.
    #[serde(serialize_with = "coordinates")]
    pub centroid_m: Vec3,
    /// The same in the robot's base frame; null if `base_from_workspace` is not known.
    #[serde(serialize_with = "coordinates")]
    pub base_centroid_m: Option<Vec3>,
    /// Number of its points.
    pub point_count: usize,
    /// Number of its grasps in the plan.
    pub grasp_count: usize,
    /// The best quality of these; null if there are none.
    pub quality_best: Option<f32>,
    /// Why there are none; null if there are.
    pub reason: Option<String>,
}

fn coordinates<'a, S: Serializer>(point: impl Into<Option<&'a Vec3>>, serializer: S) -> Result<S::Ok, S::Error> {
    let point: Option<&Vec3> = point.into();
    point.map(|point| point.to_array()).serialize(serializer)
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

impl SegmentedCloud {
    /// The points of objects, each with its object.
    pub(crate) fn of_objects(&self) -> impl Iterator<Item = (Vec3, usize)> {
        self.points_m.iter().zip(&self.labels).filter_map(|(point_m, label)| match label {
            PointLabel::Object(object) => Some((*point_m, *object)),
            PointLabel::Plane | PointLabel::Noise => None,
        })
    }
}

/// A plane: normal · x = offset, in the workspace.
#[derive(Serialize)]
struct PlaneAnswer {
    /// Unit normal, upwards.
    normal: [f32; 3],
    /// Metres.
    offset_m: f32,
    /// Points of the cloud within the threshold.
    inlier_count: usize,
}

/// Writes the plane of a cloud.
fn plane<S: Serializer>(cloud: &SegmentedCloud, serializer: S) -> Result<S::Ok, S::Error> {
    let answer = |FoundPlane { plane, inliers, .. }: &FoundPlane| PlaneAnswer {
        normal: plane.normal.to_array(),
        offset_m: plane.offset_m,
        inlier_count: inliers.len(),
    };
    cloud.plane.as_ref().map(answer).serialize(serializer)
}

words! {
    /// A limit that a grasp breaks, by its key in a request.
    pub enum Limit {
        /// It comes from another direction.
        Approach = "approach",
        /// The gripper would be beyond a plane.
        KeepOut = "keep_out",
        /// The tips would be outside the box.
        Reach = "reach",
        /// It would hold something that is to be left for now.
        AvoidObjects = "avoid_objects",
        /// It would hold something else.
        Target = "target",
        /// It would close on a wall of a bin, a tray or a shelf, or touch one on its way.
        Walls = "walls",
        /// The fingers would close where no camera looks: beside what the border of an image cuts.
        Unseen = "unseen",
        /// The caller's own, which only programs have that link the planner: Python's `accept`.
        Accept = "accept",
    }
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
    Quality {
        /// The end that a judge expects, with its probability.
        likeliest: Option<(Outcome, f32)>,
    },
    /// The network's answer is not a number.
    NotANumber,
    /// A neighbour within the suppression window is better.
    Suppressed,
    /// It is like a grasp that failed.
    Avoided,
    /// It breaks a limit of the request.
    Limited {
        /// Which.
        limit: Limit,
    },
    /// The gripper would pass through this many points of the cloud on its way.
    Collision {
        /// Points inside what the gripper sweeps.
        points: usize,
    },
    /// It would hold pixels that fly between a thing and what is behind it.
    Flying,
    /// Beyond the requested number of grasps.
    BeyondLimit,
}

impl RejectReason {
    /// The reason as one word, for programs, and as text.
    fn word_and_text(self) -> (&'static str, String) {
        let far = "far from any surface that was seen, or on its other side";
        match self {
            Self::FarFromSurface => ("far_from_surface", far.into()),
            Self::Width { width_voxels } => {
                ("width", format!("a width of {width_voxels:.2} voxels is outside the limits"))
            }
            Self::Quality { likeliest } => {
                let end = likeliest.map(|(outcome, probability)| format!(": {probability:.2} {}", outcome.name()));
                ("quality", format!("quality below the threshold{}", end.unwrap_or_default()))
            }
            Self::NotANumber => ("not_a_number", "the network's answer is not a number".into()),
            Self::Suppressed => ("suppressed", "a better grasp is near".into()),
            Self::Avoided => ("avoided", "like a grasp that failed".into()),
            Self::Limited { limit } => ("limited", format!("the request does not allow it: {}", limit.name())),
            Self::Collision { points } => {
                ("collision", format!("the gripper would pass through {points} points of the cloud"))
            }
            Self::Flying => ("flying_points", "it holds pixels between a thing and what is behind it".into()),
            Self::BeyondLimit => ("beyond_limit", "beyond the requested number of grasps".into()),
        }
    }
}

/// A candidate that was dropped.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DroppedCandidate {
    /// Why.
    #[serde(skip)]
    pub reason: RejectReason,
    /// `far_from_surface`, `width`, `quality`, `not_a_number`, `suppressed`, `avoided`, `limited`, `collision`,
    /// `flying_points` or `beyond_limit`.
    pub why: &'static str,
    /// The reason as text, with the numbers.
    pub detail: String,
    /// Its pose in the workspace.
    #[serde(serialize_with = "pose")]
    pub workspace_from_grasp: Pose,
    /// A network of voxels' answer in metres; null for a judge's candidate.
    pub width_m: Option<f32>,
    /// Smoothed quality before any mask.
    pub quality: f32,
    /// The voxel of the detection: x, y, z; null for a judge's candidate.
    pub voxel: Option<[usize; 3]>,
}

impl DroppedCandidate {
    /// A grasp that is dropped for this reason.
    #[must_use]
    pub fn new(grasp: &RankedGrasp, reason: RejectReason) -> Self {
        let (why, detail) = reason.word_and_text();
        let RankedGrasp { workspace_from_grasp, width_m, quality, voxel, .. } = *grasp;
        Self { reason, why, detail, workspace_from_grasp, width_m, quality, voxel }
    }
}

/// The number of candidates left after each stage, in their order. The stages are those of the network's method: of one
/// that answers for voxels `voxels`, `near_surface`, `width_within_limits`, `quality_reached` and `detections`, of a
/// judge `proposed`, `judged` and `quality_reached`; then `found` (closed on something where the settings ask for it,
/// apart from better ones, unlike grasps that failed, within the limits of the request), `collision_free` (all, if
/// collisions were not checked) and `ranked`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Funnel(pub Vec<(&'static str, usize)>);

impl Funnel {
    /// Candidates that passed a stage; `None` if the method has no such stage.
    #[must_use]
    pub fn count(&self, stage: &str) -> Option<usize> {
        self.0.iter().find(|(name, _)| *name == stage).map(|(_, count)| *count)
    }
}

impl Serialize for Funnel {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().copied())
    }
}

/// A plane that may be the table, in the optical frame of the first camera: normal · x = offset.
#[derive(Serialize)]
struct TableCandidateAnswer {
    /// Unit normal, towards the camera's side.
    normal: [f32; 3],
    /// Metres.
    offset_m: f32,
    /// Root mean square of its points' distances, in metres.
    residual_m: f32,
    /// Share of the points that belong to it.
    share: f32,
    /// Share of the points that it carries.
    carried_share: f32,
    /// Where the things on it are, in metres.
    middle_m: [f32; 3],
    /// The point of a wall, a shelf or the like above it that is nearest to them, in metres; null if there is none.
    structure_m: Option<[f32; 3]>,
    /// How well it answers, against the chosen plane.
    score: f32,
}

/// The table that was found.
#[derive(Serialize)]
struct TableAnswer {
    /// How sure the choice is: 1 where no other plane is nearly as good, 0 where another one is as good.
    sureness: f32,
    /// The planes that were considered, the chosen one first.
    candidates: Vec<TableCandidateAnswer>,
}

/// Writes a table that was found.
fn table<S: Serializer>(found: &Option<FoundTable>, serializer: S) -> Result<S::Ok, S::Error> {
    let answer = |found: &FoundTable| {
        let best = found.candidates.first().map_or(1.0, |best| best.score);
        let candidate = |one: &TableCandidate| TableCandidateAnswer {
            normal: one.plane.normal.to_array(),
            offset_m: one.plane.offset_m,
            residual_m: one.residual_m,
            share: one.share,
            carried_share: one.carried_share,
            middle_m: one.middle_m.to_array(),
            structure_m: one.structure_m.map(|at_m| at_m.to_array()),
            score: one.score / best,
        };
        TableAnswer { sureness: found.sureness(), candidates: found.candidates.iter().map(candidate).collect() }
    };
    // About an object that floats there is none.
    found.as_ref().filter(|found| !found.candidates.is_empty()).map(answer).serialize(serializer)
}

/// A part of the workspace, z up.
#[derive(Serialize)]
struct RegionAnswer {
    /// The lower corner, in metres.
    low_m: [f32; 3],
    /// The upper corner.
    high_m: [f32; 3],
    /// Height of the table's top, in metres.
    table_z_m: f32,
}

/// Writes where a lattice is.
fn region<S: Serializer>(lattice: &Lattice, serializer: S) -> Result<S::Ok, S::Error> {
    let [low_m, high_m] = lattice.corners_m().map(|corner| corner.to_array());
    RegionAnswer { low_m, high_m, table_z_m: lattice.table_z_m }.serialize(serializer)
}

/// A plan.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plan {
    /// Layout of this document: `graspmill-plan/3`.
    pub format: &'static str,
    /// SHA-256 of the network's weights file.
    pub model: String,
    /// The order of the grasps: `paper`, `vgn-random` or `vgn-best`.
    pub policy: Policy,
    /// Name of the gripper.
    pub gripper: String,
    /// The grasp frame in the frame of the robot's flange, as the gripper's file says; null if it does not.
    #[serde(serialize_with = "pose")]
    pub flange_from_grasp: Option<Pose>,
    /// The part of the workspace in which grasps were looked for.
    #[serde(serialize_with = "region")]
    pub region: Lattice,
    /// The first camera in the workspace, as it was given or found; null if there is none.
    #[serde(serialize_with = "pose")]
    pub workspace_from_camera: Option<Pose>,
    /// The table that was found; null if that was not asked for.
    #[serde(serialize_with = "table")]
    pub table: Option<FoundTable>,
    /// The upper edges of the walls of a container, each a line of points in metres; left out where none was found.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub walls: Vec<Vec<[f32; 3]>>,
    /// The grasps, best first.
    pub grasps: Vec<RankedGrasp>,
    /// Why there are no grasps; null if there are.
    pub reason: Option<String>,
    /// Warnings for the caller.
    pub warnings: Vec<String>,
    /// The objects, from the top.
    pub objects: Vec<ObjectCluster>,
    /// The plane under the objects; null if none was found. It is all that JSON has of the segmented cloud.
    #[serde(rename = "plane", serialize_with = "plane")]
    pub cloud: SegmentedCloud,
    /// The number of candidates left after each stage.
    pub funnel: Funnel,
    /// Dropped candidates with reasons, best first; empty unless requested: those above the threshold that had a better
    /// neighbour, collided or were beyond a limit, and local maxima of the smoothed quality of at least ε/2 that were
    /// rejected before.
    pub dropped: Vec<DroppedCandidate>,
    /// Times of the stages in milliseconds, in order.
    #[serde(skip)]
    pub timings_ms: Vec<(&'static str, f64)>,
}
