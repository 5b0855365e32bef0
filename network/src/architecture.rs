//! The two networks: what a checkpoint can hold.

use program::{ExitCode, Failure};
use schema::{Grid, Pose, Quat, Vec3};
use settings::words;

use crate::head::Head;
use crate::judge::{self, Scope};
use crate::layers::{self, LAYERS, LayerShape, ParameterSlot, slots_of};
use crate::upsampling::Upsampling;

words! {
    /// A network, by what it answers for.
    pub enum Kind {
        /// Voxels: the paper's.
        Voxel = "voxel",
        /// Grasps: the judge.
        Judge = "judge",
    }
}

impl Kind {
    /// Its description in messages.
    #[must_use]
    pub const fn describe(self) -> &'static str {
        match self {
            Self::Voxel => "the paper's network, which answers for voxels",
            Self::Judge => "a judge, which answers for grasps",
        }
    }

    /// The error where weights of this kind are given for what needs those of another.
    #[must_use]
    pub fn refused(self, what: &str, needed: Self) -> Failure {
        let text = format!("{what} needs {}; the weights are those of {}", needed.describe(), self.describe());
        Failure::new(ExitCode::Config, text)
    }
}

/// Where a network of voxels has the origin of a grasp. It decides which voxel answers for a grasp, so it belongs to
/// the weights, and everything that feeds or reads a network takes it from them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GraspOrigin {
    /// Distance of the origin behind the finger tips, against the approach: 0 is midway between the tips, the finger's
    /// length midway between the fingers' roots.
    pub behind_tips_m: f32,
    /// Place of the origin in its voxel along each axis: 0.5, the centre, where positions are rounded down to a voxel,
    /// as here; 0, the lower corner, where they are rounded to the nearest, as in VGN's code (`np.round`).
    pub voxel_offset: f32,
}

/// Farthest behind the tips that an origin may lie.
pub const BEHIND_TIPS_M_MAX: f32 = 0.3;

impl GraspOrigin {
    /// Midway between the tips: networks from before the origin was a choice.
    pub const TIPS: Self = Self::behind_tips(0.0);

    /// So far behind the tips, in the middle of its voxel.
    #[must_use]
    pub const fn behind_tips(behind_tips_m: f32) -> Self {
        Self { behind_tips_m, voxel_offset: 0.5 }
    }

    /// The origin of a grasp, in the workspace.
    #[must_use]
    pub fn of_m(&self, workspace_from_grasp: &Pose) -> Vec3 {
        workspace_from_grasp.transform_point(Vec3::new(0.0, 0.0, -self.behind_tips_m))
    }

    /// The voxel that answers for a grasp, or `None` if it lies outside the grid.
    #[must_use]
    pub fn voxel_of(&self, workspace_from_grasp: &Pose, grid: &Grid) -> Option<[usize; 3]> {
        grid.voxel_at(self.of_m(workspace_from_grasp) + Vec3::splat((0.5 - self.voxel_offset) * grid.voxel_size_m()))
    }

    /// The point midway between the tips of the grasp that a voxel answers with.
    #[must_use]
    pub fn tips_m(&self, voxel: [usize; 3], rotation: Quat, grid: &Grid) -> Vec3 {
        let origin_m = grid.centre_m(voxel) + Vec3::splat((self.voxel_offset - 0.5) * grid.voxel_size_m());
        origin_m + rotation * Vec3::Z * self.behind_tips_m
    }
}

/// What belongs to a network of voxels besides its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelParams {
    /// What it answers at a voxel.
    pub head: Head,
    /// How the decoder doubles its grids.
    pub upsampling: Upsampling,
    /// Where it has the origin of a grasp.
    pub origin: GraspOrigin,
}

impl VoxelParams {
    /// The paper's head, with origins midway between the tips.
    #[must_use]
    pub const fn at_tips(upsampling: Upsampling) -> Self {
        Self { head: Head::Quaternion, upsampling, origin: GraspOrigin::TIPS }
    }
}

