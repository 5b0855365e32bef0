//! Whole depth images, fused in bricks of voxels on all threads, with the bits of [`crate::Tsdf::integrate`].
//!
//! Most bricks need no look at their voxels: a view sees something before all of them, and tells nothing, or sees far
//! past all of them. Which of both holds is told by the least and the largest depth in squares of pixels.

use core::ops::Range;

use rayon::prelude::*;
use schema::{Camera, DepthImage, Intrinsics, Lattice, Mat3, Pose, Vec3, VoxelGrid};
use wide::f32x4;

use crate::blocks::{CELLS, SurfaceBlocks, VALUES, VOXELS, block_counts};
use crate::seen::{ScaledView, SeenPoint, stride_px};
use crate::tsdf::{stored, truncation_m};

/// Voxels of a brick of a grid along x, y and z; lines along z are the longest runs of memory.
const BRICK: [usize; 3] = [4, 4, 8];
/// Side of a square of pixels.
const TILE_PX: usize = 8;
/// What bounds of bricks are widened by, for rounding: pixels, metres, and metres a metre of depth.
const MARGIN_PX: f32 = 2.0;
const MARGIN_M: f32 = 1e-4;
const MARGIN_SHARE: f32 = 1e-5;
/// About so many pixels along an image's width are looked at for blocks.
pub const COLUMNS_PX: usize = 320;

/// The field of depth images in VGN's values, on all threads: the bits of [`crate::Tsdf::integrate`] and
/// [`crate::Tsdf::to_voxels`]. `truncation_voxels` as in [`crate::Tsdf::new`].
///
/// # Panics
/// If the truncation is not above 0.
#[must_use]
pub fn fuse_images(lattice: impl Into<Lattice>, truncation_voxels: f32, views: &[(Camera, &DepthImage)]) -> VoxelGrid {
    let views: Vec<ScaledView<'_>> = views.iter().map(|(camera, image)| (*camera, *image, 1.0)).collect();
    Sights::new(&views).fuse(lattice.into(), truncation_voxels)
}

/// Views, ready to be fused.
#[derive(Debug)]
pub struct Sights<'a>(Vec<Sight<'a>>);

