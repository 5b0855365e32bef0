//! Corrects a camera's depth scale by the table, whose height in the workspace is known.
//!
//! Depth sensors have scale errors (Dex-Net's model and GIGA's: a factor of 1 ± 3 %, two centimetres at 0.6 m). All
//! depths of a view share the factor, and most of the surroundings of the objects are table. The factor is therefore
//! the most frequent ratio of the observed depth to the depth of a bare table.

use rayon::prelude::*;
use schema::{Camera, DepthImage, Grid, Quat, Vec3};
use wide::f32x4;

/// Factors are searched within this distance of 1 …
const FACTOR_REACH: f32 = 0.15;
/// … in steps of this …
const STEP: f32 = 0.000_5;
/// … over a window of this many steps.
const WINDOW: usize = 12;
/// Only every this many rows and columns are used.
const STRIDE_PX: usize = 2;
/// Fewest rows of a thread.
const ROWS_MIN: usize = 40;
/// Minimum share of table pixels among those that could see it.
const SHARE_MIN: f32 = 0.1;

/// The table near the workspace: the lower and the upper corner, of which x and y count, and its height, in metres.
pub type TableArea = ([Vec3; 2], f32);

/// The table around a grid's workspace, half as wide again to each side.
#[must_use]
pub fn table_around(grid: &Grid) -> TableArea {
    ([-0.5, 1.5].map(|share| Vec3::splat(share * grid.size_m)), grid.table_z_m)
}

/// The factor by which depths are too long, so that most of them lie on the table; 1 if too little of it was seen.
#[must_use]
pub fn depth_factor(image: &DepthImage, camera: &Camera, table: &TableArea) -> f32 {
    let bins = (2.0 * FACTOR_REACH / STEP) as usize;
    let (mut counts, mut sums) = (vec![0_u32; bins], vec![0.0_f64; bins]);
    let mut seen = 0_u32;
    for row in ratios(image, camera, table) {
        for ratio in row.into_iter().filter(|ratio| !ratio.is_nan()) {
            seen += 1;
            let bin = (ratio - 1.0 + FACTOR_REACH) / STEP;
            if bin >= 0.0 && (bin as usize) < bins {
                counts[bin as usize] += 1;
                sums[bin as usize] += f64::from(ratio);
            }
        }
    }
    let count = |first: usize| counts[first..first + WINDOW].iter().sum::<u32>();
    let best = (0..=bins - WINDOW).fold(0, |best, first| if count(first) > count(best) { first } else { best });
    let sum: f64 = sums[best..best + WINDOW].iter().sum();
    if count(best) as f32 > SHARE_MIN * seen as f32 { (sum / f64::from(count(best))) as f32 } else { 1.0 }
}

/// Ratios of the observed depth to that of a bare table, row by row, for pixels whose rays meet it in or near the
/// workspace; NaN for others.
fn ratios(image: &DepthImage, camera: &Camera, table: &TableArea) -> Vec<Vec<f32>> {
    let (pose, lens, ([low_m, high_m], z_m)) = (camera.workspace_from_camera, camera.intrinsics, *table);
    let (eye_m, splat) = (pose.translation, f32x4::splat);
    let (fall_m, none) = (splat(z_m - eye_m.z), splat(f32::NAN));
    let rays_x: Vec<f32> = (0..image.width_px).step_by(STRIDE_PX).map(|u| lens.ray([u, 0]).x).collect();
    let ratio = |ray_x: f32x4, ray_y: f32, depth_m: f32x4| {
        let [x, y, z] = turned(pose.rotation, ray_x, ray_y);
        let table_m = fall_m / z;
        let (at_x, at_y) = (splat(eye_m.x) + x * table_m, splat(eye_m.y) + y * table_m);
        let is_seen = depth_m.simd_gt(f32x4::ZERO) & depth_m.simd_lt(splat(f32::INFINITY));
        let is_near_x = at_x.simd_ge(splat(low_m.x)) & at_x.simd_lt(splat(high_m.x));
        let is_near_y = at_y.simd_ge(splat(low_m.y)) & at_y.simd_lt(splat(high_m.y));
        let is_meant = is_seen & table_m.simd_gt(f32x4::ZERO) & is_near_x & is_near_y;
        is_meant.bitselect(depth_m / table_m, none).to_array()
    };
    let of_row = |v: usize| {
        let row = &image.depth_m[v * image.width_px..(v + 1) * image.width_px];
        let depths_m: Vec<f32> = row.iter().step_by(STRIDE_PX).copied().collect();
        let ray_y = lens.ray([0, v]).y;
        let ((rays, rest), (depths_m, rest_m)) = (rays_x.as_chunks::<4>(), depths_m.as_chunks::<4>());
        let groups = rays.iter().zip(depths_m);
        let mut ratios: Vec<f32> =
            groups.flat_map(|(ray_x, depth_m)| ratio(f32x4::new(*ray_x), ray_y, f32x4::new(*depth_m))).collect();
        let one = |ray_x: f32, depth_m: f32| ratio(splat(ray_x), ray_y, splat(depth_m))[0];
        ratios.extend(rest.iter().zip(rest_m).map(|(ray_x, depth_m)| one(*ray_x, *depth_m)));
        ratios
    };
    let rows: Vec<usize> = (0..image.height_px).step_by(STRIDE_PX).collect();
    rows.par_iter().with_min_len(ROWS_MIN).map(|v| of_row(*v)).collect()
}

