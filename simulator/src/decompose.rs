//! Convex parts for a triangle mesh: pieces that are cut until their hulls lie on its surface, with few corners.
//!
//! Every face and edge of a part is an axis of the collision test, so the number of corners is limited: a piece that
//! needs more is cut, too. The largest deviation is reported.

use std::panic::{AssertUnwindSafe, catch_unwind};

use parry3d::transformation::try_convex_hull;
use schema::{HullError, Plane, Polyhedron, Purpose, Stream, Vec3, bounds_m};

use crate::convex_hull::convex_hull;

mod pieces;

/// Points of the mesh may lie outside a simplified part by at most this share of the mesh's size, and of the tolerance.
const FLAT_SHARE: f32 = 2e-4;
const SIMPLE_SHARE: f32 = 0.25;
/// Corners whose faces are neither clearly flat nor clearly bent are moved by up to this share of their hull's
/// diagonal, in so many ways.
const MOVED_SHARE: f32 = 5e-4;
const MOVES: u64 = 8;
/// A piece without a volume, as of a sheet, gets this thickness on each side.
const SHEET_M: f32 = 0.000_2;
/// Corners of parts are whole multiples of this length, in 1/m: a tenth of a micrometre, as catalogues write them.
/// Exact in single precision up to 0.8 m.
const STEPS_PER_M: f32 = 1e7;

/// How finely a mesh is decomposed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PartsParams {
    /// Maximum number of parts.
    pub parts_max: usize,
    /// Maximum number of corners of a part; at least 8.
    pub corners_max: usize,
    /// A piece is cut further if its hull leaves the mesh's surface by more than this, in metres.
    pub tolerance_m: f32,
}

/// A mesh as convex parts.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvexParts {
    /// The parts, in the mesh's frame.
    pub hulls: Vec<Polyhedron>,
    /// Largest distance in metres by which points lie outside the faces of their simplified part.
    pub simplified_m: f32,
    /// Largest distance in metres by which the mesh's surface lies inside of a part.
    pub filled_m: f32,
}

/// Decomposes a mesh: corners in metres, triangles as corner indices. The same mesh gives the same parts.
///
/// # Errors
/// [`HullError`] if the mesh has almost no volume.
///
/// # Panics
/// If a triangle has an index without a corner.
pub fn convex_parts(
    corners_m: &[Vec3],
    triangles: &[[u32; 3]],
    params: &PartsParams,
) -> Result<ConvexParts, HullError> {
    let [low, high] = bounds_m(corners_m);
    let size_m = (high - low).max_element();
    if size_m <= 0.0 {
        return Err(HullError::Flat);
    }
    let whole = || few_cornered_hull(corners_m, params.corners_max);
    if params.parts_max <= 1 {
        let (whole, left_m) = whole()?;
        return Ok(ConvexParts { hulls: vec![whole], simplified_m: left_m, filled_m: 0.0 });
    }
    if !corners_m.iter().all(|corner_m| corner_m.is_finite()) {
        return Err(HullError::Corner);
    }
    let simple_m = (FLAT_SHARE * size_m).min(SIMPLE_SHARE * params.tolerance_m);
    let mut parts = ConvexParts { hulls: Vec::new(), simplified_m: 0.0, filled_m: 0.0 };
    let mut has_volume = false;
    for (corners_m, filled_m) in pieces::pieces(corners_m, triangles, params) {
        parts.filled_m = parts.filled_m.max(filled_m);
        let simple = |points_m: &[Vec3]| simplified(points_m, params.corners_max, simple_m).ok();
        let solid = simple(&corners_m);
        has_volume |= solid.is_some();
        let made = solid.or_else(|| simple(&thickened(&corners_m)?));
        // What has no hull with a volume is left out; the volume of the parts shows the loss.
        let Some((hull, left_m)) = made else { continue };
        parts.simplified_m = parts.simplified_m.max(left_m);
        parts.hulls.push(hull);
    }
    // A mesh that has no volume as a whole is refused; parts of one may be sheets.
    if !has_volume {
        whole()?;
    }
    if parts.hulls.is_empty() { Err(HullError::Flat) } else { Ok(parts) }
}

