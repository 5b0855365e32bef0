//! What a plan is made of: depth images, a grid, or a cloud.

use schema::{Camera, DepthImage, Pose, Quat, Vec3, VoxelGrid};

/// A depth image and the camera that took it.
#[derive(Debug, Clone, PartialEq)]
pub struct SeenView {
    /// Depth along the camera's z in metres; whatever is not a finite number above 0 counts as not seen.
    pub image: DepthImage,
    /// Lens and pose in the workspace.
    pub camera: Camera,
}

/// What a robot saw of its workspace.
#[derive(Debug, Clone, PartialEq)]
pub enum Observation {
    /// Depth images, from one view or several.
    Views(Vec<SeenView>),
    /// A TSDF in VGN's values.
    Tsdf(VoxelGrid),
    /// Points on surfaces in the workspace frame, and the eyes from which they were seen.
    Cloud {
        /// Points, in metres; what lies outside the workspace is left out.
        points_m: Vec<Vec3>,
        /// Where the sensors stood, in metres; empty if nobody knows.
        eyes_m: Vec<Vec3>,
    },
}

/// What a caller wants besides the grasps' places in the workspace; everything may be left as it is by default.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Wishes {
    /// The workspace in the robot's base frame: grasps are given there, too.
    pub base_from_workspace: Option<Pose>,
    /// The wrist's orientation now, in the workspace (hand axes as a grasp's); of a grasp and its half turn the nearer
    /// one is given.
    pub workspace_from_wrist: Option<Quat>,
    /// In place of the config's ranking.
    pub policy: Option<crate::Policy>,
    /// In place of the config's answer to whether grasps whose hand would hit the cloud are dropped.
    pub check_collisions: Option<bool>,
    /// Most grasps that are given.
    pub grasps_max: Option<usize>,
    /// Tell why candidates were dropped.
    pub explain: bool,
}