/// Rays through four pixels of a row, turned: to the bit as `rotation * ray`.
#[inline(always)]
fn turned(rotation: Quat, ray_x: f32x4, ray_y: f32) -> [f32x4; 3] {
    let (splat, axis, w) = (f32x4::splat, Vec3::new(rotation.x, rotation.y, rotation.z), rotation.w);
    let (y, along) = (splat(ray_y), splat(w * w - axis.dot(axis)));
    let double = (ray_x * splat(axis.x) + splat(ray_y * axis.y) + splat(axis.z)) * splat(2.0);
    let cross = [
        splat(axis.y - ray_y * axis.z),
        splat(axis.z) * ray_x - splat(axis.x),
        splat(axis.x * ray_y) - ray_x * splat(axis.y),
    ];
    let (own, twice) = ([ray_x, y, f32x4::ONE], splat(w * 2.0));
    [0, 1, 2].map(|at| own[at] * along + splat(axis[at]) * double + cross[at] * twice)
}

#[cfg(test)]
mod tests {
    use schema::{Intrinsics, View};

    use super::*;
    use crate::camera_at;

    /// A table with a block that hides a part of it; all depths are `factor` times too long.
    fn view(factor: f32, block: bool) -> (DepthImage, Camera) {
        let grid = Grid::PAPER;
        let view = View { radius_m: 0.6, polar_rad: 1.0, azimuth_rad: 0.3 };
        let camera = camera_at(&view, &grid, Intrinsics::VGN);
        let pose = camera.workspace_from_camera;
        let depth = |n: usize| {
            let pixel = [n % 640, n / 640];
            let ray = pose.rotation * camera.intrinsics.ray(pixel);
            let table_m = (grid.table_z_m - pose.translation.z) / ray.z;
            let hidden = block && (240..400).contains(&pixel[0]) && (160..320).contains(&pixel[1]);
            factor * if hidden { 0.45 + 1e-4 * pixel[1] as f32 } else { table_m.clamp(0.0, 3.0) }
        };
        let image = DepthImage { width_px: 640, height_px: 480, depth_m: (0..640 * 480).map(depth).collect() };
        (image, camera)
    }

    #[test]
    fn the_factor_is_found_beside_and_around_things() {
        for factor in [0.93, 0.99, 1.0, 1.04, 1.1] {
            let (image, camera) = view(factor, true);
            let found = depth_factor(&image, &camera, &table_around(&Grid::PAPER));
            assert!((found / factor - 1.0).abs() < 1e-3, "{factor}: {found}");
        }
    }

    #[test]
    fn rays_are_turned_to_the_bit_as_one_at_a_time() {
        let (image, camera) = view(1.0, false);
        let (lens, rotation) = (camera.intrinsics, camera.workspace_from_camera.rotation);
        for pixel in (0..image.depth_m.len()).step_by(7) {
            let ray = lens.ray([pixel % 640, pixel / 640]);
            let of_four = turned(rotation, f32x4::splat(ray.x), ray.y).map(|along| along.to_array()[3].to_bits());
            assert_eq!(of_four, (rotation * ray).to_array().map(f32::to_bits));
        }
    }

    #[test]
    fn without_a_table_nothing_is_changed() {
        let (mut blind, camera) = view(1.05, false);
        for depth_m in [0.3, 0.0] {
            blind.depth_m.fill(depth_m);
            assert_eq!(depth_factor(&blind, &camera, &table_around(&Grid::PAPER)), 1.0);
        }
    }
}