/// The hull of some points with at most `corners_max` corners, all of them among the points, and the largest distance
/// in metres by which points lie outside its faces.
///
/// # Errors
/// [`HullError`] if the points have no hull.
pub fn few_cornered_hull(points_m: &[Vec3], corners_max: usize) -> Result<(Polyhedron, f32), HullError> {
    let [low, high] = bounds_m(points_m);
    if !points_m.iter().all(|p| p.is_finite()) {
        return Err(HullError::Corner);
    }
    let whole = hull(points_m).ok_or(HullError::Flat)?;
    simplified(&whole.corners_m, corners_max, FLAT_SHARE * (high - low).max_element())
}

/// Volume of the convex hull of some points, in cubic metres.
///
/// # Errors
/// [`HullError`] if the points have no hull.
pub fn hull_volume_m3(points_m: &[Vec3]) -> Result<f64, HullError> {
    hull(points_m).map(|hull| hull.volume_m3()).ok_or(HullError::Flat)
}

/// A hull by its triangles.
struct Hull {
    corners_m: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Hull {
    fn planes(&self) -> impl Iterator<Item = Plane> {
        self.triangles.iter().filter_map(|triangle| {
            let [a, b, c] = triangle.map(|corner| self.corners_m[corner as usize]);
            let normal = (b - a).cross(c - a).try_normalize()?;
            Some(Plane { normal, offset_m: normal.dot(a) })
        })
    }

    fn volume_m3(&self) -> f64 {
        let from = self.corners_m[0];
        let below = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|corner| self.corners_m[corner as usize] - from);
            f64::from(a.dot(b.cross(c))) / 6.0
        };
        self.triangles.iter().map(below).sum()
    }
}

/// The hull of some points; `None` if they have none. The library panics on some scans.
fn hull(points_m: &[Vec3]) -> Option<Hull> {
    let made = catch_unwind(AssertUnwindSafe(|| try_convex_hull(points_m)));
    made.ok()?.ok().map(|(corners_m, triangles)| Hull { corners_m, triangles })
}

/// Points of a sheet on both of its sides; `None` if they are on a line.
fn thickened(points_m: &[Vec3]) -> Option<Vec<Vec3>> {
    let first = *points_m.first()?;
    let far = |across: &dyn Fn(Vec3) -> Vec3| {
        let length = |point: &Vec3| across(*point - first).length_squared();
        points_m.iter().copied().max_by(|a, b| length(a).total_cmp(&length(b))).map(|point| across(point - first))
    };
    let along = far(&|off| off)?.try_normalize()?;
    let side = far(&|off| off - along * off.dot(along))?.try_normalize()?;
    let up = along.cross(side) * SHEET_M;
    Some(points_m.iter().flat_map(|point| [*point - up, *point + up]).collect())
}

