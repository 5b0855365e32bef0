//! A grasp in metres and a grasp in voxels: two types, so that no one converts in place.

use crate::{Grid, Pose, Quat};

/// A parallel-jaw grasp in the workspace.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grasp {
    /// +z approach, +y closing, origin midway between the finger tips' ends.
    pub workspace_from_grasp: Pose,
    /// Distance between the fingers' inner faces, in metres.
    pub width_m: f32,
}

/// A grasp as the network sees it: at a voxel, its width counted in voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelGrasp {
    /// The voxel that holds the grasp's origin: x, y, z.
    pub index: [usize; 3],
    /// Orientation, the same as in metres.
    pub rotation: Quat,
    /// Opening width in voxels.
    pub width_voxels: f32,
}

impl Grasp {
    /// The grasp in voxels, or `None` if its origin lies outside the grid.
    #[must_use]
    pub fn to_voxels(&self, grid: &Grid) -> Option<VoxelGrasp> {
        let index = grid.voxel_at(self.workspace_from_grasp.translation)?;
        Some(VoxelGrasp {
            index,
            rotation: self.workspace_from_grasp.rotation,
            width_voxels: self.width_m / grid.voxel_size_m(),
        })
    }
}