impl<'a> Sights<'a> {
    /// Looks over images, on all threads.
    #[must_use]
    pub fn new(views: &[ScaledView<'a>]) -> Self {
        Self(views.par_iter().map(Sight::new).collect())
    }

    /// As [`fuse_images`].
    ///
    /// # Panics
    /// If the truncation is not above 0.
    #[must_use]
    pub fn fuse(&self, lattice: Lattice, truncation_voxels: f32) -> VoxelGrid {
        let mut field = VoxelGrid { lattice, values: vec![0.0; lattice.len()] };
        let truncation_m = truncation_m(&lattice, truncation_voxels);
        let [_, width, height] = lattice.counts;
        let slabs = field.values.par_chunks_mut((BRICK[0] * width * height).max(1)).enumerate();
        slabs.for_each_init(Scratch::default, |scratch, (slab, values)| {
            let first = slab * BRICK[0];
            let along_x = first..(first + BRICK[0]).min(lattice.counts[0]);
            let starts = (0..width).step_by(BRICK[1]).flat_map(|j| (0..height).step_by(BRICK[2]).map(move |k| [j, k]));
            for [j, k] in starts {
                let (along_y, along_z) = (j..(j + BRICK[1]).min(width), k..(k + BRICK[2]).min(height));
                let brick = [along_x.clone(), along_y.clone(), along_z.clone()];
                if !scratch.fuse(&self.0, &lattice, &brick, truncation_m) {
                    continue;
                }
                let lines = along_x.clone().flat_map(|i| along_y.clone().map(move |j| [i - first, j]));
                for ([i, j], line) in lines.zip(0..) {
                    let start = (i * width + j) * height;
                    scratch.store(line, &mut values[start + along_z.start..start + along_z.end]);
                }
            }
        });
        field
    }

    /// The same only in blocks near what was seen, elsewhere all voxels are stored as 0; `seen` has each view's points,
    /// of about [`COLUMNS_PX`] pixels along its image.
    ///
    /// # Panics
    /// If the truncation is not above 0.
    #[must_use]
    pub fn fuse_near(&self, lattice: &Lattice, truncation_voxels: f32, seen: &[Vec<SeenPoint>]) -> SurfaceBlocks {
        let truncation_m = truncation_m(lattice, truncation_voxels);
        let mut blocks = SurfaceBlocks::new(*lattice, &self.near_surfaces(lattice, truncation_m, seen));
        let (lattices, values) = blocks.parts_mut();
        let all = [0..VOXELS, 0..VOXELS, 0..VOXELS];
        let parts = values.par_chunks_mut(VALUES).zip(lattices).with_min_len(8);
        parts.for_each_init(Scratch::default, |scratch, (values, lattice)| {
            if scratch.fuse(&self.0, &lattice, &all, truncation_m) {
                values.chunks_mut(VOXELS).enumerate().for_each(|(line, values)| scratch.store(line, values));
            }
        });
        blocks
    }

    /// Of each block of a lattice, whether something was seen within the truncation of it.
    fn near_surfaces(&self, lattice: &Lattice, truncation_m: f32, seen: &[Vec<SeenPoint>]) -> Vec<bool> {
        let counts = block_counts(lattice);
        let block_m = CELLS as f32 * lattice.voxel_size_m;
        let last = Vec3::from_array(counts.map(|count| count as f32));
        let of_view = |(Sight { lens, image, .. }, seen): (&Sight, &Vec<SeenPoint>)| {
            let mut is_near = vec![false; counts.iter().product()];
            let stride = stride_px(image, COLUMNS_PX);
            // A voxel's centre and the ray of its pixel are less than a pixel apart.
            let pixel = (1 + stride) as f32 * (1.0 / lens.fx_px).max(1.0 / lens.fy_px);
            // Neighbouring pixels often show the same blocks.
            let mut before = [[u32::MAX; 3]; 2];
            for (at_m, depth_m) in seen {
                let margin_m = truncation_m + pixel * depth_m;
                // Blocks begin at the centre of the lattice's first voxel; a negative number becomes 0.
                let block = |along_m: f32| (along_m - 0.5 * lattice.voxel_size_m) / block_m;
                let [low, high] = [-margin_m, margin_m].map(|margin_m| (*at_m - lattice.low_m + margin_m).map(block));
                if high.cmplt(Vec3::ZERO).any() || low.cmpge(last).any() {
                    continue;
                }
                let blocks = [low, high].map(|end| end.to_array().map(|block| block as u32));
                if blocks == before {
                    continue;
                }
                before = blocks;
                let [low, high] = blocks.map(|end| end.map(|block| block as usize));
                let [x, y, z] = [0, 1, 2].map(|axis| low[axis]..(high[axis] + 1).min(counts[axis]));
                for (x, y) in x.flat_map(|x| y.clone().map(move |y| (x, y))) {
                    let line = (x * counts[1] + y) * counts[2];
                    is_near[line + z.start..line + z.end].fill(true);
                }
            }
            is_near
        };
        let either = |a: Vec<bool>, b: Vec<bool>| a.iter().zip(b).map(|(a, b)| *a || b).collect();
        let nothing = || vec![false; counts.iter().product()];
        self.0.par_iter().zip(seen).map(of_view).reduce_with(either).unwrap_or_else(nothing)
    }
}

/// The least and the largest depth in squares of an image's pixels.
#[derive(Debug)]
struct Tiles {
    columns: usize,
    /// Minus infinity where a pixel of the square saw nothing.
    least_m: Vec<f32>,
    /// Minus infinity where all of them did.
    largest_m: Vec<f32>,
}

impl Tiles {
    fn new(image: &DepthImage, factor: f32) -> Self {
        let width = image.width_px.max(1);
        let (mut least_m, mut largest_m) = (Vec::new(), Vec::new());
        let (mut low_m, mut high_m) = (vec![0.0; width], vec![0.0; width]);
        for rows in image.depth_m.chunks(TILE_PX * width) {
            low_m.fill(f32::INFINITY);
            high_m.fill(f32::NEG_INFINITY);
            for row in rows.chunks_exact(width) {
                for ((low_m, high_m), depth_m) in low_m.iter_mut().zip(&mut high_m).zip(row) {
                    // False for NaN.
                    let is_seen = (*depth_m > 0.0) & (*depth_m < f32::INFINITY);
                    let seen_m = if is_seen { *depth_m } else { f32::NEG_INFINITY };
                    *low_m = if seen_m < *low_m { seen_m } else { *low_m };
                    *high_m = if seen_m > *high_m { seen_m } else { *high_m };
                }
            }
            let least = |m: &[f32]| m.iter().copied().fold(f32::INFINITY, f32::min) / factor;
            let largest = |m: &[f32]| m.iter().copied().fold(f32::NEG_INFINITY, f32::max) / factor;
            least_m.extend(low_m.chunks(TILE_PX).map(least));
            largest_m.extend(high_m.chunks(TILE_PX).map(largest));
        }
        Self { columns: width.div_ceil(TILE_PX), least_m, largest_m }
    }