/// A hull with few corners: the outermost points along a few axes, then repeatedly the point farthest outside.
fn simplified(points_m: &[Vec3], corners_max: usize, tolerance_m: f32) -> Result<(Polyhedron, f32), HullError> {
    let in_steps = |at_m: Vec3| (at_m * STEPS_PER_M).round() / STEPS_PER_M;
    let points_m = &points_m.iter().map(|point| in_steps(*point)).collect::<Vec<_>>();
    // Nearly always the corners that a quick look chooses have a hull that lasts, or all but one of them, or all moved
    // a little; the fewer, the clearer its faces.
    let [low, high] = bounds_m(points_m);
    let moved_m = MOVED_SHARE * (high - low).length();
    for times in [1.0, 2.0, 4.0, 8.0] {
        let Some((chosen, left_m)) = few_corners(points_m, corners_max, times * tolerance_m) else { break };
        if let Ok(hull) = lasting_hull(&chosen) {
            return Ok((hull, left_m));
        }
        let most_m = left_m.max(8.0 * tolerance_m);
        let nearly = |points: Vec<Vec3>| {
            let hull = convex_hull(&points).ok()?;
            let left_m = outside_m(points_m, hull.planes()).into_iter().fold(0.0, f32::max);
            (left_m <= most_m).then_some((hull, left_m))
        };
        let others = |one: usize| chosen.iter().enumerate().filter(move |(i, _)| *i != one).map(|(_, at)| *at);
        let without = (0..chosen.len()).map(|one| others(one).collect::<Vec<_>>());
        let moved = (0..MOVES).map(|seed| {
            let mut stream = Stream::new(seed, 0, Purpose::Objects, 0);
            let mut step = || stream.point(Vec3::splat(-moved_m), Vec3::splat(moved_m));
            chosen.iter().map(|at| in_steps(*at + step())).collect::<Vec<_>>()
        });
        // The one that leaves least and lasts. Whether it does takes longer to find out than what it leaves.
        let mut hulls: Vec<(Polyhedron, f32)> = without.chain(moved).filter_map(nearly).collect();
        hulls.sort_by(|a, b| a.1.total_cmp(&b.1));
        if let Some(least) = hulls.into_iter().find(|(hull, _)| lasts(hull).is_ok()) {
            return Ok(least);
        }
    }
    let (mut chosen, mut whole) = beginning(points_m)?;
    let mut is_left = vec![true; points_m.len()];
    loop {
        let outside = outside_m(points_m, whole.planes());
        let left_m = outside.iter().copied().fold(0.0, f32::max);
        let furthest = farthest(&outside, &is_left);
        let Some(next) = furthest.filter(|i| outside[*i] > tolerance_m && whole.corners_m().len() < corners_max) else {
            return Ok((whole, left_m));
        };
        is_left[next] = false;
        chosen.push(points_m[next]);
        // A point that would make almost coplanar faces is not added and counts as lying outside.
        match lasting_hull(&chosen) {
            Ok(larger) if larger.corners_m().len() <= corners_max => whole = larger,
            _ => drop(chosen.pop()),
        }
    }
}

/// The same choice of corners without asking whether their hull lasts, and how far other points lie outside.
fn few_corners(points_m: &[Vec3], corners_max: usize, tolerance_m: f32) -> Option<(Vec<Vec3>, f32)> {
    let mut is_left = vec![true; points_m.len()];
    let mut chosen: Vec<Vec3> = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE, Vec3::new(1.0, -1.0, 1.0), Vec3::new(-1.0, 1.0, 1.0)] {
        for direction in [axis, -axis] {
            let reach = |i: &usize| direction.dot(points_m[*i]);
            let outermost = (0..points_m.len()).max_by(|a, b| reach(a).total_cmp(&reach(b)))?;
            if core::mem::take(&mut is_left[outermost]) && chosen.len() < corners_max {
                chosen.push(points_m[outermost]);
            }
        }
    }
    loop {
        let outside = outside_m(points_m, hull(&chosen)?.planes());
        let left_m = outside.iter().copied().fold(0.0, f32::max);
        let next = farthest(&outside, &is_left).filter(|i| outside[*i] > tolerance_m && chosen.len() < corners_max);
        let Some(next) = next else { return Some((chosen, left_m)) };
        is_left[next] = false;
        chosen.push(points_m[next]);
    }
}

/// How far the corners of a hull lie outside of one that has so many; those within a tolerance are not looked at.
fn left_out_m(corners_m: &[Vec3], corners_max: usize, tolerance_m: f32) -> f32 {
    if corners_m.len() <= corners_max {
        return 0.0;
    }
    few_corners(corners_m, corners_max, tolerance_m).map_or(f32::INFINITY, |(_, left_m)| left_m)
}

/// The point that is farthest outside of those that are left.
fn farthest(outside_m: &[f32], is_left: &[bool]) -> Option<usize> {
    let farther = |a: &usize, b: &usize| outside_m[*a].total_cmp(&outside_m[*b]).then(b.cmp(a));
    (0..outside_m.len()).filter(|i| is_left[*i]).max_by(farther)
}