/// A network's kind, and what belongs to it besides its parameters.
#[derive(Debug, Clone, PartialEq)]
pub enum Architecture {
    /// The paper's network, which answers for every voxel, or one that differs in its head.
    Voxel(VoxelParams),
    /// The judge, which answers for a grasp; what it was trained for.
    Judge(Box<Scope>),
}

impl Architecture {
    /// Its kind.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        match self {
            Self::Voxel(_) => Kind::Voxel,
            Self::Judge(_) => Kind::Judge,
        }
    }

    /// The layers, in the order of their parameters.
    #[must_use]
    pub fn layers(&self) -> &'static [LayerShape] {
        match self {
            Self::Voxel(params) => params.head.layers(),
            Self::Judge(scope) => scope.layers(),
        }
    }

    /// Every parameter with its position in the flat vector.
    #[must_use]
    pub fn slots(&self) -> Vec<ParameterSlot> {
        slots_of(self.layers())
    }

    /// How many parameters two networks have in common, which come first: all if they are the same, the layers before
    /// the head if voxels answer differently.
    #[must_use]
    pub fn shared_parameters(&self, other: &Self) -> usize {
        let all = |own: &Self| layers::count_of(own.layers());
        match (self, other) {
            (Self::Voxel(own), Self::Voxel(other)) if own.head != other.head => layers::count_of(&LAYERS[..6]),
            _ => all(self).min(all(other)),
        }
    }

    /// Initial parameters.
    #[must_use]
    pub fn initial_vector(&self, seed: u64) -> Vec<f32> {
        match self {
            Self::Voxel(params) => layers::initial_of(params.head.layers(), seed),
            Self::Judge(scope) => judge::initial_vector(seed)[..layers::count_of(scope.layers())].to_vec(),
        }
    }

    /// What a judge answers for.
    ///
    /// # Errors
    /// If this is the paper's network; `what` needs a judge.
    pub fn scope(&self, what: &str) -> Result<&Scope, Failure> {
        match self {
            Self::Judge(scope) => Ok(scope),
            Self::Voxel(_) => Err(self.kind().refused(what, Kind::Judge)),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use schema::{axis_angle, pose_from_parts};

    use super::*;

    proptest! {
        /// From a grasp to its voxel and back the tips move by no more than the rounding to a voxel does.
        #[test]
        fn a_voxel_leads_back_to_the_tips_of_its_grasp(
            behind_m in 0.0_f32..0.08,
            at_m in [0.1_f32..0.2, 0.1..0.2, 0.1..0.2],
            (axis, angle) in ([-1.0_f32..1.0, -1.0..1.0, 0.1..1.0], 0.0_f32..3.0),
        ) {
            let grid = Grid::PAPER;
            let pose = pose_from_parts(axis_angle(Vec3::from_array(axis).normalize(), angle), Vec3::from_array(at_m));
            for voxel_offset in [0.5, 0.0] {
                let origin = GraspOrigin { behind_tips_m: behind_m, voxel_offset };
                let voxel = origin.voxel_of(&pose, &grid).unwrap();
                let off = origin.tips_m(voxel, pose.rotation, &grid) - pose.translation;
                prop_assert!(off.abs().max_element() <= 0.5 * grid.voxel_size_m() + 1e-6, "{off}");
            }
        }
    }

    /// By hand: a gripper that points down at (103, 98, 61) mm has its origin 50 mm above, in voxel (13, 13, 14) of
    /// 7.5 mm; rounded as VGN does, in (14, 13, 15).
    #[test]
    fn a_gripper_from_above_has_its_origin_above_the_tips() {
        let down = pose_from_parts(Quat::from_xyzw(1.0, 0.0, 0.0, 0.0), Vec3::new(0.103, 0.098, 0.061));
        let voxel = |origin: GraspOrigin| origin.voxel_of(&down, &Grid::PAPER);
        assert_eq!(voxel(GraspOrigin::TIPS), Some([13, 13, 8]));
        assert_eq!(voxel(GraspOrigin::behind_tips(0.05)), Some([13, 13, 14]));
        assert_eq!(voxel(GraspOrigin { behind_tips_m: 0.05, voxel_offset: 0.0 }), Some([14, 13, 15]));
        assert_eq!(voxel(GraspOrigin::behind_tips(0.25)), None);
    }
}
