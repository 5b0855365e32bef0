//! The rows of a dataset: scenes, objects, attempts.

use crate::{Axis, Container, Grid, HitKind, ObjectShape, Outcome, Polyhedron, Pose, Rule, View};

/// Scenes that were built and thrown away before this one came to rest, by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SceneRejections {
    /// The objects did not come to rest in time.
    pub unsettled: u32,
    /// Every object fell off the table or out of the workspace.
    pub empty: u32,
    /// The engine gave a pose that is no number, or shot an object away.
    pub unstable: u32,
}

/// A row of the `scenes` table.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SceneRecord {
    /// Number of the scene in the dataset, from 0; unique.
    pub scene_id: u64,
    /// Objects dropped.
    pub dropped_count: u32,
    /// Objects in the settled scene; at most `dropped_count`, since some fall off.
    pub object_count: u32,
    /// Attempts executed.
    pub attempt_count: u32,
    /// Simulated time until the scene came to rest, in seconds.
    pub settle_time_s: f32,
    /// Scenes thrown away before this one.
    pub rejections: SceneRejections,
    /// Camera poses from which the TSDF was made.
    pub views: Vec<View>,
    /// The TSDF in VGN's value convention ([`crate::VoxelGrid`]); flat, x slowest, z fastest; resolution³ values.
    pub tsdf: Vec<f32>,
    /// What the objects lie in, if not on the bare table.
    pub container: Option<Container>,
}

impl SceneRecord {
    /// What never moves but the table: the parts of the container, in the workspace of a dataset with this grid.
    ///
    /// # Panics
    /// If [`Container::check`] refuses the container.
    #[must_use]
    pub fn fixtures(&self, grid: &Grid) -> Vec<Polyhedron> {
        self.container.map_or_else(Vec::new, |container| container.parts(grid))
    }
}

/// A row of the `objects` table.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectRecord {
    /// The scene.
    pub scene_id: u64,
    /// Number of the object in its scene, from 0.
    pub object_id: u32,
    /// Shape and size.
    pub shape: ObjectShape,
    /// Mass in kilograms.
    pub mass_kg: f32,
    /// Coulomb friction coefficient.
    pub friction: f32,
    /// Pose at rest.
    pub workspace_from_object: Pose,
}

/// A row of the `attempts` table: a candidate drawn by a rule, executed once.
#[derive(Debug, Clone, PartialEq)]
pub struct AttemptRecord {
    /// The scene.
    pub scene_id: u64,
    /// Number of the attempt in its scene, from 0.
    pub attempt_id: u32,
    /// The target, by its number in the scene.
    pub object_id: u32,
    /// How it was drawn: by a row of Appendix A, or otherwise.
    pub rule: Rule,
    /// Object axis along which the gripper closes, before the turn; `None` if no axis of the object decides.
    pub closing: Option<Axis>,
    /// Drawn rotation about the grasp's y axis (Appendix A: r_y).
    pub tilt_rad: f32,
    /// Drawn rotation about the grasp's x axis (r_x); 0 for rules without. Along a normal: the yaw about the approach.
    pub turn_rad: f32,
    /// Drawn offset along the grasp's z axis, from the object's centre (d_z), in metres. Along a normal: from the
    /// surface.
    pub depth_m: f32,
    /// Drawn offset along the grasp's x axis (d_x), in metres; 0 for rules without.
    pub slide_m: f32,
    /// The grasp.
    pub workspace_from_grasp: Pose,
    /// How it ended.
    pub outcome: Outcome,
    /// What was hit, for the outcomes that hit something.
    pub hit: Option<HitKind>,
    /// Which object was hit, where it was an object.
    pub hit_object_id: Option<u32>,
    /// Opening between the fingers' inner faces in metres: at the end of the hold if the object was held, else when
    /// the fingers stopped closing; `None` if they never closed.
    pub width_m: Option<f32>,
    /// Of its repeats with other masses, other friction and slightly moved grasps, the share that held as well; `None`
    /// if it did not hold or was not repeated.
    pub robustness: Option<f32>,
}

impl AttemptRecord {
    /// 1 if the object was held, else 0.
    #[must_use]
    pub fn label(&self) -> u8 {
        self.outcome.label()
    }
}

/// All rows of one scene.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneRows {
    /// The scene.
    pub scene: SceneRecord,
    /// Its objects, by `object_id`.
    pub objects: Vec<ObjectRecord>,
    /// Its attempts, by `attempt_id`.
    pub attempts: Vec<AttemptRecord>,
}
