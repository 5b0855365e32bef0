//! Renders a point cloud as the depth image of a camera at the cloud's viewpoint. A cloud thereby becomes a
//! [`crate::Tsdf`] by the same code that fuses depth images.

use schema::{Camera, DepthImage, Grid, Intrinsics, Lattice, Pose, Vec3, View};

/// Pixels along each side of the image.
const SIDE_PX: usize = 480;
/// The image is wider than the projected points by this factor.
const MARGIN: f32 = 1.02;
/// A point is drawn as a disc of this radius, in spacings of the cloud: from 0.71 a square lattice has no holes.
const DISC_SPACINGS: f32 = 0.8;

/// Cameras that look at wide tables stand no nearer than this to their middle.
pub const NEAR_M: f32 = 0.3;

/// The pose of a camera at a point that looks at the middle of a lattice's floor, image up towards workspace up.
///
/// `None` if the eye is closer to that middle than a small lattice is wide (then much of it would lie behind the
/// camera) or than [`NEAR_M`], below the floor, or not finite.
#[must_use]
pub fn view_from(eye_m: Vec3, lattice: &Lattice) -> Option<Pose> {
    let [low_m, high_m] = lattice.corners_m();
    let middle_m = (0.5 * (low_m + high_m)).with_z(low_m.z);
    let (off, wide_m) = (eye_m - middle_m, (high_m - low_m).truncate().max_element());
    let radius_m = off.length();
    // False for NaN.
    if !(radius_m >= wide_m.min(NEAR_M) && radius_m < 1e3 && off.z >= 0.0) {
        return None;
    }
    let polar_rad = libm::acosf((off.z / radius_m).clamp(-1.0, 1.0));
    let view = View { radius_m, polar_rad, azimuth_rad: libm::atan2f(off.y, off.x) };
    let mut pose = view.workspace_from_camera(&Grid::PAPER);
    pose.translation += middle_m - Vec3::new(0.5, 0.5, 0.0) * Grid::PAPER.size_m;
    Some(pose)
}

/// The depth image of a cloud whose points are about `spacing_m` apart, by a camera at a pose, and that camera.
///
/// Each point is a disc that faces the camera. The depth of a pixel is the weighted mean over the discs on it that are
/// close to the nearest one; weights fall with the distance to the pixel. The nearest disc alone would shift every
/// oblique surface towards the eye.
#[must_use]
pub fn cloud_image(points_m: &[Vec3], workspace_from_camera: Pose, spacing_m: f32) -> (Camera, DepthImage) {
    let camera_from_workspace = workspace_from_camera.inverse();
    let seen_m: Vec<Vec3> = points_m.iter().map(|point| camera_from_workspace * *point).filter(|p| p.z > 0.0).collect();
    let camera = Camera { intrinsics: lens(&seen_m), workspace_from_camera };
    let disc_m = DISC_SPACINGS * spacing_m;
    let mut nearest_m = vec![f32::INFINITY; SIDE_PX * SIDE_PX];
    for seen in &seen_m {
        on_disc(&camera.intrinsics, *seen, disc_m, |pixel, _| nearest_m[pixel] = nearest_m[pixel].min(seen.z));
    }
    let mut sums = vec![[0.0_f32; 2]; SIDE_PX * SIDE_PX];
    for seen in &seen_m {
        on_disc(&camera.intrinsics, *seen, disc_m, |pixel, weight| {
            // Two discs of a surface seen at 70 degrees from its normal are this far apart in depth.
            if seen.z - nearest_m[pixel] < 5.0 * disc_m {
                sums[pixel] = [sums[pixel][0] + weight, sums[pixel][1] + weight * seen.z];
            }
        });
    }
    let depth_m = sums.into_iter().map(|[weight, sum]| if weight > 0.0 { sum / weight } else { 0.0 }).collect();
    (camera, DepthImage { width_px: SIDE_PX, height_px: SIDE_PX, depth_m })
}

/// A lens that covers the points, but at most a right angle.
fn lens(seen_m: &[Vec3]) -> Intrinsics {
    let widest = seen_m.iter().map(|p| (p.x.abs().max(p.y.abs())) / p.z).fold(0.0, f32::max);
    let half_px = 0.5 * SIDE_PX as f32;
    let focal_px = (half_px / (MARGIN * widest)).clamp(half_px, 8.0 * half_px);
    Intrinsics {
        width_px: SIDE_PX,
        height_px: SIDE_PX,
        fx_px: focal_px,
        fy_px: focal_px,
        cx_px: half_px,
        cy_px: half_px,
    }
}

