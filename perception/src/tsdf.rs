//! The truncated signed distance field: for each voxel, its distance in front of (+) or behind (−) the observed
//! surface.
//!
//! For each voxel that a view sees, the distance to the surface is measured along the ray through the voxel's pixel,
//! not to the nearest surface (a *projective* distance). It is truncated at a few voxels. Voxels deeper behind the
//! surface are not updated, because the view contains no information about them. Views are averaged. This is Open3D's
//! `UniformTSDFVolume` (Curless & Levoy 1996), which VGN used, so VGN's published weights work on our grids.

use core::ops::Range;

use rayon::prelude::*;
use schema::{Camera, DepthImage, Intrinsics, Lattice, Mat3, Pose, Vec3, VoxelGrid};

use crate::blocks::{CELLS, SurfaceBlocks, VALUES, VOXELS, block_counts};
use crate::seen::{seen_points, stride_px};

/// VGN's truncation: 4 voxels (`TSDFVolume.sdf_trunc`), 30 mm on the paper's grid.
pub const TRUNCATION_VOXELS: f32 = 4.0;

/// Values of at least this magnitude count as empty or unknown in VGN's grids (Open3D: `ExtractVoxelGrid`).
const STORED_MAX: f32 = 0.98;

/// A TSDF under construction; its bits depend only on the views and their order.
#[derive(Debug, Clone, PartialEq)]
pub struct Tsdf {
    lattice: Lattice,
    truncation_m: f32,
    /// Mean of the truncated distances over the views that saw the voxel, in truncations: [−1, 1]. Flat as in
    /// [`Lattice`].
    mean: Vec<f32>,
    /// Number of views that saw the voxel. Invariant: 0 where `mean` is undefined.
    weight: Vec<f32>,
}

impl Tsdf {
    /// A field without observations; distances are truncated at `truncation_voxels` voxels
    /// ([`TRUNCATION_VOXELS`] for VGN's).
    ///
    /// # Panics
    /// If the truncation is not above 0.
    #[must_use]
    pub fn new(lattice: impl Into<Lattice>, truncation_voxels: f32) -> Self {
        let lattice = lattice.into();
        Self {
            truncation_m: truncation_m(&lattice, truncation_voxels),
            mean: vec![0.0; lattice.len()],
            weight: vec![0.0; lattice.len()],
            lattice,
        }
    }

    /// Adds one view (Open3D: `UniformTSDFVolume::Integrate`).
    ///
    /// `depth_at(pixel)` is the depth in that pixel: the distance along the camera's z in metres, `None` where the
    /// camera saw nothing. For a whole image it is `|pixel| image.at(pixel)`. A simulator may instead cast a ray per
    /// requested pixel, which gives the same field as rendering the image first. Only pixels onto which a voxel's
    /// centre projects are requested, some of them more than once.
    pub fn integrate(&mut self, camera: &Camera, depth_at: impl FnMut([usize; 2]) -> Option<f32>) {
        self.integrate_lines(camera, one_by_one(depth_at));
    }

    /// The same; `look_up(pixels, depths_m)` gives the depths in the pixels of a line in the image, infinite where the
    /// camera saw nothing.
    pub fn integrate_lines(&mut self, camera: &Camera, mut look_up: impl FnMut(&[[usize; 2]], &mut [f32])) {
        let [_, width, height] = self.lattice.counts;
        let mut column = Column::new(camera, &self.lattice, 0..height, 1);
        let slabs = self.mean.chunks_mut(width * height).zip(self.weight.chunks_mut(width * height));
        for (i, (mean, weight)) in slabs.enumerate() {
            column.fuse_slab(i, self.truncation_m, &mut look_up, (mean, weight));
        }
    }

    /// The field at a voxel, in truncations: [−1, 1], positive in front of the surface; `None` if no view observed it.
    #[must_use]
    pub fn at(&self, index: [usize; 3]) -> Option<f32> {
        let flat = self.lattice.flat(index);
        (self.weight[flat] > 0.0).then_some(self.mean[flat])
    }

