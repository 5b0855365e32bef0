//! The truncated signed distance field: for each voxel, how far in front of (+) or behind (−) the seen surface it lies.
//!
//! Each view says for the voxels it sees how much farther along the ray the surface is. The distance is *projective*:
//! it is measured along the ray through the voxel's pixel, not to the nearest surface. It is cut at a few voxels, since
//! far from the surface it means nothing, and voxels deeper behind the surface than that are not touched: that view
//! cannot know what is there. Views are averaged. This is Open3D's `UniformTSDFVolume` (Curless & Levoy 1996), which
//! VGN used, so that its published weights work on our grids.

use schema::{Camera, Grid, VoxelGrid};

/// VGN's truncation: 4 voxels (`TSDFVolume.sdf_trunc`), 30 mm on the paper's grid.
pub const TRUNCATION_VOXELS: f32 = 4.0;

/// Values nearer to ±1 than this count as empty or unknown in VGN's grids (Open3D: `ExtractVoxelGrid`).
const STORED_MAX: f32 = 0.98;

/// A TSDF in the making. Single-threaded; its bits depend on the views and their order alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Tsdf {
    grid: Grid,
    truncation_m: f32,
    /// Mean of the truncated distances over the views that saw the voxel, in truncations: [−1, 1]. Flat as in [`Grid`].
    mean: Vec<f32>,
    /// How many views saw the voxel. Invariant: 0 where `mean` means nothing.
    weight: Vec<f32>,
}

impl Tsdf {
    /// A field in which nothing was observed yet; distances are cut at `truncation_voxels` voxels
    /// ([`TRUNCATION_VOXELS`] for VGN's).
    ///
    /// # Panics
    /// If the truncation is not above 0.
    #[must_use]
    pub fn new(grid: Grid, truncation_voxels: f32) -> Self {
        assert!(truncation_voxels > 0.0, "the truncation must be above 0 voxels, got {truncation_voxels}");
        Self {
            grid,
            truncation_m: truncation_voxels * grid.voxel_size_m(),
            mean: vec![0.0; grid.len()],
            weight: vec![0.0; grid.len()],
        }
    }

    /// Adds one view (Open3D: `UniformTSDFVolume::Integrate`).
    ///
    /// `depth_at(pixel)` is the depth that the camera saw in that pixel: distance along the camera's z in metres, `None`
    /// where it saw nothing. For a whole image it is `|pixel| image.at(pixel)`; a simulator may cast a ray for each
    /// pixel asked for instead, which gives the very same field as rendering the image first. Only pixels onto which
    /// some voxel's centre falls are asked for, some of them more than once.
    pub fn integrate(&mut self, camera: &Camera, mut depth_at: impl FnMut([usize; 2]) -> Option<f32>) {
        let lens = camera.intrinsics;
        let camera_from_workspace = camera.workspace_from_camera.inverse();
        let step = camera_from_workspace.rotation * schema::Vec3::new(0.0, 0.0, self.grid.voxel_size_m());
        let per_truncation = 1.0 / self.truncation_m;
        let side = self.grid.resolution;
        for i in 0..side {
            for j in 0..side {
                let first = camera_from_workspace * self.grid.centre_m([i, j, 0]);
                let column = self.grid.flat([i, j, 0]);
                for k in 0..side {
                    let voxel = first + step * k as f32;
                    let Some(pixel) = lens.project(voxel) else { continue };
                    let Some(depth) = depth_at(pixel) else { continue };
                    let distance_m = (depth - voxel.z) * lens.ray(pixel).length();
                    if distance_m > -self.truncation_m {
                        let distance = (distance_m * per_truncation).min(1.0);
                        let (mean, weight) = (&mut self.mean[column + k], &mut self.weight[column + k]);
                        *mean = (*mean * *weight + distance) / (*weight + 1.0);
                        *weight += 1.0;
                    }
                }
            }
        }
    }

    /// The field at a voxel, in truncations: [−1, 1], positive in front of the surface; `None` if no view observed it.
    #[must_use]
    pub fn at(&self, index: [usize; 3]) -> Option<f32> {
        let flat = self.grid.flat(index);
        (self.weight[flat] > 0.0).then_some(self.mean[flat])
    }

    /// The field in VGN's value convention, which is what networks read: `(tsdf + 1) / 2` where the voxel was observed
    /// and −0.98 < tsdf < 0.98, else 0. The surface is at ½.
    #[must_use]
    pub fn to_voxels(&self) -> VoxelGrid {
        let stored = |(&mean, &weight): (&f32, &f32)| {
            if weight > 0.0 && mean > -STORED_MAX && mean < STORED_MAX { (mean + 1.0) * 0.5 } else { 0.0 }
        };
        VoxelGrid { grid: self.grid, values: self.mean.iter().zip(&self.weight).map(stored).collect() }
    }
}
