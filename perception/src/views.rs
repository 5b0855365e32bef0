//! Camera poses: on a sphere about the centre of the workspace's floor, looking at it.

use schema::{Camera, Grid, Intrinsics, Stream, View, ViewParams};
use serde::Serialize;
use settings::settings;

settings! {
    /// A kind of observation, such as one camera at the side. The azimuth of the first view is uniform.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct ViewKind {
        /// Share of the scenes that are seen so.
        pub share: f32 where 0.0..=1.0,
        /// Fewest and most views of a scene; uniform.
        pub counts: [usize; 2] where 1..=100,
        /// Shortest and longest distance from the middle of the floor, in sides of the workspace; uniform.
        pub radius_sizes: [f32; 2] where 0.5..=100.0,
        /// Smallest and largest angle from the vertical; uniform.
        pub polar_rad: [f32; 2] where 0.0..=core::f32::consts::FRAC_PI_2,
        /// Whether the views stand evenly around the scene, such as two opposite each other.
        pub around: bool,
    }
}

/// Draws the views of a scene that is seen in one of some kinds, or as `rest` says if their shares leave it.
#[must_use]
pub fn draw_kind(rest: &ViewParams, kinds: &[ViewKind], grid: &Grid, stream: &mut Stream) -> Vec<View> {
    if kinds.is_empty() {
        return draw_views(rest, grid, stream);
    }
    let mut left = stream.uniform(0.0, 1.0);
    let kind = kinds.iter().find(|kind| {
        left -= kind.share;
        left < 0.0
    });
    let Some(&ViewKind { counts, radius_sizes, polar_rad, around, .. }) = kind else {
        return draw_views(rest, grid, stream);
    };
    let mut views = draw_views(&ViewParams { counts, radius_sizes, polar_rad }, grid, stream);
    if around {
        let (first_rad, step_rad) = (views[0].azimuth_rad, core::f32::consts::TAU / views.len() as f32);
        for (number, view) in views.iter_mut().enumerate() {
            view.azimuth_rad = (first_rad + number as f32 * step_rad) % core::f32::consts::TAU;
        }
    }
    views
}

/// Draws the views of a scene: their count, then radius, polar angle and azimuth of each.
///
/// # Panics
/// If the least count is above the most.
#[must_use]
pub fn draw_views(params: &ViewParams, grid: &Grid, stream: &mut Stream) -> Vec<View> {
    let ([count_min, count_max], [radius_min, radius_max]) = (params.counts, params.radius_sizes);
    assert!(count_min <= count_max, "no count between {count_min} and {count_max}");
    let count = count_min + stream.index(count_max - count_min + 1);
    let [polar_rad_min, polar_rad_max] = params.polar_rad;
    (0..count)
        .map(|_| View {
            radius_m: grid.size_m * stream.uniform(radius_min, radius_max),
            polar_rad: stream.uniform(polar_rad_min, polar_rad_max),
            azimuth_rad: stream.uniform(0.0, core::f32::consts::TAU),
        })
        .collect()
}