    /// The field in VGN's value convention, the network's input: `(tsdf + 1) / 2` where the voxel was observed
    /// and −0.98 < tsdf < 0.98, else 0. The surface is at ½.
    #[must_use]
    pub fn to_voxels(&self) -> VoxelGrid {
        let values = self.mean.iter().zip(&self.weight).map(|(mean, weight)| stored(*mean, *weight)).collect();
        VoxelGrid { lattice: self.lattice, values }
    }
}

fn truncation_m(lattice: &Lattice, truncation_voxels: f32) -> f32 {
    assert!(truncation_voxels > 0.0, "the truncation must be above 0 voxels, got {truncation_voxels}");
    truncation_voxels * lattice.voxel_size_m
}

/// The look-up of a line of pixels, one after the other.
fn one_by_one(mut depth_at: impl FnMut([usize; 2]) -> Option<f32>) -> impl FnMut(&[[usize; 2]], &mut [f32]) {
    move |pixels, depths_m| {
        for (pixel, depth_m) in pixels.iter().zip(depths_m) {
            *depth_m = depth_at(*pixel).unwrap_or(f32::INFINITY);
        }
    }
}

/// The stored value of a voxel with this mean over this many views.
fn stored(mean: f32, weight: f32) -> f32 {
    if weight > 0.0 && mean > -STORED_MAX && mean < STORED_MAX { (mean + 1.0) * 0.5 } else { 0.0 }
}

/// The field of depth images in VGN's values, on all threads: the bits of [`Tsdf::integrate`] and
/// [`Tsdf::to_voxels`]. `truncation_voxels` as in [`Tsdf::new`].
///
/// Only heights near something that was seen are worked on: a voxel above all of it is empty for every view, one below
/// is hidden from every view, and both are stored as 0. (Plans from three views on grids of 40³ and 120³ voxels take
/// 87 ms instead of 101 with this and the quicker search in `surface_cloud`.)
///
/// # Panics
/// If the truncation is not above 0.
#[must_use]
pub fn fuse_images(lattice: impl Into<Lattice>, truncation_voxels: f32, views: &[(Camera, &DepthImage)]) -> VoxelGrid {
    let lattice = lattice.into();
    let truncation_m = truncation_m(&lattice, truncation_voxels);
    let ([_, width, height], heights) = (lattice.counts, heights_seen(views, &lattice, truncation_m));
    let mut values = vec![0.0; lattice.len()];
    if heights.is_empty() {
        return VoxelGrid { lattice, values };
    }
    let columns = || -> Vec<Column> {
        views.iter().map(|(camera, _)| Column::new(camera, &lattice, heights.clone(), 1)).collect()
    };
    let slabs = values.par_chunks_mut(width * height).enumerate().with_min_len(4);
    slabs.for_each_init(columns, |columns, (i, slab)| {
        let (mut mean, mut weight) = (vec![0.0; width * heights.len()], vec![0.0; width * heights.len()]);
        for (column, (_, image)) in columns.iter_mut().zip(views) {
            let mut look_up = one_by_one(|pixel| image.at(pixel));
            column.fuse_slab(i, truncation_m, &mut look_up, (&mut mean, &mut weight));
        }
        let seen = mean.chunks(heights.len()).zip(weight.chunks(heights.len()));
        for (column, (mean, weight)) in slab.chunks_mut(height).zip(seen) {
            let into = column[heights.clone()].iter_mut();
            into.zip(mean.iter().zip(weight)).for_each(|(value, (mean, weight))| *value = stored(*mean, *weight));
        }
    });
    VoxelGrid { lattice, values }
}