    /// The least and the largest depth in a rectangle of pixels, or in a little more.
    fn range_m(&self, [[left, right], [top, bottom]]: [[usize; 2]; 2]) -> [f32; 2] {
        let (mut low_m, mut high_m) = (f32::INFINITY, f32::NEG_INFINITY);
        for row in top / TILE_PX..=bottom / TILE_PX {
            let own = row * self.columns + left / TILE_PX..row * self.columns + right / TILE_PX + 1;
            low_m = self.least_m[own.clone()].iter().copied().fold(low_m, f32::min);
            high_m = self.largest_m[own].iter().copied().fold(high_m, f32::max);
        }
        [low_m, high_m]
    }
}

/// What a view says of a brick's voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Sighting {
    /// Nothing of any.
    Nothing,
    /// All are further before what it sees than the truncation.
    Before,
    /// They must be looked at.
    Mixed,
}

/// A view, ready to be fused.
#[derive(Debug)]
struct Sight<'a> {
    lens: Intrinsics,
    image: &'a DepthImage,
    /// Depths are divided by this.
    factor: f32,
    camera_from_workspace: Pose,
    turn: Mat3,
    /// Squares of the pixels' rays' x by u, and y by v.
    ray_x2: Vec<f32>,
    ray_y2: Vec<f32>,
    tiles: Tiles,
}

impl<'a> Sight<'a> {
    fn new(&(camera, image, factor): &ScaledView<'a>) -> Self {
        let lens = camera.intrinsics;
        let square = |x: f32| x * x;
        let camera_from_workspace = camera.workspace_from_camera.inverse();
        Self {
            lens,
            image,
            factor,
            camera_from_workspace,
            turn: Mat3::from_quat(camera_from_workspace.rotation),
            ray_x2: (0..lens.width_px).map(|u| square(lens.ray([u, 0]).x)).collect(),
            ray_y2: (0..lens.height_px).map(|v| square(lens.ray([0, v]).y)).collect(),
            tiles: Tiles::new(image, factor),
        }
    }

    fn sighting(&self, lattice: &Lattice, brick: &[Range<usize>; 3], truncation_m: f32) -> Sighting {
        let end_m = |end: fn(&Range<usize>) -> usize| lattice.centre_m([0, 1, 2].map(|axis| end(&brick[axis])));
        let [first_m, last_m] = [end_m(|range| range.start), end_m(|range| range.end - 1)];
        let middle_m = self.camera_from_workspace * (0.5 * (first_m + last_m));
        let half_m = 0.5 * (last_m - first_m);
        let halves_m = [self.turn.x_axis * half_m.x, self.turn.y_axis * half_m.y, self.turn.z_axis * half_m.z];
        let reach_m = halves_m.iter().map(|half_m| half_m.z.abs()).sum::<f32>();
        let margin_m = MARGIN_M + MARGIN_SHARE * middle_m.z.abs();
        let [near_m, far_m] = [middle_m.z - reach_m - margin_m, middle_m.z + reach_m + margin_m];
        let [width, height] = [self.lens.width_px.min(self.image.width_px), self.lens.height_px];
        if far_m <= 0.0 || width == 0 || height == 0 {
            return Sighting::Nothing;
        }
        if near_m <= MARGIN_M {
            return Sighting::Mixed;
        }
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for corner in 0..8 {
            let side = |axis: usize| if corner >> axis & 1 == 0 { -halves_m[axis] } else { halves_m[axis] };
            let at_m = middle_m + side(0) + side(1) + side(2);
            let per_m = 1.0 / at_m.z;
            let at_px = [
                at_m.x * self.lens.fx_px * per_m + self.lens.cx_px,
                at_m.y * self.lens.fy_px * per_m + self.lens.cy_px,
            ];
            for axis in 0..2 {
                (low[axis], high[axis]) = (low[axis].min(at_px[axis]), high[axis].max(at_px[axis]));
            }
        }
        let sizes = [width, height].map(|count| count as f32);
        let [low, high] = [low.map(|px| px - MARGIN_PX), high.map(|px| px + MARGIN_PX)];
        if (0..2).any(|axis| high[axis] < 0.0 || low[axis] >= sizes[axis]) {
            return Sighting::Nothing;
        }
        let is_all_inside = (0..2).all(|axis| low[axis] >= 0.0 && high[axis] < sizes[axis]);
        // A negative number rounds to 0.
        let pixels = [0, 1].map(|axis| [low[axis] as usize, high[axis].min(sizes[axis] - 1.0) as usize]);
        let [least_m, largest_m] = self.tiles.range_m(pixels);
        if largest_m - near_m < -truncation_m {
            Sighting::Nothing
        } else if is_all_inside && least_m - far_m > truncation_m * (1.0 + MARGIN_SHARE) {
            Sighting::Before
        } else {
            Sighting::Mixed
        }
    }
}

