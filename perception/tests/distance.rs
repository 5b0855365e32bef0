//! Compares the field with geometry: a table and a ball, whose distance along a ray has a closed form.

use perception::{TRUNCATION_VOXELS, Tsdf, camera_at, draw_views};
use schema::{Camera, Grid, Intrinsics, Purpose, Stream, Vec3, View, ViewParams};

const GRID: Grid = Grid::PAPER;
const VOXEL_M: f64 = 0.0075;
const TRUNCATION_M: f64 = 4.0 * VOXEL_M;

/// A pixel is 1/540 of the depth wide, so its centre is off the voxel's by at most this share of the depth.
const OFF_AXIS: f64 = 0.5 * core::f64::consts::SQRT_2 / 540.0;

fn camera(radius_m: f32, polar_rad: f32, azimuth_rad: f32) -> Camera {
    camera_at(&View { radius_m, polar_rad, azimuth_rad }, &GRID, Intrinsics::VGN)
}

fn as_f64(v: Vec3) -> [f64; 3] {
    v.to_array().map(f64::from)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The camera's eye and the direction of a pixel's ray, z forward = 1.
fn ray(camera: &Camera, pixel: [usize; 2]) -> ([f64; 3], [f64; 3]) {
    let pose = camera.workspace_from_camera;
    (as_f64(pose.translation), as_f64(pose.rotation * camera.intrinsics.ray(pixel)))
}

/// The ray parameter from `eye` along `along` to the table.
fn table_hit(eye: [f64; 3], along: [f64; 3]) -> Option<f64> {
    let depth = (f64::from(GRID.table_z_m) - eye[2]) / along[2];
    (depth > 0.0).then_some(depth)
}

const BALL_M: [f64; 3] = [0.16, 0.14, 0.12];
const BALL_RADIUS_M: f64 = 0.05;

/// The nearer root of |eye + t·along − centre|² = radius².
fn ball_hit(eye: [f64; 3], along: [f64; 3]) -> Option<f64> {
    let from = minus(eye, BALL_M);
    let (a, b, c) = (dot(along, along), dot(along, from), dot(from, from) - BALL_RADIUS_M * BALL_RADIUS_M);
    let root = b * b - a * c;
    (root >= 0.0).then(|| (-b - root.sqrt()) / a)
}

fn voxels() -> impl Iterator<Item = [usize; 3]> {
    (0..40).flat_map(|i| (0..40).flat_map(move |j| (0..40).map(move |k| [i, j, k])))
}

/// Distance from a voxel along its own ray to the surface given by `hit`, in metres.
fn true_distance_m(camera: &Camera, voxel: [usize; 3], hit: impl Fn([f64; 3], [f64; 3]) -> Option<f64>) -> Option<f64> {
    let eye = as_f64(camera.workspace_from_camera.translation);
    let along = minus(as_f64(GRID.centre_m(voxel)), eye);
    hit(eye, along).map(|share| (share - 1.0) * dot(along, along).sqrt())
}

#[test]
fn a_tables_field_is_its_distance_along_the_ray() {
    let mut worst: f64 = 0.0;
    for camera in [camera(0.6, 0.0, 0.0), camera(0.5, 0.3, 1.0), camera(0.72, 0.75, 4.0), camera(0.6, 1.1, 2.0)] {
        let mut tsdf = Tsdf::new(GRID, TRUNCATION_VOXELS);
        tsdf.integrate(&camera, |pixel| {
            let (eye, along) = ray(&camera, pixel);
            table_hit(eye, along).map(|depth| depth as f32)
        });
        let mut observed = 0;
        for voxel in voxels() {
            let Some(value) = tsdf.at(voxel) else { continue };
            let Some(distance_m) = true_distance_m(&camera, voxel, table_hit) else { continue };
            observed += 1;
            // The pixel's ray meets the table at another point than the voxel's; the difference depends on the
            // obliqueness.
            let eye_to_voxel = minus(as_f64(GRID.centre_m(voxel)), as_f64(camera.workspace_from_camera.translation));
            let range_m = dot(eye_to_voxel, eye_to_voxel).sqrt();
            let slope = (range_m / eye_to_voxel[2]).abs();
            let tolerance = 1.1 * OFF_AXIS * (range_m + distance_m.abs()) * slope / TRUNCATION_M + 1e-4;
            let error = (f64::from(value) - (distance_m / TRUNCATION_M).min(1.0)).abs();
            worst = worst.max(error);
            assert!(error < tolerance, "{voxel:?}: {value}, {distance_m} m, off by {error} of at most {tolerance}");
        }
        assert!(observed > 20_000, "only {observed} voxels observed");
    }
    assert!(worst < 0.1, "worst error {worst} truncations");
}

#[test]
fn voxels_deep_under_the_table_stay_unobserved() {
    let camera = camera(0.6, 0.2, 0.3);
    let mut tsdf = Tsdf::new(GRID, 2.0);
    tsdf.integrate(&camera, |pixel| {
        let (eye, along) = ray(&camera, pixel);
        table_hit(eye, along).map(|depth| depth as f32)
    });
    let grid = tsdf.to_voxels();
    for voxel in voxels() {
        let depth_below_m = f64::from(GRID.table_z_m) - as_f64(GRID.centre_m(voxel))[2];
        if depth_below_m > 2.1 * VOXEL_M {
            assert_eq!(tsdf.at(voxel), None, "{voxel:?}");
            assert_eq!(grid.values[GRID.flat(voxel)], 0.0);
        }
    }
}

/// Heights at which the field changes sign between neighbouring stored voxels of a column; the surface is at ½.
fn crossings_m(values: &[f32], i: usize, j: usize) -> impl Iterator<Item = [f64; 3]> {
    (0..39).filter_map(move |k| {
        let [low, high] = [k, k + 1].map(|k| f64::from(values[GRID.flat([i, j, k])]) - 0.5);
        let stored = low > -0.5 && high > -0.5;
        (stored && low < 0.0 && high >= 0.0).then(|| {
            let [x, y, z] = as_f64(GRID.centre_m([i, j, k]));
            [x, y, z + VOXEL_M * low / (low - high)]
        })
    })
}

#[test]
fn the_field_crosses_zero_at_the_table() {
    let mut tsdf = Tsdf::new(GRID, TRUNCATION_VOXELS);
    for view in draw_views(&ViewParams::VGN, &GRID, &mut Stream::new(1, 2, Purpose::Views, 0)) {
        let camera = camera_at(&view, &GRID, Intrinsics::VGN);
        tsdf.integrate(&camera, |pixel| {
            let (eye, along) = ray(&camera, pixel);
            table_hit(eye, along).map(|depth| depth as f32)
        });
    }
    let grid = tsdf.to_voxels();
    let mut worst_m: f64 = 0.0;
    for (i, j) in (0..40).flat_map(|i| (0..40).map(move |j| (i, j))) {
        let heights: Vec<_> = crossings_m(&grid.values, i, j).collect();
        assert_eq!(heights.len(), 1, "column {i}, {j}");
        worst_m = worst_m.max((heights[0][2] - 0.05).abs());
    }
    assert!(worst_m < 0.05 * VOXEL_M, "off by {worst_m} m");
}

#[test]
fn the_field_crosses_zero_on_the_ball() {
    let mut tsdf = Tsdf::new(GRID, TRUNCATION_VOXELS);
    for (polar_rad, azimuth_rad) in [(0.0, 0.0), (0.5, 0.0), (0.5, 2.1), (0.5, 4.2)] {
        let camera = camera(0.6, polar_rad, azimuth_rad);
        tsdf.integrate(&camera, |pixel| {
            let (eye, along) = ray(&camera, pixel);
            ball_hit(eye, along).map(|depth| depth as f32)
        });
    }
    let grid = tsdf.to_voxels();
    let mut offsets_m = Vec::new();
    for (i, j) in (0..40).flat_map(|i| (0..40).map(move |j| (i, j))) {
        for crossing in crossings_m(&grid.values, i, j) {
            let out = minus(crossing, BALL_M);
            // The upper cap, where every view sees the surface less than some 60° from face on.
            if out[2] > 0.6 * BALL_RADIUS_M {
                offsets_m.push(dot(out, out).sqrt() - BALL_RADIUS_M);
            }
        }
    }
    let worst_m = offsets_m.iter().fold(0.0, |worst: f64, o| worst.max(o.abs()));
    let mean_m = offsets_m.iter().sum::<f64>() / offsets_m.len() as f64;
    assert!(offsets_m.len() > 80, "only {} crossings", offsets_m.len());
    assert!(worst_m < 0.2 * VOXEL_M, "off by {worst_m} m");
    assert!(mean_m.abs() < 0.05 * VOXEL_M, "off by {mean_m} m on average");
}

#[test]
fn one_views_field_of_a_ball_is_its_distance_along_the_ray() {
    let camera = camera(0.6, 0.4, 1.0);
    let mut tsdf = Tsdf::new(GRID, TRUNCATION_VOXELS);
    tsdf.integrate(&camera, |pixel| {
        let (eye, along) = ray(&camera, pixel);
        ball_hit(eye, along).map(|depth| depth as f32)
    });
    let (mut seen, mut worst) = (0, 0.0_f64);
    for voxel in voxels() {
        // Away from the silhouette, where half a pixel moves the surface by more than a voxel.
        let eye = as_f64(camera.workspace_from_camera.translation);
        let along = minus(as_f64(GRID.centre_m(voxel)), eye);
        let from = minus(eye, BALL_M);
        let miss2 = dot(from, from) - dot(from, along).powi(2) / dot(along, along);
        if miss2 > (0.8 * BALL_RADIUS_M).powi(2) {
            continue;
        }
        let distance_m = true_distance_m(&camera, voxel, ball_hit).unwrap();
        match tsdf.at(voxel) {
            Some(value) => {
                seen += 1;
                worst = worst.max((f64::from(value) - (distance_m / TRUNCATION_M).min(1.0)).abs());
            }
            None => assert!(distance_m < -TRUNCATION_M + 0.001, "{voxel:?} unobserved at {distance_m} m"),
        }
    }
    assert!(seen > 1_000, "only {seen} voxels observed");
    assert!(worst < 0.03, "worst error {worst} truncations");
}