/// How far each point lies outside of some planes.
fn outside_m(points_m: &[Vec3], planes: impl Iterator<Item = Plane>) -> Vec<f32> {
    let planes: Vec<Plane> = planes.collect();
    let outside = |p: &Vec3| planes.iter().map(|plane| plane.normal.dot(*p) - plane.offset_m).fold(0.0, f32::max);
    points_m.iter().map(outside).collect()
}

/// A hull that stays one when it is read again.
fn lasting_hull(points_m: &[Vec3]) -> Result<Polyhedron, HullError> {
    let hull = convex_hull(points_m)?;
    lasts(&hull).map(|()| hull)
}

/// Whether a hull stays one when it is read again: its corners in their new order, once from a catalogue and once from
/// a dataset, and as it is drawn. Whether almost coplanar faces are told apart depends on the order.
fn lasts(hull: &Polyhedron) -> Result<(), HullError> {
    let read = convex_hull(hull.corners_m())?;
    convex_hull(read.corners_m())?;
    Polyhedron::hull_of(read.corners_m()).map(drop)
}

/// The outermost points along the axes, and also along the diagonals if the former have no hull.
fn beginning(points_m: &[Vec3]) -> Result<(Vec<Vec3>, Polyhedron), HullError> {
    let signs = [-1.0, 0.0, 1.0];
    let directions = signs.iter().flat_map(|x| signs.iter().flat_map(move |y| signs.map(|z| Vec3::new(*x, *y, z))));
    let mut directions: Vec<Vec3> = directions.filter(|d| *d != Vec3::ZERO).collect();
    directions.sort_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    let mut chosen: Vec<Vec3> = Vec::new();
    let mut problem = HullError::Flat;
    for (number, direction) in directions.iter().enumerate() {
        let outermost = points_m.iter().copied().max_by(|a, b| direction.dot(*a).total_cmp(&direction.dot(*b)));
        chosen.extend(outermost.filter(|point| !chosen.contains(point)));
        if number >= 5 {
            match lasting_hull(&chosen) {
                Ok(hull) if chosen.len() >= 4 => return Ok((chosen, hull)),
                Ok(_) => {}
                Err(error) => problem = error,
            }
        }
    }
    Err(problem)
}

#[cfg(test)]
mod tests {
    use core::f32::consts::PI;

    use schema::{Purpose, Stream};

    use super::*;

    const LAW: PartsParams = PartsParams { parts_max: 256, corners_max: 32, tolerance_m: 0.0008 };