/// The camera of a view: on the sphere about the centre of the workspace's floor, (size/2, size/2, 0), looking at it,
/// image up towards workspace up (VGN: `camera_on_sphere`).
///
/// VGN's look-at divides zero by zero straight above the target. [`View::workspace_from_camera`] gives the same poses,
/// and at the pole the limit along the azimuth.
#[must_use]
pub fn camera_at(view: &View, grid: &Grid, intrinsics: Intrinsics) -> Camera {
    Camera { intrinsics, workspace_from_camera: view.workspace_from_camera(grid) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use schema::{Purpose, Vec3};

    use super::*;

    /// VGN's `camera_on_sphere` as it is written there, in f64: eye, right, down, forward.
    fn look_at(view: &View, grid: &Grid) -> [[f64; 3]; 4] {
        let (r, theta, phi) = (f64::from(view.radius_m), f64::from(view.polar_rad), f64::from(view.azimuth_rad));
        let offset =
            [r * libm::sin(theta) * libm::cos(phi), r * libm::sin(theta) * libm::sin(phi), r * libm::cos(theta)];
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let unit = |a: [f64; 3]| a.map(|x| x / (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]).sqrt());
        let forward = unit(offset.map(|x| -x));
        let right = unit(cross(forward, [0.0, 0.0, 1.0]));
        let up = cross(right, forward);
        let half = 0.5 * f64::from(grid.size_m);
        [[offset[0] + half, offset[1] + half, offset[2]], right, up.map(|x| -x), forward]
    }

    fn assert_near(got: Vec3, expected: [f64; 3], what: &str) {
        for (g, e) in got.to_array().into_iter().zip(expected) {
            assert!((f64::from(g) - e).abs() < 1e-5, "{what}: {got} against {expected:?}");
        }
    }

    proptest! {
        #[test]
        fn the_pose_is_that_of_vgns_look_at(
            radius_m in 0.3_f32..1.0, polar_rad in 0.01_f32..1.5, azimuth_rad in 0.0_f32..core::f32::consts::TAU,
        ) {
            let (view, grid) = (View { radius_m, polar_rad, azimuth_rad }, Grid::PAPER);
            let pose = camera_at(&view, &grid, Intrinsics::VGN).workspace_from_camera;
            let [eye, right, down, forward] = look_at(&view, &grid);
            assert_near(pose.translation, eye, "eye");
            assert_near(pose.rotation * Vec3::X, right, "right");
            assert_near(pose.rotation * Vec3::Y, down, "down");
            assert_near(pose.rotation * Vec3::Z, forward, "forward");
        }

        #[test]
        fn the_optical_axis_meets_the_middle_of_the_floor(
            radius_m in 0.3_f32..1.0, polar_rad in 0.0_f32..1.5, azimuth_rad in 0.0_f32..core::f32::consts::TAU,
        ) {
            let (view, grid) = (View { radius_m, polar_rad, azimuth_rad }, Grid::PAPER);
            let camera = camera_at(&view, &grid, Intrinsics::VGN);
            let middle = camera.workspace_from_camera * (Vec3::Z * radius_m);
            assert_near(middle, [0.15, 0.15, 0.0], "middle");
            let seen = camera.workspace_from_camera.inverse() * Vec3::new(0.15, 0.15, 0.0);
            prop_assert_eq!(camera.intrinsics.project(seen), Some([320, 240]));
            // Up in the workspace is up in the image, or nothing at all from straight above.
            let above = camera.workspace_from_camera.inverse() * Vec3::new(0.15, 0.15, 0.05);
            prop_assert!(above.y <= 1e-6, "{}", above);
        }
    }

    #[test]
    fn straight_above_is_the_limit_along_the_azimuth() {
        for step in 0..16 {
            let azimuth_rad = step as f32 * 0.4;
            let pose = |polar_rad| {
                let view = View { radius_m: 0.6, polar_rad, azimuth_rad };
                camera_at(&view, &Grid::PAPER, Intrinsics::VGN).workspace_from_camera
            };
            let (at, near) = (pose(0.0), pose(1e-4));
            assert!(at.is_finite());
            assert!((at.rotation.length() - 1.0).abs() < 1e-6);
            for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
                assert!((at.rotation * axis - near.rotation * axis).length() < 2e-4, "azimuth {azimuth_rad}");
            }
        }
    }

    #[test]
    fn kinds_come_by_their_shares_and_views_around_a_scene_are_evenly_spaced() {
        let side =
            ViewKind { share: 0.3, counts: [1, 1], radius_sizes: [2.0, 2.5], polar_rad: [0.8, 1.2], around: false };
        let ring = ViewKind { share: 0.2, counts: [2, 4], polar_rad: [0.4, 0.5], around: true, ..side };
        let (params, grid, scenes) = (ViewParams { polar_rad: [0.0, 0.3], ..ViewParams::VGN }, Grid::PAPER, 4_000);
        let drawn =
            |kinds: &[ViewKind], scene| draw_kind(&params, kinds, &grid, &mut Stream::new(5, scene, Purpose::Views, 0));
        let (mut sides, mut rings) = (0, 0);
        for views in (0..scenes).map(|scene| drawn(&[side, ring], scene)) {
            if views[0].polar_rad > 0.7 {
                sides += 1;
                assert!(views.len() == 1 && views[0].polar_rad <= 1.2 && views[0].radius_m >= 0.6);
            } else if views[0].polar_rad > 0.35 {
                rings += 1;
                assert!((2..=4).contains(&views.len()));
                let step_rad = core::f32::consts::TAU / views.len() as f32;
                for pair in views.windows(2) {
                    let turn_rad = (pair[1].azimuth_rad - pair[0].azimuth_rad).rem_euclid(core::f32::consts::TAU);
                    assert!((turn_rad - step_rad).abs() < 1e-4, "{views:?}");
                }
            }
        }
        assert!((1_130..1_270).contains(&sides) && (730..870).contains(&rings), "{sides} {rings}");
        // Without kinds nothing more is drawn.
        assert_eq!(drawn(&[], 7), draw_views(&params, &grid, &mut Stream::new(5, 7, Purpose::Views, 0)));
    }

    #[test]
    fn drawn_views_fill_the_laws_ranges_and_stay_inside() {
        let (params, grid) = (ViewParams::VGN, Grid::PAPER);
        let mut counts = [0_u32; 7];
        let mut views = Vec::new();
        for scene in 0..3_000 {
            let drawn = draw_views(&params, &grid, &mut Stream::new(5, scene, Purpose::Views, 0));
            counts[drawn.len()] += 1;
            views.extend(drawn);
        }
        assert_eq!(counts[0], 0);
        assert!(counts[1..].iter().all(|c| (430..570).contains(c)), "{counts:?}");
        let check = |name, low: f32, high: f32, value: fn(&View) -> f32| {
            let values = || views.iter().map(value);
            assert!(values().all(|v| v >= low && v <= high), "{name} leaves {low}..{high}");
            let (mean, width) = (values().sum::<f32>() / views.len() as f32, high - low);
            assert!((mean - 0.5 * (low + high)).abs() < 0.02 * width, "{name} has mean {mean}");
            assert!(values().fold(high, f32::min) < low + 0.01 * width, "{name} never comes near {low}");
            assert!(values().fold(low, f32::max) > high - 0.01 * width, "{name} never comes near {high}");
        };
        check("radius", 0.48, 0.72, |v| v.radius_m);
        check("polar", 0.0, core::f32::consts::FRAC_PI_4, |v| v.polar_rad);
        check("azimuth", 0.0, core::f32::consts::TAU, |v| v.azimuth_rad);
    }
}