/// The same field, but only in blocks near something that was seen above a height of `above_m`: elsewhere all voxels
/// are stored as 0.
///
/// # Panics
/// If the truncation is not above 0.
#[must_use]
pub fn fuse_blocks(
    lattice: &Lattice,
    truncation_voxels: f32,
    above_m: f32,
    views: &[(Camera, &DepthImage)],
) -> SurfaceBlocks {
    let truncation_m = truncation_m(lattice, truncation_voxels);
    let mut blocks = SurfaceBlocks::new(*lattice, &near_surfaces(lattice, truncation_m, above_m, views));
    let (lattices, values) = blocks.parts_mut();
    let columns =
        || -> Vec<Column> { views.iter().map(|(camera, _)| Column::new(camera, lattice, 0..VOXELS, LINES)).collect() };
    values.par_chunks_mut(VALUES).zip(lattices).with_min_len(16).for_each_init(
        columns,
        |columns, (values, lattice)| {
            let (mut mean, mut weight) = ([0.0; VALUES], [0.0; VALUES]);
            for (column, (_, image)) in columns.iter_mut().zip(views) {
                column.lattice = lattice;
                (0..LINES).for_each(|line| column.project(line, [line / VOXELS, line % VOXELS]));
                column.look_up(&mut one_by_one(|pixel| image.at(pixel)));
                column.fuse(truncation_m, &mut mean, &mut weight);
            }
            values
                .iter_mut()
                .zip(mean.iter().zip(weight))
                .for_each(|(value, (mean, weight))| *value = stored(*mean, weight));
        },
    );
    blocks
}

/// Lines of a block's voxels along z.
const LINES: usize = VOXELS * VOXELS;
/// About so many pixels along an image's width are looked at for blocks.
const COLUMNS_PX: usize = 320;

/// Of each block of a lattice, whether something above a height was seen within the truncation of it.
fn near_surfaces(lattice: &Lattice, truncation_m: f32, above_m: f32, views: &[(Camera, &DepthImage)]) -> Vec<bool> {
    let counts = block_counts(lattice);
    let block_m = CELLS as f32 * lattice.voxel_size_m;
    let of_view = |(camera, image): &(Camera, &DepthImage)| {
        let mut is_near = vec![false; counts.iter().product()];
        let stride = stride_px(image, COLUMNS_PX);
        // A voxel's centre and the ray of its pixel are less than a pixel apart.
        let pixel = (1 + stride) as f32 * (1.0 / camera.intrinsics.fx_px).max(1.0 / camera.intrinsics.fy_px);
        seen_points(camera, image, COLUMNS_PX).filter(|(at_m, _)| at_m.z >= above_m).for_each(|(at_m, depth_m)| {
            let margin_m = truncation_m + pixel * depth_m;
            // Blocks begin at the centre of the lattice's first voxel; a negative number rounds to 0.
            let block = |along_m: f32| ((along_m - 0.5 * lattice.voxel_size_m) / block_m).floor();
            let [low, high] = [-margin_m, margin_m].map(|margin_m| (at_m - lattice.low_m + margin_m).map(block));
            let last = Vec3::from_array(counts.map(|count| count as f32));
            if high.cmplt(Vec3::ZERO).any() || low.cmpge(last).any() {
                return;
            }
            let [x, y, z] = [0, 1, 2].map(|axis| low[axis] as usize..(high[axis] as usize + 1).min(counts[axis]));
            for (x, y) in x.flat_map(|x| y.clone().map(move |y| (x, y))) {
                let line = (x * counts[1] + y) * counts[2];
                is_near[line + z.start..line + z.end].fill(true);
            }
        });
        is_near
    };
    let either = |a: Vec<bool>, b: Vec<bool>| a.iter().zip(b).map(|(a, b)| *a || b).collect();
    views.par_iter().map(of_view).reduce_with(either).unwrap_or_else(|| vec![false; counts.iter().product()])
}

/// The layers of voxels that are within the truncation of a point that a view saw in the workspace.
fn heights_seen(views: &[(Camera, &DepthImage)], lattice: &Lattice, truncation_m: f32) -> Range<usize> {
    let ranges_m: Vec<[f32; 2]> =
        views.par_iter().map(|(camera, image)| heights_m(camera, image, lattice, truncation_m)).collect();
    let [low_m, high_m] = ranges_m.into_iter().fold(NOTHING_M, wider);
    let layer = |z_m: f32| ((z_m - lattice.low_m.z) / lattice.voxel_size_m).clamp(0.0, lattice.counts[2] as f32);
    if low_m < high_m { layer(low_m) as usize..layer(high_m).ceil() as usize } else { 0..0 }
}

/// The range of heights of no points.
const NOTHING_M: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

fn wider([low, high]: [f32; 2], [other_low, other_high]: [f32; 2]) -> [f32; 2] {
    [low.min(other_low), high.max(other_high)]
}

