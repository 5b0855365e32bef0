//! A point cloud seen again: the depth image that a camera would have taken where the cloud was seen from. So a cloud becomes a
//! [`crate::Tsdf`] by the very code that fuses depth images.

use schema::{Camera, DepthImage, Grid, Intrinsics, Vec3, View};

use crate::camera_at;

/// Pixels along each side of the image.
const SIDE_PX: usize = 480;
/// The image is this much wider than the workspace's surrounding ball.
const MARGIN: f32 = 1.05;
/// A point stands for a disc of this radius, in spacings of the cloud: a square lattice leaves no hole from 0.71 on.
const DISC_SPACINGS: f32 = 0.8;

/// The view from a point: on a sphere about the middle of the workspace's floor, looking at it.
///
/// `None` if the eye is nearer to that than the workspace is wide (then parts of it would lie behind the camera), below the floor, or not a
/// finite point.
#[must_use]
pub fn view_from(eye_m: Vec3, grid: &Grid) -> Option<View> {
    let off = eye_m - Vec3::new(0.5 * grid.size_m, 0.5 * grid.size_m, 0.0);
    let radius_m = off.length();
    // False for what is no number.
    if !(radius_m >= grid.size_m && radius_m < 1e3 && off.z >= 0.0) {
        return None;
    }
    let polar_rad = libm::acosf((off.z / radius_m).clamp(-1.0, 1.0));
    Some(View { radius_m, polar_rad, azimuth_rad: libm::atan2f(off.y, off.x) })
}

/// The depth image of a cloud whose points are about `spacing_m` apart, and the camera that takes it; the nearest surface
/// counts in each pixel.
#[must_use]
pub fn cloud_image(points_m: &[Vec3], view: &View, grid: &Grid, spacing_m: f32) -> (Camera, DepthImage) {
    let camera = camera_at(view, grid, lens(view, grid));
    let camera_from_workspace = camera.workspace_from_camera.inverse();
    let mut image =
        DepthImage { width_px: SIDE_PX, height_px: SIDE_PX, depth_m: vec![0.0; SIDE_PX * SIDE_PX] };
    for point in points_m {
        let seen = camera_from_workspace * *point;
        if seen.z > 0.0 {
            draw_disc(&mut image, &camera.intrinsics, seen, DISC_SPACINGS * spacing_m);
        }
    }
    (camera, image)
}

/// A lens that sees the ball around the workspace.
fn lens(view: &View, grid: &Grid) -> Intrinsics {
    // The workspace's corners are at most this far from the middle of its floor.
    let ball_m = 1.225 * grid.size_m * MARGIN;
    let (half_px, eye_m) = (0.5 * SIDE_PX as f32, view.radius_m.max(1.01 * ball_m));
    let focal_px = half_px * (eye_m * eye_m - ball_m * ball_m).sqrt() / ball_m;
    Intrinsics {
        width_px: SIDE_PX,
        height_px: SIDE_PX,
        fx_px: focal_px,
        fy_px: focal_px,
        cx_px: half_px,
        cy_px: half_px,
    }
}

/// A disc that faces the camera.
fn draw_disc(image: &mut DepthImage, lens: &Intrinsics, seen_m: Vec3, radius_m: f32) {
    let radius_px = (radius_m * lens.fx_px / seen_m.z).clamp(0.5, 0.1 * SIDE_PX as f32);
    let [u, v] = [seen_m.x * lens.fx_px / seen_m.z + lens.cx_px, seen_m.y * lens.fy_px / seen_m.z + lens.cy_px];
    let span = |middle: f32| {
        let low = (middle - radius_px).ceil().max(0.0) as usize;
        let high = (middle + radius_px).floor();
        low..if high < 0.0 { 0 } else { (high as usize + 1).min(SIDE_PX) }
    };
    for y in span(v) {
        for x in span(u) {
            let (dx, dy) = (x as f32 - u, y as f32 - v);
            let slot = &mut image.depth_m[y * SIDE_PX + x];
            if dx * dx + dy * dy <= radius_px * radius_px && (*slot == 0.0 || seen_m.z < *slot) {
                *slot = seen_m.z;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TRUNCATION_VOXELS, Tsdf, surface_cloud};

    #[test]
    fn an_eye_and_its_view_are_the_same_place() {
        let grid = Grid::PAPER;
        for eye in [Vec3::new(0.15, 0.15, 0.6), Vec3::new(0.5, -0.2, 0.4), Vec3::new(-0.3, 0.1, 0.0)] {
            let view = view_from(eye, &grid).unwrap();
            let camera = camera_at(&view, &grid, Intrinsics::VGN);
            assert!((camera.workspace_from_camera.translation - eye).length() < 1e-5, "{eye}");
        }
        for eye in [Vec3::new(0.15, 0.15, 0.1), Vec3::new(0.15, 0.5, -0.1), Vec3::NAN, Vec3::splat(1e9)] {
            assert_eq!(view_from(eye, &grid), None, "{eye}");
        }
    }

    #[test]
    fn every_corner_of_the_workspace_is_in_the_image() {
        let grid = Grid::PAPER;
        for eye in [Vec3::new(0.15, 0.15, 0.31), Vec3::new(0.6, 0.5, 0.4), Vec3::new(3.0, 0.0, 3.0)] {
            let view = view_from(eye, &grid).unwrap();
            let camera = camera_at(&view, &grid, lens(&view, &grid));
            for corner in 0..8 {
                let at = Vec3::new((corner & 1) as f32, (corner >> 1 & 1) as f32, (corner >> 2) as f32) * grid.size_m;
                let seen = camera.workspace_from_camera.inverse() * at;
                // Straight above and low, the upper corners are beside the camera.
                assert!(seen.z < 0.1 || camera.intrinsics.project(seen).is_some(), "{eye}: {at}");
            }
        }
    }

    /// A table and a box on it, as points: fused again, their surface is where it was.
    #[test]
    fn a_cloud_comes_back_as_the_surface_it_was() {
        let grid = Grid::PAPER;
        let lattice = |n: i32| (0..n).flat_map(move |i| (0..n).map(move |j| [i as f32 * 0.0025, j as f32 * 0.0025]));
        let table = lattice(120).map(|[x, y]| Vec3::new(x, y, 0.05));
        let top = lattice(24).map(|[x, y]| Vec3::new(0.12 + x, 0.12 + y, 0.1));
        let cloud: Vec<Vec3> = table.chain(top).collect();
        let view = view_from(Vec3::new(0.15, 0.15, 0.6), &grid).unwrap();
        let (camera, image) = cloud_image(&cloud, &view, &grid, 0.0025);
        let mut tsdf = Tsdf::new(grid, TRUNCATION_VOXELS);
        tsdf.integrate(&camera, |pixel| image.at(pixel));
        let surface = surface_cloud(&tsdf.to_voxels(), 0.0025);
        let (on_top, on_table): (Vec<Vec3>, Vec<Vec3>) = surface
            .into_iter()
            .filter(|p| (p.x - 0.15).abs().max((p.y - 0.15).abs()) < 0.02 || (p.x - 0.15).abs() > 0.06)
            .partition(|p| p.z > 0.075);
        assert!(on_top.len() > 200 && on_table.len() > 3_000, "{}, {}", on_top.len(), on_table.len());
        for point in on_top {
            assert!((point.z - 0.1).abs() < 1e-3, "{point}");
        }
        for point in on_table {
            assert!((point.z - 0.05).abs() < 1e-3, "{point}");
        }
    }
}
