//! A grasp in metres.

use crate::Pose;

/// A parallel-jaw grasp in the workspace.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grasp {
    /// +z approach, +y closing, origin midway between the finger tips' ends.
    pub workspace_from_grasp: Pose,
    /// Distance between the fingers' inner faces, in metres.
    pub width_m: f32,
}