/// The heights within the truncation of what one view saw in the workspace.
fn heights_m(camera: &Camera, image: &DepthImage, lattice: &Lattice, truncation_m: f32) -> [f32; 2] {
    let corners_m = lattice.corners_m();
    let (from_m, lens) = (camera.workspace_from_camera.translation, camera.intrinsics);
    let turn = Mat3::from_quat(camera.workspace_from_camera.rotation);
    // A voxel's centre and the ray of its pixel are less than a pixel apart.
    let pixel = 1.0 / lens.fx_px + 1.0 / lens.fy_px;
    let rays_x: Vec<f32> = (0..image.width_px).map(|u| lens.ray([u, 0]).x).collect();
    // Eight pixels at a time and without branches, which the compiler vectorises.
    let (mut low_m, mut high_m) = ([f32::INFINITY; 8], [f32::NEG_INFINITY; 8]);
    for (v, depths_m) in image.depth_m.chunks_exact(image.width_px.max(1)).enumerate() {
        let along = turn * lens.ray([0, v]).with_x(0.0);
        let mut look = |lane: usize, ray_x: f32, depth_m: f32| {
            let at_m = from_m + (turn.x_axis * ray_x + along) * depth_m;
            let margin_m = truncation_m + pixel * depth_m;
            let [low, high] = [corners_m[0] - margin_m, corners_m[1] + margin_m];
            // False for pixels that saw nothing: 0, infinite or NaN.
            let is_in =
                (depth_m > 0.0) & ((at_m.x > low.x) & (at_m.x < high.x)) & ((at_m.y > low.y) & (at_m.y < high.y));
            let [low, high] = if is_in { [at_m.z - margin_m, at_m.z + margin_m] } else { NOTHING_M };
            low_m[lane] = if low < low_m[lane] { low } else { low_m[lane] };
            high_m[lane] = if high > high_m[lane] { high } else { high_m[lane] };
        };
        let (rays_x, rest_x) = rays_x.as_chunks::<8>();
        let (depths_m, rest_m) = depths_m.as_chunks::<8>();
        for (rays_x, depths_m) in rays_x.iter().zip(depths_m) {
            (0..8).for_each(|lane| look(lane, rays_x[lane], depths_m[lane]));
        }
        rest_x.iter().zip(rest_m).for_each(|(ray_x, depth_m)| look(0, *ray_x, *depth_m));
    }
    low_m.into_iter().zip(high_m).map(|(low_m, high_m)| [low_m, high_m]).fold(NOTHING_M, wider)
}

/// A column of voxels along workspace z in one view, processed in three passes. The first and the last pass have no
/// branches and no calls, so the compiler vectorises them four voxels wide; only the depths are looked up one by one.
/// (On one core a view of the paper's grid takes 0.32 ms, and took 1.0 ms voxel by voxel. Most pixels are requested
/// once: 46,000 different ones for 62,000 voxels, so a cache gains nothing.)
struct Column {
    lens: Intrinsics,
    lattice: Lattice,
    /// Which of its voxels.
    heights: Range<usize>,
    camera_from_workspace: Pose,
    /// From one voxel to the next, in the camera frame, metres.
    step_m: Vec3,
    /// Squares of the pixels' rays' x by u, and y by v.
    ray_x2: Vec<f32>,
    ray_y2: Vec<f32>,
    /// Pixel coordinates, half a pixel added, so that the pixel is their whole part; NaN behind the camera.
    u: Vec<f32>,
    v: Vec<f32>,
    /// Depth of the voxels' centres, in metres.
    z_m: Vec<f32>,
    /// Seen depth in metres; infinite where nothing was seen.
    depth_m: Vec<f32>,
    /// Square of the length of the pixel's ray: of distance per depth.
    ray2: Vec<f32>,
    pixels: Vec<[usize; 2]>,
}

