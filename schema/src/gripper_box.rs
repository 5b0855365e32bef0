//! Boxes of which grippers are made.

use crate::{Pose, Quat, Vec3};

/// A turned box is covered by slices of at most this.
const SLICE_M: f32 = 0.004;

/// A box of the gripper in the grasp frame, axes along the frame's.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GripperBox {
    /// Centre, in metres.
    pub centre_m: Vec3,
    /// Half lengths, in metres.
    pub half_m: Vec3,
}

impl GripperBox {
    /// The box lengthened backwards by `distance_m` along −z: everything it passes on a straight approach of that
    /// length.
    #[must_use]
    pub fn swept_back(&self, distance_m: f32) -> Self {
        self.swept(Vec3::new(0.0, 0.0, -distance_m))
    }

    /// The box moved.
    #[must_use]
    pub fn moved(&self, way_m: Vec3) -> Self {
        Self { centre_m: self.centre_m + way_m, ..*self }
    }

    /// The box lengthened by a way along one of its axes: everything that it passes.
    #[must_use]
    pub fn swept(&self, way_m: Vec3) -> Self {
        let half_m = 0.5 * way_m;
        Self { centre_m: self.centre_m + half_m, half_m: self.half_m + half_m.abs() }
    }

    /// Height of its lowest corner in the workspace.
    #[must_use]
    pub fn lowest_z_m(&self, workspace_from_grasp: &Pose) -> f32 {
        let centre = workspace_from_grasp.transform_point(self.centre_m);
        let rotation = workspace_from_grasp.rotation;
        let reach = [Vec3::X, Vec3::Y, Vec3::Z]
            .into_iter()
            .map(|axis| (rotation * axis).z.abs() * axis.dot(self.half_m))
            .sum::<f32>();
        centre.z - reach
    }

    /// Whether a ball comes near it.
    #[must_use]
    pub fn is_near(&self, centre_m: Vec3, radius_m: f32) -> bool {
        let outside = ((centre_m - self.centre_m).abs() - self.half_m).max(Vec3::ZERO);
        outside.length_squared() <= radius_m * radius_m
    }

    /// The box grown by `margin_m` on every side.
    #[must_use]
    pub fn grown(&self, margin_m: f32) -> Self {
        Self { half_m: self.half_m + Vec3::splat(margin_m), ..*self }
    }

    /// Boxes along the axes that together cover the box at a pose: that box itself where it is only moved; else the box
    /// is cut along its longest side, and each slice has the box around it.
    pub(crate) fn covered(&self, pose: &Pose) -> Vec<Self> {
        if pose.rotation == Quat::IDENTITY {
            return vec![self.moved(pose.translation)];
        }
        let half_m = self.half_m.to_array();
        let longest = (1..3).fold(0, |best, axis| if half_m[axis] > half_m[best] { axis } else { best });
        let count = libm::ceilf(2.0 * half_m[longest] / SLICE_M).max(1.0);
        let mut half_m = self.half_m;
        half_m[longest] /= count;
        let axes = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| (pose.rotation * axis).abs());
        let around_m = axes[0] * half_m.x + axes[1] * half_m.y + axes[2] * half_m.z;
        let slice = |number: u16| {
            let mut centre_m = self.centre_m;
            centre_m[longest] += half_m[longest] * (2.0 * f32::from(number) + 1.0 - count);
            Self { centre_m: pose.transform_point(centre_m), half_m: around_m }
        };
        (0..count as u16).map(slice).collect()
    }
}
