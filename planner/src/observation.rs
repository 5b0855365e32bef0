//! The input of a plan: depth images, a grid, or a cloud.

use std::ops::RangeInclusive;

use schema::{Camera, DepthImage, Grid, Plane, Pose, Quat, Vec3, VoxelGrid};
use settings::words;

use crate::gripper_volume::WRIST_DOWN;

words! {
    /// The key under which a camera's pose was given.
    pub enum PoseKey {
        /// The camera in the workspace.
        WorkspaceFromCamera = "workspace_from_camera",
        /// Its inverse.
        CameraFromWorkspace = "camera_from_workspace",
        /// The camera in the robot's base frame.
        BaseFromCamera = "base_from_camera",
        /// Its inverse.
        CameraFromBase = "camera_from_base",
        /// The camera in the first camera's frame.
        FirstFromCamera = "first_from_camera",
    }
}

impl PoseKey {
    /// Whether it begins with `camera_from`.
    pub(crate) const fn is_inverse(self) -> bool {
        matches!(self, Self::CameraFromWorkspace | Self::CameraFromBase)
    }

    /// Whether it needs the base's frame.
    pub(crate) const fn is_of_base(self) -> bool {
        matches!(self, Self::BaseFromCamera | Self::CameraFromBase)
    }
}

/// A depth image and the camera that took it.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Depth along the camera's z in metres; values that are not finite and positive count as not seen.
    pub image: DepthImage,
    /// Lens and pose in the workspace.
    pub camera: Camera,
    /// How the pose was given, for messages.
    pub key: PoseKey,
}

impl View {
    /// A view of a camera whose pose in the workspace was given.
    #[must_use]
    pub const fn new(image: DepthImage, camera: Camera) -> Self {
        Self { image, camera, key: PoseKey::WorkspaceFromCamera }
    }
}

/// An observation of the workspace.
#[derive(Debug, Clone, PartialEq)]
pub enum Observation {
    /// Depth images, from one view or several.
    Views(Vec<View>),
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

/// The most views with which judges have learned. A judge is given the number of views; one that is told of more
/// believes what nobody taught it, and takes hands for worse with each image. A TSDF does not say how many it has.
const VIEWS_MAX: usize = 6;
/// A view from nearer than this to another one shows the same.
const SAME_EYE_M: f32 = 0.05;

impl Observation {
    /// The depth images; those of a cloud or a TSDF are not known.
    #[must_use]
    pub fn images(&self) -> Option<&[View]> {
        match self {
            Self::Views(views) => Some(views),
            Self::Tsdf(_) | Self::Cloud { .. } => None,
        }
    }

    /// The number of views that show something new, as judges know it, and as far as it is known.
    pub(crate) fn views(&self) -> usize {
        let eye_of = |view: &View| view.camera.workspace_from_camera.translation;
        let eyes_m: Vec<Vec3> = match self {
            Self::Views(views) => views.iter().map(eye_of).collect(),
            Self::Tsdf(_) => return VIEWS_MAX,
            Self::Cloud { eyes_m, .. } => eyes_m.clone(),
        };
        let mut apart_m: Vec<Vec3> = Vec::new();
        for eye_m in eyes_m {
            if apart_m.iter().all(|other_m| (eye_m - *other_m).length() >= SAME_EYE_M) {
                apart_m.push(eye_m);
            }
        }
        apart_m.len().clamp(1, VIEWS_MAX)
    }
}

/// Sides that a workspace may have, in metres.
pub const WORKSPACE_M: RangeInclusive<f32> = 0.2..=1.2;

/// Options of a request; all have defaults.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlanOptions {
    /// The side of a judge's workspace, in [`WORKSPACE_M`]; by default as far as the settings reach. Networks of voxels
    /// have their own.
    pub workspace_size_m: Option<f32>,
    /// The workspace is on the table, which is to be found: poses are in the first camera's frame, or a cloud is in its
    /// sensor's.
    pub find_table: Option<FindTable>,
    /// The frame in the workspace from which a cloud was moved there: its mistakes can be named.
    pub workspace_from_cloud: Option<Pose>,
    /// The workspace in the robot's base frame: grasps are given there, too.
    pub base_from_workspace: Option<Pose>,
    /// The wrist's orientation now, in the workspace (gripper axes as a grasp's); of a grasp and its half turn the
    /// nearer one is given.
    pub workspace_from_wrist: Option<Quat>,
    /// Overrides the config's ranking.
    pub policy: Option<crate::Policy>,
    /// Overrides whether grasps that collide with the cloud are dropped.
    pub check_collisions: Option<bool>,
    /// Maximum number of grasps.
    pub grasps_max: Option<usize>,
    /// Whether the best grasp of each object comes before all others.
    pub each: bool,
    /// Whether to list dropped candidates with reasons.
    pub explain: bool,
    /// The best grasp of the last plan, in the frame of `avoid`: of grasps that are about as good as the best one the
    /// nearest to it comes first.
    pub previous: Option<Pose>,
    /// Grasps that failed, in the workspace or, where the table is found, in the first camera's frame: none like them
    /// is offered.
    pub avoid: Vec<Pose>,
    /// Which grasps are wanted.
    pub limits: Limits,
}

impl PlanOptions {
    /// The wrist's orientation, by default [`WRIST_DOWN`].
    pub(crate) fn wrist(&self) -> Quat {
        self.workspace_from_wrist.unwrap_or(WRIST_DOWN)
    }