impl Column {
    fn new(camera: &Camera, lattice: &Lattice, heights: Range<usize>, lines: usize) -> Self {
        let lens = camera.intrinsics;
        let square = |x: f32| x * x;
        let camera_from_workspace = camera.workspace_from_camera.inverse();
        let blank = vec![0.0; heights.len() * lines];
        Self {
            lens,
            lattice: *lattice,
            camera_from_workspace,
            step_m: camera_from_workspace.rotation * Vec3::new(0.0, 0.0, lattice.voxel_size_m),
            ray_x2: (0..lens.width_px).map(|u| square(lens.ray([u, 0]).x)).collect(),
            ray_y2: (0..lens.height_px).map(|v| square(lens.ray([0, v]).y)).collect(),
            u: blank.clone(),
            v: blank.clone(),
            z_m: blank.clone(),
            depth_m: blank.clone(),
            ray2: blank,
            pixels: vec![[0; 2]; heights.len() * lines],
            heights,
        }
    }

    /// Updates the columns (i, ·), of these heights, with this view.
    fn fuse_slab(
        &mut self,
        i: usize,
        truncation_m: f32,
        look_up: &mut impl FnMut(&[[usize; 2]], &mut [f32]),
        (mean, weight): (&mut [f32], &mut [f32]),
    ) {
        let count = self.heights.len();
        for (j, (mean, weight)) in mean.chunks_mut(count).zip(weight.chunks_mut(count)).enumerate() {
            self.project(0, [i, j]);
            self.look_up(look_up);
            self.fuse(truncation_m, mean, weight);
        }
    }

    /// The pixels of the voxels of column (i, j), as one of the lines; the arithmetic of [`Intrinsics::project`].
    fn project(&mut self, line: usize, [i, j]: [usize; 2]) {
        let (lens, step_m) = (self.lens, self.step_m);
        let first_m = self.camera_from_workspace * self.lattice.centre_m([i, j, 0]);
        let own = line * self.heights.len()..(line + 1) * self.heights.len();
        let slots = self.u[own.clone()].iter_mut().zip(&mut self.v[own.clone()]).zip(&mut self.z_m[own]);
        for (k, ((u, v), z_m)) in self.heights.clone().zip(slots) {
            let voxel_m = first_m + step_m * (k as u32 as f32);
            let ahead = if voxel_m.z > 0.0 { 0.5 } else { f32::NAN };
            *u = voxel_m.x * lens.fx_px / voxel_m.z + lens.cx_px + ahead;
            *v = voxel_m.y * lens.fy_px / voxel_m.z + lens.cy_px + 0.5;
            *z_m = voxel_m.z;
        }
    }

    /// Looks up the depths.
    fn look_up(&mut self, look_up: &mut impl FnMut(&[[usize; 2]], &mut [f32])) {
        let (width, height) = (self.lens.width_px as f32, self.lens.height_px as f32);
        // False for NaN, which marks voxels behind the camera.
        let has = |u: f32, v: f32| u >= 0.0 && v >= 0.0 && u < width && v < height;
        // What is seen of a column is in one piece, unless rounding breaks it.
        let mut from = 0;
        for k in 0..self.u.len() {
            let (u, v) = (self.u[k], self.v[k]);
            if has(u, v) {
                let pixel = [u as u32 as usize, v as u32 as usize];
                self.pixels[k] = pixel;
                self.ray2[k] = self.ray_x2[pixel[0]] + self.ray_y2[pixel[1]] + 1.0;
            } else {
                look_up(&self.pixels[from..k], &mut self.depth_m[from..k]);
                self.depth_m[k] = f32::INFINITY;
                from = k + 1;
            }
        }
        look_up(&self.pixels[from..], &mut self.depth_m[from..]);
    }

    /// Updates the running means with this view.
    fn fuse(&self, truncation_m: f32, mean: &mut [f32], weight: &mut [f32]) {
        let per_truncation = 1.0 / truncation_m;
        let side = mean.len();
        // Slices of equal length need no bounds checks in the loop.
        let (depth_m, z_m, ray2) = (&self.depth_m[..side], &self.z_m[..side], &self.ray2[..side]);
        let weight = &mut weight[..side];
        for k in 0..side {
            let distance_m = (depth_m[k] - z_m[k]) * ray2[k].sqrt();
            let near = f32::from(u8::from(distance_m > -truncation_m && distance_m < f32::INFINITY));
            let distance = (distance_m * per_truncation).min(1.0);
            let fused = (mean[k] * weight[k] + distance) / (weight[k] + 1.0);
            mean[k] = if near > 0.0 { fused } else { mean[k] };
            weight[k] += near;
        }
    }
}
