//! The workspace in voxels.

use serde::{Deserialize, Serialize};
use settings::{Reader, settings};

use crate::Vec3;

settings! {
    /// The cubic voxel grid over the workspace.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Grid {
        /// Voxels along each side.
        pub resolution: usize where 8..=128,
        /// Length of a side of the workspace, in metres.
        pub size_m: f32 where 0.05..=3.0,
        /// Height of the table's top above the workspace's origin, in metres.
        pub table_z_m: f32 where 0.0..=1.5,
    }
    check Grid::table_fits
}

impl Grid {
    /// The paper's and VGN's grid: 40³ voxels of 7.5 mm, the table at 0.05 m.
    pub const PAPER: Self = Self { resolution: 40, size_m: 0.30, table_z_m: 0.05 };

    /// A grid of the same voxels, with the table at the same height, for a workspace whose sides are so long, rounded
    /// up to whole voxels.
    #[must_use]
    pub fn over(&self, size_m: f32) -> Self {
        // A side that is so many voxels but for rounding.
        let resolution = (size_m / self.voxel_size_m() - 1e-3).ceil() as usize;
        let size_m = if resolution == self.resolution { self.size_m } else { resolution as f32 * self.voxel_size_m() };
        Self { resolution, size_m, ..*self }
    }

    fn table_fits(&self, reader: &mut Reader<'_>) {
        let (got, most) = (self.table_z_m, 0.5 * self.size_m);
        reader.must("table_z_m", got <= most, || format!("must be between 0 and {most}, got {got}"));
    }

    /// Side of a voxel, in metres.
    #[must_use]
    pub fn voxel_size_m(&self) -> f32 {
        self.size_m / self.resolution as f32
    }

    /// As [`Lattice::centre_m`].
    #[must_use]
    pub fn centre_m(&self, index: [usize; 3]) -> Vec3 {
        Lattice::from(*self).centre_m(index)
    }

    /// As [`Lattice::voxel_at`].
    #[must_use]
    pub fn voxel_at(&self, point_m: Vec3) -> Option<[usize; 3]> {
        Lattice::from(*self).voxel_at(point_m)
    }

    /// As [`Lattice::flat`].
    #[must_use]
    pub fn flat(&self, index: [usize; 3]) -> usize {
        Lattice::from(*self).flat(index)
    }

    /// Number of voxels.
    #[must_use]
    pub fn len(&self) -> usize {
        self.resolution.pow(3)
    }

    /// Whether the grid has no voxels.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.resolution == 0
    }
}

/// Voxels in a box whose edges are parallel to the workspace's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lattice {
    /// Its lower corner in the workspace, in metres.
    pub low_m: Vec3,
    /// Voxels along x, y and z.
    pub counts: [usize; 3],
    /// Side of a voxel, in metres.
    pub voxel_size_m: f32,
    /// Height of the table's top in the workspace, in metres.
    pub table_z_m: f32,
}

impl From<Grid> for Lattice {
    fn from(grid: Grid) -> Self {
        Self {
            low_m: Vec3::ZERO,
            counts: [grid.resolution; 3],
            voxel_size_m: grid.voxel_size_m(),
            table_z_m: grid.table_z_m,
        }
    }
}

impl Lattice {
    /// Its lower and its upper corner in the workspace, in metres.
    #[must_use]
    pub fn corners_m(&self) -> [Vec3; 2] {
        let [x, y, z] = self.counts.map(|count| count as f32);
        [self.low_m, self.low_m + Vec3::new(x, y, z) * self.voxel_size_m]
    }

    /// Centre of voxel `(i, j, k)` in the workspace, in metres.
    #[must_use]
    pub fn centre_m(&self, [i, j, k]: [usize; 3]) -> Vec3 {
        self.low_m + (Vec3::new(i as f32, j as f32, k as f32) + 0.5) * self.voxel_size_m
    }

    /// The voxel that holds a point of the workspace, or `None` outside.
    #[must_use]
    pub fn voxel_at(&self, point_m: Vec3) -> Option<[usize; 3]> {
        let mut index = [0; 3];
        for ((slot, coordinate), count) in index.iter_mut().zip((point_m - self.low_m).to_array()).zip(self.counts) {
            let voxel = (coordinate / self.voxel_size_m).floor();
            if !(voxel >= 0.0 && voxel < count as f32) {
                return None;
            }
            *slot = voxel as usize;
        }
        Some(index)
    }

    /// Number of voxels.
    #[must_use]
    pub fn len(&self) -> usize {
        self.counts.iter().product()
    }

    /// Whether it has no voxels.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Index of voxel `(i, j, k)` in a flat array: x slowest, z fastest.
    #[must_use]
    pub fn flat(&self, [i, j, k]: [usize; 3]) -> usize {
        (i * self.counts[1] + j) * self.counts[2] + k
    }

    /// The voxel at a place of a flat array.
    #[must_use]
    pub fn voxel(&self, flat: usize) -> [usize; 3] {
        let [_, y, z] = self.counts;
        [flat / (y * z), flat / z % y, flat % z]
    }
}

/// A TSDF over voxels, in VGN's value convention: `(tsdf + 1) / 2` where the voxel was observed and
/// −0.98 < tsdf < 0.98, else 0. Flat, x slowest, z fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct VoxelGrid {
    /// The voxels.
    pub lattice: Lattice,
    /// A value in [0, 1) for each.
    pub values: Vec<f32>,
}

impl VoxelGrid {
    /// Values of a grid or another lattice.
    ///
    /// # Errors
    /// Unless there is one value a voxel.
    pub fn new(lattice: impl Into<Lattice>, values: Vec<f32>) -> Result<Self, String> {
        let lattice = lattice.into();
        let ([x, y, z], expected, got) = (lattice.counts, lattice.len(), values.len());
        if got != expected {
            return Err(format!("a grid of {x} x {y} x {z} voxels needs {expected} values, got {got}"));
        }
        Ok(Self { lattice, values })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_voxels_centre_lies_in_that_voxel() {
        let grid = Grid::PAPER;
        for index in [[0, 0, 0], [39, 39, 39], [3, 17, 25]] {
            assert_eq!(grid.voxel_at(grid.centre_m(index)), Some(index));
        }
    }

    #[test]
    fn a_workspace_of_another_size_has_the_same_voxels() {
        let grid = Grid::PAPER;
        assert_eq!(grid.over(0.3), grid);
        for (size_m, resolution) in [(0.2, 27), (0.2025, 27), (0.301, 41), (0.45, 60), (0.6, 80)] {
            let other = grid.over(size_m);
            assert_eq!((other.resolution, other.table_z_m), (resolution, grid.table_z_m), "{size_m}");
            assert!((other.voxel_size_m() - grid.voxel_size_m()).abs() < 1e-8 && other.size_m > size_m - 1e-6);
        }
    }

    #[test]
    fn points_outside_have_no_voxel() {
        let grid = Grid::PAPER;
        for point in [Vec3::splat(-1e-6), Vec3::new(0.1, 0.1, 0.3001), Vec3::new(f32::NAN, 0.1, 0.1)] {
            assert_eq!(grid.voxel_at(point), None, "{point}");
        }
    }
}