    /// The options where the table was found: earlier grasps and a target's points were given in the first camera's
    /// frame, and the base's may be known by it.
    pub(crate) fn seen_from(&self, workspace_from_first: Pose) -> Self {
        let avoid = self.avoid.iter().map(|failed| workspace_from_first * *failed).collect();
        let previous = self.previous.map(|previous| workspace_from_first * previous);
        let moved = |ball: &Ball| Ball { centre_m: workspace_from_first * ball.centre_m, ..*ball };
        let avoid_objects = self.limits.avoid_objects.iter().map(moved).collect();
        let mut limits = Limits { avoid_objects, ..self.limits.clone() };
        if let Some(Target::Points(points_m)) = &mut limits.target {
            points_m.iter_mut().for_each(|at_m| *at_m = workspace_from_first * *at_m);
        }
        let base_from_camera = self.find_table.and_then(|wanted| wanted.base_from_camera);
        let base_from_workspace = base_from_camera.map(|base| base * workspace_from_first.inverse());
        Self { avoid, previous, limits, base_from_workspace, ..self.clone() }
    }

    /// The workspace, if the network's is `grid`: its voxels, but as many as its side takes.
    #[must_use]
    pub fn workspace(&self, grid: &Grid) -> Grid {
        self.workspace_size_m.map_or(*grid, |size_m| grid.over(size_m))
    }
}

/// How a table is found.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FindTable {
    /// The direction of gravity in the frame of the first camera or the cloud, of any length; without it the camera is
    /// believed to stand upright and to look down.
    pub down: Option<Vec3>,
    /// The first camera, or that of the cloud, in the robot's base frame: grasps are given there, too, and gravity is
    /// along the base's -z unless `down` is given.
    pub base_from_camera: Option<Pose>,
}

impl FindTable {
    /// The direction of gravity, as far as it is known.
    pub(crate) fn gravity(&self) -> Option<Vec3> {
        self.down.or_else(|| self.base_from_camera.map(|base| base.rotation.inverse() * Vec3::NEG_Z))
    }
}

/// What a request limits, in the workspace's frame if not said otherwise; by default nothing.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Limits {
    /// The approach is within an angle of a direction.
    pub approach: Option<Cone>,
    /// The open gripper, from pre-grasp to grasp, stays on the side of each plane to which its normal points.
    pub keep_out: Vec<Plane>,
    /// The tips' middle is within a box: its lower and upper corner, in metres.
    pub reach_m: Option<[Vec3; 2]>,
    /// The tips' middle is in none of these balls, in the workspace or, where the table is found, in the first camera's
    /// frame: about things that others go before, as something that was too heavy.
    pub avoid_objects: Vec<Ball>,
    /// Only what this is.
    pub target: Option<Target>,
}

/// What is nearer to a point than this.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ball {
    /// The point, in metres.
    pub centre_m: Vec3,
    /// How near, in metres.
    pub radius_m: f32,
}

/// Directions about one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    /// A unit vector.
    pub direction: Vec3,
    /// Largest angle from it, in radians.
    pub angle_rad_max: f32,
}

impl Cone {
    /// The directions about one of any length.
    #[must_use]
    pub fn about(direction: Vec3, angle_rad_max: f32) -> Self {
        Self { direction: direction.normalize(), angle_rad_max }
    }
}

/// The plane with a normal of any length: normal · x = offset.
#[must_use]
pub fn plane(normal: Vec3, offset_m: f32) -> Plane {
    let length = normal.length();
    Plane { normal: normal / length, offset_m: offset_m / length }
}

/// Of each pixel of a depth image, row by row, whether it shows what is wanted.
pub type Mask = Vec<bool>;

/// What is to be grasped.
#[derive(Debug, Clone, PartialEq)]
pub enum Target {
    /// The object at a point, in metres: the cluster of the surface that is nearest to it.
    Point(Vec3),
    /// What these pixels show: for each view of the observation a mask of its image, row by row, or none.
    Masks(Vec<Option<Mask>>),
    /// What these points of its surface are on, in metres, in the frame of the observation.
    Points(Vec<Vec3>),
}

#[cfg(test)]
mod tests {
    use schema::Intrinsics;

    use super::*;

    #[test]
    fn a_judge_is_told_of_views_that_add_something_and_of_no_more_than_it_knows() {
        let views_from = |eyes_m: &[Vec3]| {
            let view = |eye_m: &Vec3| {
                let workspace_from_camera = Pose::from_parts(*eye_m, WRIST_DOWN);
                let image = DepthImage { width_px: 0, height_px: 0, depth_m: Vec::new() };
                View::new(image, Camera { intrinsics: Intrinsics::VGN, workspace_from_camera })
            };
            let views = Observation::Views(eyes_m.iter().map(view).collect()).views();
            let cloud = Observation::Cloud { points_m: Vec::new(), eyes_m: eyes_m.to_vec() };
            assert_eq!(views, cloud.views());
            views
        };
        let along = |count: u8, step_m: f32| -> Vec<Vec3> {
            (0..count).map(|number| Vec3::new(f32::from(number) * step_m, 0.0, 0.5)).collect()
        };
        assert_eq!([0, 1, 2, 6, 7, 32].map(|count| views_from(&along(count, 0.1))), [1, 1, 2, 6, 6, 6]);
        assert_eq!([2, 32].map(|count| views_from(&along(count, 0.0))), [1, 1], "a camera that stands still");
        assert_eq!(views_from(&along(32, 0.004)), 3, "one that moves by 124 mm");
    }
}
