//! A grasp in metres.

use crate::Pose;

/// Whether the tips of two grasps are within a distance of each other and their axes within an angle, half turns apart
/// or not: then they are nearly the same.
#[must_use]
pub fn are_alike(one: &Pose, other: &Pose, most_m: f32, most_rad: f32) -> bool {
    let turn = one.rotation.inverse() * other.rotation;
    (one.translation - other.translation).length() <= most_m
        && turn.w.abs().max(turn.z.abs()) >= libm::cosf(0.5 * most_rad)
}

/// A parallel-jaw grasp in the workspace.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grasp {
    /// +z approach, +y closing, origin midway between the finger tips' ends.
    pub workspace_from_grasp: Pose,
    /// Distance between the fingers' inner faces, in metres.
    pub width_m: f32,
}
