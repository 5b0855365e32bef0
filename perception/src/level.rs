//! Corrects a camera's depth scale by the table, whose height in the workspace is known.
//!
//! Depth sensors have scale errors (Dex-Net's model and GIGA's: a factor of 1 ± 3 %, two centimetres at 0.6 m). All
//! depths of a view share the factor, and most of the surroundings of the objects are table. The factor is therefore
//! the most frequent ratio of the observed depth to the depth of a bare table.

use schema::{Camera, DepthImage, Grid, Vec3};

/// Factors are searched within this distance of 1 …
const FACTOR_REACH: f32 = 0.15;
/// … in steps of this …
const STEP: f32 = 0.000_5;
/// … over a window of this many steps.
const WINDOW: usize = 12;
/// Only every this many rows and columns are used.
const STRIDE_PX: usize = 2;
/// Minimum share of table pixels among those that could see it.
const SHARE_MIN: f32 = 0.1;

/// The table near the workspace: the lower and the upper corner, of which x and y count, and its height, in metres.
pub type TableArea = ([Vec3; 2], f32);

/// The table around a grid's workspace, half as wide again to each side.
#[must_use]
pub fn table_around(grid: &Grid) -> TableArea {
    ([-0.5, 1.5].map(|share| Vec3::splat(share * grid.size_m)), grid.table_z_m)
}

/// The image with its depths scaled so that most of them lie on the table, and the factor by which they were too long;
/// unchanged if the table cannot be identified.
#[must_use]
pub fn scaled_to_table(image: &DepthImage, camera: &Camera, table: &TableArea) -> (DepthImage, f32) {
    let factor = table_factor(image, camera, table).unwrap_or(1.0);
    (DepthImage { depth_m: image.depth_m.iter().map(|depth_m| depth_m / factor).collect(), ..*image }, factor)
}

/// The factor by which the table's depths are too long, or `None` if too little of the table was seen.
fn table_factor(image: &DepthImage, camera: &Camera, table: &TableArea) -> Option<f32> {
    let bins = (2.0 * FACTOR_REACH / STEP) as usize;
    let (mut counts, mut sums) = (vec![0_u32; bins], vec![0.0_f64; bins]);
    let mut seen = 0_u32;
    for ratio in ratios(image, camera, table) {
        seen += 1;
        let bin = (ratio - 1.0 + FACTOR_REACH) / STEP;
        if bin >= 0.0 && (bin as usize) < bins {
            counts[bin as usize] += 1;
            sums[bin as usize] += f64::from(ratio);
        }
    }
    let count = |first: usize| counts[first..first + WINDOW].iter().sum::<u32>();
    let best = (0..=bins - WINDOW).reduce(|best, first| if count(first) > count(best) { first } else { best })?;
    let sum: f64 = sums[best..best + WINDOW].iter().sum();
    (count(best) as f32 > SHARE_MIN * seen as f32).then(|| (sum / f64::from(count(best))) as f32)
}

/// Ratio of the observed depth to that of a bare table, for pixels whose rays meet it in or near the workspace.
fn ratios<'a>(image: &'a DepthImage, camera: &Camera, table: &TableArea) -> impl Iterator<Item = f32> + use<'a> {
    let (pose, lens, ([low_m, high_m], z_m)) = (camera.workspace_from_camera, camera.intrinsics, *table);
    let pixels = (0..image.height_px)
        .step_by(STRIDE_PX)
        .flat_map(move |v| (0..image.width_px).step_by(STRIDE_PX).map(move |u| [u, v]));
    pixels.filter_map(move |pixel| {
        let depth_m = image.at(pixel).filter(|depth_m| depth_m.is_finite())?;
        let ray: Vec3 = pose.rotation * lens.ray(pixel);
        let table_m = (z_m - pose.translation.z) / ray.z;
        let at = pose.translation + ray * table_m;
        let is_near = table_m > 0.0 && (low_m.x..high_m.x).contains(&at.x) && (low_m.y..high_m.y).contains(&at.y);
        is_near.then_some(depth_m / table_m)
    })
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
            let found = table_factor(&image, &camera, &table_around(&Grid::PAPER)).unwrap();
            assert!((found / factor - 1.0).abs() < 1e-3, "{factor}: {found}");
        }
        let ((crooked, camera), (straight, _)) = (view(1.05, true), view(1.0, true));
        let (put_right, factor) = scaled_to_table(&crooked, &camera, &table_around(&Grid::PAPER));
        assert!((factor / 1.05 - 1.0).abs() < 1e-3);
        for (a, b) in put_right.depth_m.iter().zip(&straight.depth_m) {
            assert!((a - b).abs() < 1e-3 * b.max(1e-3), "{a} {b}");
        }
    }

    #[test]
    fn without_a_table_nothing_is_changed() {
        let (mut blind, camera) = view(1.05, false);
        for depth_m in [0.3, 0.0] {
            blind.depth_m.fill(depth_m);
            assert_eq!(scaled_to_table(&blind, &camera, &table_around(&Grid::PAPER)), (blind.clone(), 1.0));
        }
    }
}
