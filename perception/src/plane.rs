//! The plane under the objects, by RANSAC and least squares (Fischler & Bolles 1981; the paper's Eq. 7).

use rayon::prelude::*;
use schema::{Plane, Stream, Vec3};
use serde::Serialize;
use settings::settings;

use crate::fit::Coordinates;

settings! {
    /// Settings of the plane search.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct PlaneParams {
        /// Points closer than this to the plane are inliers.
        pub threshold_m: f32 where 1e-4..=0.1,
        /// Number of random samples of three points.
        pub iterations: usize where 1..=100_000,
        /// Maximum number of refits to the inliers.
        pub refits_max: usize where 0..=1_000,
        /// Largest angle between the normal and the workspace's z.
        pub tilt_rad_max: f32 where 0.0..=1.57,
        /// Minimum share of the cloud that must be inliers.
        pub share_min: f32 where 0.0..=1.0,
    }
}

impl PlaneParams {
    /// The paper's threshold and iterations. In addition the table must be level within 0.3 rad and contain a fifth of
    /// the points. The paper has no such limits, but the largest plane of a full workspace may be the side of a box,
    /// and any slice of 20 mm contains a fifteenth of the workspace.
    pub const PAPER: Self =
        Self { threshold_m: 0.01, iterations: 100, refits_max: 20, tilt_rad_max: 0.3, share_min: 0.2 };
}

/// A plane and its inliers.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundPlane {
    /// The plane; its normal points upwards (z is positive).
    pub plane: Plane,
    /// Indices of the inliers, ascending.
    pub inliers: Vec<usize>,
}

/// The plane with the most inliers, or `None` if none meets the limits.
///
/// The best of the planes through three random points is refitted to its inliers until they no longer change.
#[must_use]
pub fn find_plane(points_m: &[Vec3], params: &PlaneParams, stream: &mut Stream) -> Option<FoundPlane> {
    if points_m.len() < 3 {
        return None;
    }
    let steep = libm::cosf(params.tilt_rad_max);
    let mut triple = || {
        let [a, b, c] = core::array::from_fn(|_| points_m[stream.index(points_m.len())]);
        through(a, b, c).filter(|plane| plane.normal.z >= steep)
    };
    let planes: Vec<Plane> = (0..params.iterations).filter_map(|_| triple()).collect();
    let points = Coordinates::new(points_m);
    let counted: Vec<usize> =
        planes.par_iter().map(|plane| points.count(|point_m| belongs(plane, point_m, params))).collect();
    // The first of equals.
    let best = (0..planes.len()).reduce(|best, next| if counted[next] > counted[best] { next } else { best })?;
    let (plane, marks) = settled(&points, planes[best], params)?;
    let inliers: Vec<usize> = (0..marks.len()).filter(|at| marks[*at] != 0).collect();
    let enough = inliers.len() as f32 >= params.share_min * points_m.len() as f32;
    (enough && plane.normal.z >= steep).then_some(FoundPlane { plane, inliers })
}

fn belongs(plane: &Plane, point_m: Vec3, params: &PlaneParams) -> bool {
    (plane.normal.dot(point_m) - plane.offset_m).abs() < params.threshold_m
}

/// Refits the plane to its inliers until they no longer change; gives it and which points they are.
fn settled(points: &Coordinates, first: Plane, params: &PlaneParams) -> Option<(Plane, Vec<i32>)> {
    let (mut plane, mut marks) = (first, vec![0; points.len()]);
    let mark = |plane: &Plane, marks: &mut [i32]| points.mark(|point_m| belongs(plane, point_m, params), marks);
    let (mut sums, _) = mark(&plane, &mut marks);
    for _ in 0..params.refits_max {
        let (normal, offset_m) = sums.plane()?;
        plane = upwards(normal, offset_m);
        let is_changed;
        (sums, is_changed) = mark(&plane, &mut marks);
        if !is_changed {
            break;
        }
    }
    Some((plane, marks))
}

/// The plane through three points, unless they are collinear.
fn through(a: Vec3, b: Vec3, c: Vec3) -> Option<Plane> {
    let normal = (b - a).cross(c - a).try_normalize()?;
    Some(upwards(normal, normal.dot(a)))
}

fn upwards(normal: Vec3, offset_m: f32) -> Plane {
    if normal.z < 0.0 { Plane { normal: -normal, offset_m: -offset_m } } else { Plane { normal, offset_m } }
}

#[cfg(test)]
mod tests {
    use schema::Purpose;

    use super::*;

    fn stream(number: u64) -> Stream {
        Stream::new(11, number, Purpose::Plane, 0)
    }