/// Voxels that are worked on together, whatever the machine's vectors are.
const LANES: usize = 4;
/// Layers that are looked at together, if they have at least this many groups of lines.
const LAYERS: usize = 3;
const WIDE: usize = 16;

/// The voxels of a brick, as one view after the other sees them: layer after layer along z, and in each of them the
/// lines, filled up to whole groups.
#[derive(Default)]
struct Scratch {
    sightings: Vec<Sighting>,
    /// Of each group of lines the x and the y of its voxels, in metres.
    lines_m: Vec<[[f32; LANES]; 2]>,
    /// Where the first voxels of the lattice are on these lines, in a camera's frame, in metres.
    firsts_m: Vec<[f32x4; 3]>,
    /// As in [`crate::Tsdf`].
    voxels: Vec<Voxels>,
}

/// A group's voxels of one layer.
#[derive(Debug, Clone, Copy)]
struct Voxels {
    mean: f32x4,
    weight: f32x4,
}

impl Scratch {
    /// Fuses what views say of a brick's voxels; false if all of them are stored as 0.
    fn fuse(&mut self, sights: &[Sight], lattice: &Lattice, brick: &[Range<usize>; 3], truncation_m: f32) -> bool {
        self.sightings.clear();
        self.sightings.extend(sights.iter().map(|sight| sight.sighting(lattice, brick, truncation_m)));
        // What is before everything seen, or behind it, is stored as 0.
        if !self.sightings.contains(&Sighting::Mixed) {
            return false;
        }
        self.set_lines(lattice, brick);
        self.voxels.clear();
        let nothing = Voxels { mean: f32x4::ZERO, weight: f32x4::ZERO };
        self.voxels.resize(self.lines_m.len() * brick[2].len(), nothing);
        for (place, sight) in sights.iter().enumerate() {
            match self.sightings[place] {
                Sighting::Nothing => {}
                Sighting::Before => self.voxels.iter_mut().for_each(Voxels::add_before),
                Sighting::Mixed => self.add(sight, lattice, brick, truncation_m),
            }
        }
        true
    }

    /// Adds what a view says of the voxels; of wide layers first a few together are looked at as a brick of their own.
    fn add(&mut self, sight: &Sight, lattice: &Lattice, [x, y, z]: &[Range<usize>; 3], truncation_m: f32) {
        self.place(sight, lattice.centre_m([0; 3]).z);
        let step_m = sight.camera_from_workspace.rotation * Vec3::new(0.0, 0.0, lattice.voxel_size_m);
        let lines = self.lines_m.len();
        for (first, layers) in z.clone().step_by(LAYERS).zip(self.voxels.chunks_mut(LAYERS * lines)) {
            let part = [x.clone(), y.clone(), first..(first + LAYERS).min(z.end)];
            let is_wide = lines >= WIDE;
            match if is_wide { sight.sighting(lattice, &part, truncation_m) } else { Sighting::Mixed } {
                Sighting::Nothing => {}
                Sighting::Before => layers.iter_mut().for_each(Voxels::add_before),
                Sighting::Mixed => {
                    for (k, layer) in (first..).zip(layers.chunks_mut(lines)) {
                        let up_m = step_m * (k as u32 as f32);
                        for (first_m, voxels) in self.firsts_m.iter().zip(layer) {
                            let at_m = [0, 1, 2].map(|axis| first_m[axis] + f32x4::splat(up_m[axis]));
                            sight.add(at_m, truncation_m, voxels);
                        }
                    }
                }
            }
        }
    }