    /// An L of two boxes, 80 × 80 × 30 mm with legs of 30 mm, as a closed mesh.
    fn ell() -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let outline = [[0.0, 0.0], [0.08, 0.0], [0.08, 0.03], [0.03, 0.03], [0.03, 0.08], [0.0, 0.08]];
        let corners = [0.0, 0.03].into_iter().flat_map(|z| outline.map(|[x, y]| Vec3::new(x, y, z))).collect();
        let cap = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]];
        let lower = cap.map(|[a, b, c]| [a, c, b]);
        let upper = cap.map(|t| t.map(|i| i + 6));
        let sides = (0..6).flat_map(|i: u32| {
            let j = (i + 1) % 6;
            [[i, j, j + 6], [i, j + 6, i + 6]]
        });
        (corners, lower.into_iter().chain(upper).chain(sides).collect())
    }

    #[test]
    fn an_ell_is_two_boxes_and_the_same_two_every_time() {
        let (corners, triangles) = ell();
        let parts = convex_parts(&corners, &triangles, &LAW).unwrap();
        let volume: f32 = parts.hulls.iter().map(Polyhedron::volume_m3).sum();
        let exact = (0.08 * 0.03 + 0.05 * 0.03) * 0.03;
        assert!((volume / exact - 1.0).abs() < 0.03, "{volume} of {exact}");
        assert!((2..=3).contains(&parts.hulls.len()), "{} parts", parts.hulls.len());
        assert!(parts.simplified_m < 1e-3);
        assert_eq!(parts, convex_parts(&corners, &triangles, &LAW).unwrap());
    }

    /// Pieces of things that do not touch have no cut in common, and a limit still holds.
    #[test]
    fn separate_things_are_no_more_parts_than_wanted() {
        let (corners, triangles) = ell();
        let at = |place: u32| corners.iter().map(move |corner| *corner + Vec3::X * (0.2 * place as f32));
        let all: Vec<Vec3> = (0..5).flat_map(at).collect();
        let moved = |place: u32| triangles.iter().map(move |t| t.map(|i| i + 12 * place));
        let triangles: Vec<[u32; 3]> = (0..5).flat_map(moved).collect();
        for parts_max in [2, 3, 12] {
            let parts = convex_parts(&all, &triangles, &PartsParams { parts_max, ..LAW }).unwrap();
            assert!(parts.hulls.len() <= parts_max, "{} parts of {parts_max}", parts.hulls.len());
            let [low, high] = bounds_m(parts.hulls.iter().flat_map(Polyhedron::corners_m));
            assert!((high - low - Vec3::new(0.88, 0.08, 0.03)).length() < 1e-3, "nothing is lost: {low} to {high}");
        }
    }

    /// A tube with a plate in its lower end, whose upper face lies in a cut: what is above has no part in it.
    #[test]
    fn shells_that_overlap_do_not_reach_over_a_cut() {
        const SIDES: u32 = 24;
        let at = |radius_m: f32, side: u32, z_m: f32| {
            let (sin, cos) = libm::sincosf(core::f32::consts::TAU * side as f32 / SIDES as f32);
            Vec3::new(radius_m * cos, radius_m * sin, z_m)
        };
        // Rings of corners, each joined to the next by two triangles a side; the last to the first, or both by a fan.
        let (mut corners, mut triangles) = (Vec::new(), Vec::new());
        for (rings, is_closed) in [
            (vec![(0.03, -0.04), (0.03, 0.04), (0.027, 0.04), (0.027, -0.04)], true),
            (vec![(0.0, -0.04), (0.029, -0.04), (0.029, -0.036), (0.0, -0.036)], false),
        ] {
            let first = corners.len() as u32;
            let count = rings.len() as u32;
            corners.extend(rings.iter().flat_map(|(radius_m, z_m)| (0..SIDES).map(|side| at(*radius_m, side, *z_m))));
            for ring in 0..count - u32::from(!is_closed) {
                let corner = |ring: u32, side: u32| first + (ring % count) * SIDES + side % SIDES;
                triangles.extend((0..SIDES).flat_map(|side| {
                    let [a, b] = [corner(ring, side), corner(ring, side + 1)];
                    let [c, d] = [corner(ring + 1, side), corner(ring + 1, side + 1)];
                    [[a, b, d], [a, d, c]]
                }));
            }
        }
        let parts = convex_parts(&corners, &triangles, &PartsParams { parts_max: 1024, ..LAW }).unwrap();
        for hull in &parts.hulls {
            // Above the plate nothing is farther in than the wall and the tolerance.
            let is_above = hull.corners_m().iter().all(|corner| corner.z > -0.0365);
            let inmost_m = hull.corners_m().iter().map(|c| c.truncate().length()).fold(f32::INFINITY, f32::min);
            assert!(!is_above || inmost_m > 0.025, "{inmost_m}: {:?}", hull.corners_m());
        }
        assert!(parts.filled_m < 2.0 * LAW.tolerance_m, "{}", parts.filled_m);
    }

    #[test]
    fn one_part_is_the_hull() {
        let (corners, triangles) = ell();
        let parts = convex_parts(&corners, &triangles, &PartsParams { parts_max: 1, ..LAW }).unwrap();
        let [hull] = &parts.hulls[..] else { panic!("{} parts", parts.hulls.len()) };
        // Five corners of the outline's six.
        let exact = (0.08 * 0.08 - 0.5 * 0.05 * 0.05) * 0.03;
        assert!((hull.volume_m3() / exact - 1.0).abs() < 1e-4, "{}", hull.volume_m3());
        assert_eq!(hull.corners_m().len(), 10);
    }

    #[test]
    fn corners_are_counted_and_what_they_leave_out_is_told() {
        let golden = core::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
        let ball: Vec<Vec3> = (0..2_000)
            .map(|i| {
                let z = 1.0 - (2.0 * i as f32 + 1.0) / 2_000.0;
                let (sin, cos) = libm::sincosf(golden * i as f32);
                0.03 * Vec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
            })
            .collect();
        let of = |corners_max| few_cornered_hull(&ball, corners_max).unwrap();
        let mut last_m = f32::INFINITY;
        for corners_max in [8, 16, 32, 64] {
            let (hull, left_m) = of(corners_max);
            assert!(hull.corners_m().len() <= corners_max);
            assert!(left_m < last_m && left_m > 0.0, "{corners_max} corners leave {left_m} out");
            last_m = left_m;
        }
        assert!(last_m < 0.003, "{last_m}");
    }

    /// What a catalogue does: seven decimals, then the hull again, then once more from the dataset.
    #[test]
    fn parts_stay_hulls_when_they_are_written_and_read_at_any_scale() {
        let mut stream = Stream::new(9, 0, Purpose::Objects, 0);
        for scale in [0.01, 0.015, 0.02, 0.1] {
            for case in 0..20 {
                let (size, turn) = (stream.point(Vec3::splat(0.3), Vec3::splat(4.0)) * scale, stream.rotation());
                // A box with rounded edges: faces that are flat, and faces that are bent a little.
                let mut point = || {
                    let direction = stream.rotation() * Vec3::X;
                    turn * (0.7 * size * direction.signum() + 0.3 * size.min_element() * direction)
                };
                let points: Vec<Vec3> = (0..300).map(|_| point()).collect();
                let (hull, _) = few_cornered_hull(&points, 32).unwrap();
                let written = |x: f32| format!("{x:.7}").parse::<f32>().unwrap();
                let read: Vec<Vec3> =
                    hull.corners_m().iter().map(|corner| Vec3::from_array(corner.to_array().map(written))).collect();
                assert_eq!(read, hull.corners_m(), "{scale} {case}: corners are what a catalogue can write");
                let read = convex_hull(&read).unwrap_or_else(|e| panic!("{scale} {case}: {e}"));
                assert!(convex_hull(read.corners_m()).is_ok() && Polyhedron::hull_of(read.corners_m()).is_ok());
            }
        }
    }

    #[test]
    fn what_has_no_inside_is_refused() {
        let (corners, triangles) = ell();
        let flat: Vec<Vec3> = corners.iter().map(|c| Vec3::new(c.x, c.y, 0.0)).collect();
        assert_eq!(convex_parts(&flat, &triangles, &LAW), Err(HullError::Flat));
        assert_eq!(convex_parts(&[], &[], &LAW), Err(HullError::Flat));
    }

    const AROUND: u32 = 64;

    /// A closed mesh: an outline of radii and heights, in millimetres, turned about z. What touches the axis has
    /// corners there that coincide.
    fn revolved(outline_mm: &[[f32; 2]]) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let about = |[r, z]: [f32; 2]| {
            (0..AROUND).map(move |k| {
                let (sin, cos) = libm::sincosf(2.0 * PI * k as f32 / AROUND as f32);
                Vec3::new(r * cos, r * sin, z) * 1e-3
            })
        };
        let rings = outline_mm.len() as u32;
        let triangles = (0..rings).flat_map(|ring| {
            (0..AROUND).flat_map(move |k| {
                let [a, b] = [k, (k + 1) % AROUND].map(|k| ring * AROUND + k);
                let [d, c] = [k, (k + 1) % AROUND].map(|k| (ring + 1) % rings * AROUND + k);
                [[a, b, c], [a, c, d]]
            })
        });
        (outline_mm.iter().flat_map(|point| about(*point)).collect(), triangles.collect())
    }

    fn quarter(radius_mm: f32, centre_mm: f32) -> impl DoubleEndedIterator<Item = [f32; 2]> {
        (0..=16).map(move |i| {
            let (sin, cos) = libm::sincosf(0.5 * PI * i as f32 / 16.0);
            [radius_mm * sin, centre_mm - radius_mm * cos]
        })
    }

    /// Points on the surface of what was revolved, spread evenly, and the outward normal there.
    fn on_surface(outline_mm: &[[f32; 2]], count: usize) -> Vec<Vec3> {
        let edges: Vec<[[f32; 2]; 2]> =
            outline_mm.iter().zip(outline_mm.iter().cycle().skip(1)).map(|(a, b)| [*a, *b]).collect();
        let area = |[[r0, z0], [r1, z1]]: &[[f32; 2]; 2]| (r0 + r1) * libm::hypotf(r1 - r0, z1 - z0);
        let all: f32 = edges.iter().map(area).sum();
        let mut stream = Stream::new(5, 0, Purpose::Objects, 0);
        let mut points = Vec::new();
        while points.len() < count {
            let mut place = stream.uniform(0.0, all);
            let edge = edges.iter().find(|edge| {
                place -= area(edge);
                place < 0.0
            });
            let [[r0, z0], [r1, z1]] = edge.copied().unwrap_or(edges[0]);
            let along = stream.uniform(0.0, 1.0);
            let (r, z) = (r0 + along * (r1 - r0), z0 + along * (z1 - z0));
            if stream.uniform(0.0, r0.max(r1)) <= r {
                let (sin, cos) = libm::sincosf(stream.uniform(0.0, 2.0 * PI));
                points.push(Vec3::new(r * cos, r * sin, z) * 1e-3);
            }
        }
        points
    }

    /// Asked of points by formula: the parts end where the surface is, on both sides of thin and round walls.
    #[test]
    fn parts_lie_on_the_surface() {
        let ring = vec![[24.0, 0.0], [30.0, 0.0], [30.0, 20.0], [24.0, 20.0]];
        let mug = vec![[0.0, 0.0], [40.0, 0.0], [40.0, 90.0], [37.0, 90.0], [37.0, 4.0], [0.0, 4.0]];
        let bowl = quarter(75.0, 75.0).chain(quarter(72.0, 75.0).rev()).collect();
        let plate = vec![[0.0, 0.0], [60.0, 0.0], [60.0, 1.0], [0.0, 1.0]];
        let ball = quarter(35.0, 35.0).chain(quarter(35.0, 35.0).rev().map(|[r, z]| [r, 70.0 - z])).collect();
        let all = [("ring", ring, 20), ("mug", mug, 40), ("bowl", bowl, 250), ("plate", plate, 2), ("ball", ball, 16)];
        for (name, outline, parts_most) in all {
            let (corners, triangles) = revolved(&outline);
            let parts = convex_parts(&corners, &triangles, &LAW).unwrap();
            let planes: Vec<Vec<Plane>> = parts.hulls.iter().map(|part| part.planes().collect()).collect();
            let off_m = |at: &Vec3| {
                let outside =
                    |p: &Vec<Plane>| p.iter().map(|p| p.normal.dot(*at) - p.offset_m).fold(f32::MIN, f32::max);
                planes.iter().map(outside).fold(f32::INFINITY, f32::min).abs()
            };
            let points = on_surface(&outline, 5_000);
            let far = points.iter().filter(|at| off_m(at) > 0.001).count();
            let count = parts.hulls.len();
            assert!(far <= 25, "{name}: {far} of {} points are more than 1 mm off {count} parts", points.len());
            assert!(
                count <= parts_most && parts.hulls.iter().all(|part| part.corners_m().len() <= 32),
                "{name}: {count}"
            );
            let volume: f32 = parts.hulls.iter().map(Polyhedron::volume_m3).sum();
            let exact: f32 = outline
                .iter()
                .zip(outline.iter().cycle().skip(1))
                .map(|([r0, z0], [r1, z1])| {
                    // Pappus: the ring that an edge and the axis enclose.
                    PI * (z1 - z0) * (r0 * r0 + r0 * r1 + r1 * r1) / 3.0 * 1e-9
                })
                .sum();
            assert!((volume / exact - 1.0).abs() < 0.2, "{name}: {volume} of {exact} m³");
        }
    }
}