    /// A noisy level-ish plane and a crowd of points above it.
    fn scene(number: u64, noise_m: f32) -> (Plane, Vec<Vec3>) {
        let mut stream = stream(number);
        let tilt = Vec3::new(stream.normal(0.0, 0.03), stream.normal(0.0, 0.03), 1.0).normalize();
        let plane = Plane { normal: tilt, offset_m: 0.05 };
        let mut points = Vec::new();
        for _ in 0..3_000 {
            let flat = stream.point(Vec3::ZERO, Vec3::new(0.3, 0.3, 0.0));
            let z = (plane.offset_m - flat.dot(plane.normal)) / plane.normal.z;
            points.push(flat + Vec3::new(0.0, 0.0, z) + plane.normal * stream.normal(0.0, noise_m));
        }
        for _ in 0..1_500 {
            points.push(stream.point(Vec3::new(0.1, 0.1, 0.08), Vec3::new(0.2, 0.2, 0.15)));
        }
        (plane, points)
    }

    #[test]
    fn a_plane_without_noise_is_found_to_rounding() {
        let (plane, points) = scene(1, 0.0);
        let found = find_plane(&points, &PlaneParams::PAPER, &mut stream(2)).unwrap();
        assert!((found.plane.normal - plane.normal).length() < 1e-5, "{:?}", found.plane);
        assert!((found.plane.offset_m - plane.offset_m).abs() < 1e-6);
        assert_eq!(found.inliers, (0..3_000).collect::<Vec<_>>());
    }

    /// The error of a least-squares plane over a 0.3 m square with n points of noise s: s/√n in height, s/(√n · 0.087
    /// m) in tilt.
    #[test]
    fn noise_moves_it_no_farther_than_least_squares_must() {
        for number in 0..20 {
            let (plane, points) = scene(number, 0.002);
            let found = find_plane(&points, &PlaneParams::PAPER, &mut stream(100 + number)).unwrap();
            let middle = Vec3::new(0.15, 0.15, 0.05);
            let height = |p: &Plane| p.normal.dot(middle) - p.offset_m;
            assert!((height(&found.plane) - height(&plane)).abs() < 4.0 * 0.002 / 3_000_f32.sqrt());
            let tilt = (found.plane.normal - plane.normal).length();
            assert!(tilt < 4.0 * 1.42 * 0.002 / (3_000_f32.sqrt() * 0.087), "scene {number}: tilt {tilt}");
        }
    }

    #[test]
    fn the_fit_is_the_least_squares_plane() {
        // Heights over a lattice: the normal equations can be solved by hand, for z = ax + by + c with small slopes
        // both kinds of least squares agree to the square of the slopes.
        let heights = [0.0, 1e-5, -2e-5, 3e-5, 0.0, 1e-5, -1e-5, 2e-5, 0.0];
        let points: Vec<Vec3> =
            (0..9).map(|n| Vec3::new((n / 3) as f32 - 1.0, (n % 3) as f32 - 1.0, heights[n])).collect();
        let (sums, _) = Coordinates::new(&points).mark(|_| true, &mut [0; 9]);
        let (normal, offset_m) = sums.plane().unwrap();
        let plane = upwards(normal, offset_m);
        let slope = |weight: &dyn Fn(usize) -> f32| (0..9).map(|n| weight(n) * heights[n]).sum::<f32>() / 6.0;
        let (a, b) = (slope(&|n| (n / 3) as f32 - 1.0), slope(&|n| (n % 3) as f32 - 1.0));
        assert!((plane.normal - Vec3::new(-a, -b, 1.0)).length() < 1e-9, "{:?} against {a}, {b}", plane.normal);
        assert!((plane.offset_m - heights.iter().sum::<f32>() / 9.0).abs() < 1e-9);
    }

    #[test]
    fn what_is_no_table_is_not_found() {
        let mut stream = stream(5);
        assert_eq!(find_plane(&[], &PlaneParams::PAPER, &mut stream), None);
        let line: Vec<Vec3> = (0..500).map(|n| Vec3::new(n as f32 * 1e-3, 0.0, 0.0)).collect();
        assert_eq!(find_plane(&line, &PlaneParams::PAPER, &mut stream), None);
        let wall: Vec<Vec3> = (0..500).map(|_| stream.point(Vec3::ZERO, Vec3::new(0.3, 0.0, 0.3))).collect();
        assert_eq!(find_plane(&wall, &PlaneParams::PAPER, &mut stream), None);
        let same = vec![Vec3::ONE; 50];
        assert_eq!(find_plane(&same, &PlaneParams::PAPER, &mut stream), None);
        let cloud: Vec<Vec3> = (0..500).map(|_| stream.point(Vec3::ZERO, Vec3::splat(30.0))).collect();
        assert_eq!(find_plane(&cloud, &PlaneParams::PAPER, &mut stream), None);
    }

    #[test]
    fn the_same_stream_finds_the_same_plane() {
        let (_, points) = scene(3, 0.003);
        let find = || find_plane(&points, &PlaneParams::PAPER, &mut stream(9));
        assert_eq!(find(), find());
    }
}