    /// The stored values of the voxels of a line.
    fn store(&self, line: usize, values: &mut [f32]) {
        let (group, lane) = (line / LANES, line % LANES);
        for (value, voxels) in values.iter_mut().zip(self.voxels[group..].iter().step_by(self.lines_m.len())) {
            *value = stored(voxels.mean.to_array()[lane], voxels.weight.to_array()[lane]);
        }
    }

    fn set_lines(&mut self, lattice: &Lattice, [x, y, _]: &[Range<usize>; 3]) {
        self.lines_m.clear();
        self.lines_m.resize((x.len() * y.len()).div_ceil(LANES), [[0.0; LANES]; 2]);
        let lines = x.clone().flat_map(|i| y.clone().map(move |j| [i, j]));
        for (line, [i, j]) in lines.enumerate() {
            let centre_m = lattice.centre_m([i, j, 0]);
            let [x_m, y_m] = &mut self.lines_m[line / LANES];
            (x_m[line % LANES], y_m[line % LANES]) = (centre_m.x, centre_m.y);
        }
    }

    /// Where the lines begin in a view's frame.
    fn place(&mut self, sight: &Sight, first_z_m: f32) {
        self.firsts_m.clear();
        self.firsts_m.extend(self.lines_m.iter().map(|[x_m, y_m]| {
            // Without branches, which the compiler vectorises.
            let mut firsts_m = [[0.0; LANES]; 3];
            for lane in 0..LANES {
                let first_m = sight.camera_from_workspace * Vec3::new(x_m[lane], y_m[lane], first_z_m);
                (0..3).for_each(|axis| firsts_m[axis][lane] = first_m[axis]);
            }
            firsts_m.map(f32x4::new)
        }));
    }
}

impl Voxels {
    /// Adds a view that sees nothing nearer than the truncation behind them.
    fn add_before(&mut self) {
        self.add(f32x4::ONE, f32x4::ONE);
    }

    /// Adds a view's distance, in truncations, where `near` is 1.
    #[inline(always)]
    fn add(&mut self, distance: f32x4, near: f32x4) {
        let fused = (self.mean * self.weight + distance) / (self.weight + f32x4::ONE);
        self.mean = near.simd_gt(f32x4::ZERO).bitselect(fused, self.mean);
        self.weight += near;
    }
}

impl Sight<'_> {
    /// Adds what the view says of voxels at places in its frame; the arithmetic of [`Intrinsics::project`].
    #[inline(always)]
    fn add(&self, [x_m, y_m, z_m]: [f32x4; 3], truncation_m: f32, voxels: &mut Voxels) {
        let (lens, splat) = (&self.lens, f32x4::splat);
        let half = splat(0.5);
        let u = x_m * splat(lens.fx_px) / z_m + splat(lens.cx_px) + half;
        let v = y_m * splat(lens.fy_px) / z_m + splat(lens.cy_px) + half;
        let is_in_u = u.simd_ge(f32x4::ZERO) & u.simd_lt(splat(lens.width_px as f32));
        let is_in_v = v.simd_ge(f32x4::ZERO) & v.simd_lt(splat(lens.height_px as f32));
        let is_in = z_m.simd_gt(f32x4::ZERO) & is_in_u & is_in_v;
        if !is_in.any() {
            return;
        }
        // Pixels outside become the first one, which does not count.
        let [us, vs] = [u & is_in, v & is_in].map(|px| px.fast_trunc_int().to_array().map(|px| px as u32 as usize));
        let (mut depth_m, mut ray2) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            depth_m[lane] = self.image.depth_m[vs[lane] * self.image.width_px + us[lane]];
            ray2[lane] = self.ray_x2[us[lane]] + self.ray_y2[vs[lane]] + 1.0;
        }
        let (depth_m, ray2) = (f32x4::new(depth_m) / splat(self.factor), f32x4::new(ray2));
        let distance_m = (depth_m - z_m) * ray2.sqrt();
        let is_near = distance_m.simd_gt(splat(-truncation_m)) & distance_m.simd_lt(splat(f32::INFINITY));
        let near = is_in & is_near & depth_m.simd_gt(f32x4::ZERO) & f32x4::ONE;
        voxels.add((distance_m * splat(1.0 / truncation_m)).fast_min(f32x4::ONE), near);
    }
}
