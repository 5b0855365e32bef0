//! The rows of an experiment: one per round, one per attempt. As JSON, a round is a line of the journal.

use schema::{Container, HitKind, Outcome, Pose, Quat, pose_from_parts};
use serde::{Deserialize, Serialize};
use settings::words;
use simulator::SceneObject;

words! {
    /// How a round ended.
    #[derive(PartialOrd, Ord, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Ending {
        /// No object was left.
        Cleared = "cleared",
        /// The planner found no grasp.
        NoGrasp = "no_grasp",
        /// Too many attempts in a row failed.
        Failures = "failures",
        /// The round's attempts were used up.
        AttemptsMax = "attempts_max",
        /// The objects did not come to rest again.
        Unsettled = "unsettled",
        /// A planner elsewhere failed, said nothing in time, or answered nonsense.
        NoAnswer = "no_answer",
    }
}

/// A round: one scene, cleared as far as possible.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// Number of the round among those of all seeds.
    pub round: u64,
    /// The seed.
    pub seed: u64,
    /// Number of the scene, unique for a seed.
    pub scene_id: u64,
    /// Kind of the scene.
    pub group: String,
    /// Number of scenes redrawn because the gripper cannot span an object.
    pub unviable_count: u32,
    /// Objects at the beginning.
    pub object_count: u32,
    /// Objects that were held and taken away.
    pub removed_count: u32,
    /// Objects that left the workspace without being held.
    pub lost_count: u32,
    /// How it ended.
    pub ending: Ending,
    /// Why a planner gave no answer, if the round ended by that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub no_answer: Option<String>,
    /// What the objects lie in.
    pub container: Option<Container>,
    /// The grasps that were executed, in order.
    #[serde(rename = "trials")]
    pub attempts: Vec<Attempt>,
    /// The objects that are left at the end, none if the table was cleared.
    #[serde(default)]
    pub left: Vec<AttemptObject>,
}

/// An executed grasp.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Attempt {
    /// Objects on the table before it.
    pub object_count: u32,
    /// Number of grasps in the plan.
    pub planned_count: u32,
    /// The executed one: the first that was not tried on the same scene before.
    #[serde(with = "PoseParts")]
    pub workspace_from_grasp: Pose,
    /// Its predicted width.
    pub width_m: f32,
    /// Its quality.
    pub quality: f32,
    /// Eq. 8's ρ, if it belongs to a cluster.
    pub rho_m: Option<f32>,
    /// The target: the object nearest to the grasp, by its index in `objects`.
    pub target_id: u32,
    /// The objects on the table before it.
    pub objects: Vec<AttemptObject>,
    /// How it ended.
    pub outcome: Outcome,
    /// What was hit, for outcomes that hit something.
    pub hit: Option<HitKind>,
    /// Rendering the views.
    pub observe_ms: f32,
    /// Depth images to ranked grasps.
    pub plan_ms: f32,
}

impl Attempt {
    /// Name of the target: the kind of solid, or a catalogue's name.
    #[must_use]
    pub fn target(&self) -> &str {
        self.objects.get(self.target_id as usize).map_or("", |object| &object.body)
    }
}

/// An object on the table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AttemptObject {
    /// Name of its body.
    pub body: String,
    /// Bounding box along its axes.
    pub size_m: [f32; 3],
    /// Mass.
    pub mass_kg: f32,
    /// Coulomb friction coefficient.
    pub friction: f32,
    /// Its pose.
    #[serde(with = "PoseParts")]
    pub workspace_from_object: Pose,
}

impl From<&SceneObject> for AttemptObject {
    fn from(object: &SceneObject) -> Self {
        Self {
            body: object.body.name().to_owned(),
            size_m: object.body.extents_m().to_array(),
            mass_kg: object.mass_kg,
            friction: object.friction,
            workspace_from_object: object.workspace_from_object,
        }
    }
}

/// A pose in the journal.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Pose")]
struct PoseParts {
    #[serde(getter = "position_m")]
    position_m: [f32; 3],
    #[serde(getter = "quaternion_xyzw")]
    quaternion_xyzw: [f32; 4],
}

fn position_m(pose: &Pose) -> [f32; 3] {
    pose.translation.to_array()
}

fn quaternion_xyzw(pose: &Pose) -> [f32; 4] {
    pose.rotation.to_array()
}

impl From<PoseParts> for Pose {
    fn from(parts: PoseParts) -> Self {
        pose_from_parts(Quat::from_array(parts.quaternion_xyzw), parts.position_m.into())
    }
}
