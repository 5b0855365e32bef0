//! The input of a plan: depth images, a grid, or a cloud.

use program::{Exit, ExitCode};
use schema::{Camera, DepthImage, Grid, Pose, Quat, Vec3, VoxelGrid};

/// A depth image and the camera that took it.
#[derive(Debug, Clone, PartialEq)]
pub struct SeenView {
    /// Depth along the camera's z in metres; values that are not finite and positive count as not seen.
    pub image: DepthImage,
    /// Lens and pose in the workspace.
    pub camera: Camera,
}

/// An observation of the workspace.
#[derive(Debug, Clone, PartialEq)]
pub enum Observation {
    /// Depth images, from one view or several.
    Views(Vec<SeenView>),
    /// A TSDF in VGN's values.
    Tsdf(VoxelGrid),
    /// Points on surfaces in the workspace frame, and their viewpoints.
    Cloud {
        /// Points, in metres; points outside the workspace are dropped.
        points_m: Vec<Vec3>,
        /// Positions of the sensors, in metres; empty if unknown.
        eyes_m: Vec<Vec3>,
    },
}

/// Options of a request; all have defaults.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Wishes {
    /// The workspace in the robot's base frame: grasps are given there, too.
    pub base_from_workspace: Option<Pose>,
    /// The wrist's orientation now, in the workspace (hand axes as a grasp's); of a grasp and its half turn the nearer
    /// one is given.
    pub workspace_from_wrist: Option<Quat>,
    /// Overrides the config's ranking.
    pub policy: Option<crate::Policy>,
    /// Overrides whether grasps that collide with the cloud are dropped.
    pub check_collisions: Option<bool>,
    /// Maximum number of grasps.
    pub grasps_max: Option<usize>,
    /// Whether to list dropped candidates with reasons.
    pub explain: bool,
}

/// Why an observation is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// A TSDF on a grid that is not the network's.
    #[error("the grid must have {}³ voxels in {} m, got {}³ in {} m: tsdf", .expected.resolution, .expected.size_m, .got.resolution, .got.size_m)]
    Grid {
        /// The network's.
        expected: Grid,
        /// The TSDF's.
        got: Grid,
    },
    /// An image whose size differs from its intrinsics.
    #[error("the depth image must have the lens's {} x {} pixels, got {} x {}: views[{view}]", .expected[0], .expected[1], .got[0], .got[1])]
    Image {
        /// Number of the view.
        view: usize,
        /// The image's width and height.
        got: [usize; 2],
        /// The lens's.
        expected: [usize; 2],
        /// How many depths there are.
        values: usize,
    },
    /// Points that fill volumes instead of surfaces.
    #[error("a cloud must be a surface, of at most {points_max} points at the settings' pitch, got {points}: cloud")]
    Solid {
        /// Points after thinning.
        points: usize,
        /// Most.
        points_max: usize,
    },
    /// A viewpoint that cannot see the workspace.
    #[error("an eye must be above the floor and {distance_m_min} m to 1000 m from the middle of the workspace's floor, got {}: eyes_m or the cloud's viewpoint", .eye_m)]
    Eye {
        /// The given position.
        eye_m: Vec3,
        /// The least distance.
        distance_m_min: f32,
    },
}

impl Exit for PlanError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Config
    }
}