/// Visits the pixels of a disc that faces the camera; the weight is 1 at its centre and 0 at its rim.
fn on_disc(lens: &Intrinsics, seen_m: Vec3, radius_m: f32, mut visit: impl FnMut(usize, f32)) {
    let radius_px = (radius_m * lens.fx_px / seen_m.z).clamp(0.71, 0.1 * SIDE_PX as f32);
    let [u, v] = [seen_m.x * lens.fx_px / seen_m.z + lens.cx_px, seen_m.y * lens.fy_px / seen_m.z + lens.cy_px];
    let span = |middle: f32| {
        let low = (middle - radius_px).ceil().max(0.0) as usize;
        let high = (middle + radius_px).floor();
        low..if high < 0.0 { 0 } else { (high as usize + 1).min(SIDE_PX) }
    };
    for y in span(v) {
        for x in span(u) {
            let (dx, dy) = (x as f32 - u, y as f32 - v);
            let weight = 1.0 - (dx * dx + dy * dy) / (radius_px * radius_px);
            if weight > 0.0 {
                visit(y * SIDE_PX + x, weight);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TRUNCATION_VOXELS, Tsdf, camera_at, surface_cloud};

    #[test]
    fn an_eye_and_its_view_are_the_same_place() {
        let wide = Lattice { low_m: Vec3::new(-0.3, -0.2, 0.0), counts: [80, 40, 30], ..Grid::PAPER.into() };
        for eye in [Vec3::new(0.15, 0.15, 0.6), Vec3::new(0.5, -0.2, 0.4), Vec3::new(-0.3, 0.1, 0.0)] {
            let pose = view_from(eye, &Grid::PAPER.into()).unwrap();
            assert!((pose.translation - eye).length() < 1e-5, "{eye}");
            let middle = pose.inverse() * Vec3::new(0.15, 0.15, 0.0);
            assert!(middle.truncate().length() < 1e-5 && middle.z > 0.0, "{middle}");
            let eye = eye + Vec3::new(-0.15, -0.2, 0.6);
            let middle = view_from(eye, &wide).unwrap().inverse() * Vec3::new(0.0, -0.05, 0.0);
            assert!(middle.truncate().length() < 1e-5 && middle.z > 0.0, "{middle}");
        }
        for eye in [Vec3::new(0.15, 0.15, 0.1), Vec3::new(0.15, 0.5, -0.1), Vec3::NAN, Vec3::splat(1e9)] {
            assert_eq!(view_from(eye, &Grid::PAPER.into()), None, "{eye}");
        }
    }

    #[test]
    fn a_surface_is_where_it_was_from_however_oblique_and_near_an_eye() {
        let grid = Grid::PAPER;
        let table: Vec<Vec3> =
            (0..14_400).map(|n| Vec3::new((n / 120) as f32 * 0.0025, (n % 120) as f32 * 0.0025, 0.05)).collect();
        for (polar_rad, radius_m) in
            [(0.0, 0.6), (0.5, 0.6), (0.8, 0.6), (1.05, 0.6), (0.5, 0.36), (0.8, 0.31), (0.5, 3.0)]
        {
            let view = View { radius_m, polar_rad, azimuth_rad: 0.4 };
            let pose = camera_at(&view, &grid, Intrinsics::VGN).workspace_from_camera;
            let (camera, image) = cloud_image(&table, pose, 0.0025);
            let (mut errors_m, mut inside) = (Vec::new(), 0);
            for pixel in (0..SIDE_PX * SIDE_PX).map(|p| [p % SIDE_PX, p / SIDE_PX]) {
                let ray = camera.workspace_from_camera.rotation * camera.intrinsics.ray(pixel);
                let eye = camera.workspace_from_camera.translation;
                let exact_m = (0.05 - eye.z) / ray.z;
                let hit = eye + ray * exact_m;
                // Away from the table's rim.
                if exact_m > 0.0 && (hit.truncate() - Vec3::splat(0.15).truncate()).abs().max_element() < 0.12 {
                    inside += 1;
                    errors_m.extend(image.at(pixel).map(|seen_m| ((seen_m - exact_m) * ray.z).abs()));
                }
            }
            assert_eq!(errors_m.len(), inside, "holes from {polar_rad} rad, {radius_m} m");
            let mean_m = errors_m.iter().sum::<f32>() / inside as f32;
            assert!(inside > 1_000 && mean_m < 0.25e-3, "{:.2} mm from {polar_rad} rad, {radius_m} m", mean_m * 1e3);
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
        let pose = view_from(Vec3::new(0.15, 0.15, 0.6), &grid.into()).unwrap();
        let (camera, image) = cloud_image(&cloud, pose, 0.0025);
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
