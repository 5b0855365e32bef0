//! Convex parts for a triangle mesh: parry's voxel decomposition, merged where a cut gained nothing, with few corners.
//!
//! The decomposition cuts along voxels and takes the hull of the surface in each piece. It makes more pieces than
//! requested and never merges, so pieces are merged here, first the pair whose common hull adds the least volume. Every
//! face and edge of a part is an axis of the collision test, so the number of corners is limited; the resulting
//! deviation is reported.

use parry3d::transformation::try_convex_hull;
use parry3d::transformation::vhacd::{VHACD, VHACDParameters};
use schema::{HullError, Plane, Polyhedron, Vec3, bounds_m};

use crate::convex_hull::convex_hull;

mod trim;

/// Parts are merged if their common hull adds no more than this share of the volume of all parts.
const JOIN_SHARE: f64 = 0.002;
/// The decomposition is asked for at least this many pieces: merging considers all pairs, a cut only one piece.
const PIECES_MIN: usize = 64;
/// Points of the mesh may lie outside a simplified part by at most this share of the mesh's size.
const FLAT_SHARE: f32 = 2e-4;
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
    /// Voxels along the mesh's longest side.
    pub resolution: u32,
    /// A piece is cut further if its hull exceeds the piece by more than this share of the volume of the mesh's hull.
    pub concavity: f32,
    /// Whether the mesh is closed: then what several parts fill and the mesh does not is cut off.
    pub is_closed: bool,
}

/// A mesh as convex parts.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvexParts {
    /// The parts, in the mesh's frame.
    pub hulls: Vec<Polyhedron>,
    /// Largest distance in metres by which points lie outside the faces of their simplified part.
    pub simplified_m: f32,
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
    if !corners_m.iter().all(|c| c.is_finite()) {
        return Err(HullError::Corner);
    }
    if size_m <= 0.0 {
        return Err(HullError::Flat);
    }
    let tolerance_m = FLAT_SHARE * size_m;
    let mut parts = ConvexParts { hulls: Vec::new(), simplified_m: 0.0 };
    for piece in pieces(corners_m, triangles, [low, Vec3::splat(size_m)], params)? {
        // A piece without volume is skipped; the volume of the parts shows the loss.
        let Ok((hull, left_m)) = simplified(&piece.corners_m, params.corners_max, tolerance_m) else { continue };
        parts.simplified_m = parts.simplified_m.max(left_m);
        parts.hulls.push(hull);
    }
    if parts.hulls.is_empty() {
        return Err(HullError::Flat);
    }
    if params.is_closed && params.parts_max > 1 {
        parts.hulls = trim::trimmed(parts.hulls, corners_m, triangles, params.corners_max);
    }
    Ok(parts)
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
    simplified(&Piece::of(points_m.to_vec())?.corners_m, corners_max, FLAT_SHARE * (high - low).max_element())
}

/// Volume of the convex hull of some points, in cubic metres.
///
/// # Errors
/// [`HullError`] if the points have no hull.
pub fn hull_volume_m3(points_m: &[Vec3]) -> Result<f64, HullError> {
    Piece::of(points_m.to_vec()).map(|piece| piece.volume_m3)
}

/// A convex piece: corners of its hull, in metres, and its volume.
#[derive(Debug, Clone)]
struct Piece {
    corners_m: Vec<Vec3>,
    volume_m3: f64,
}

impl Piece {
    fn of(points_m: Vec<Vec3>) -> Result<Self, HullError> {
        let (corners_m, triangles) = try_convex_hull(&points_m).map_err(|_| HullError::Flat)?;
        let from = corners_m[0];
        let below = |[a, b, c]: [u32; 3]| {
            let [a, b, c] = [a, b, c].map(|i| corners_m[i as usize] - from);
            f64::from(a.dot(b.cross(c))) / 6.0
        };
        let volume_m3 = triangles.into_iter().map(below).sum();
        Ok(Self { corners_m, volume_m3 })
    }

    fn with(&self, other: &Self) -> Result<Self, HullError> {
        Self::of(self.corners_m.iter().chain(&other.corners_m).copied().collect())
    }
}

/// At most `params.parts_max` convex pieces that together contain the mesh.
fn pieces(
    corners_m: &[Vec3],
    triangles: &[[u32; 3]],
    [low, size]: [Vec3; 2],
    params: &PartsParams,
) -> Result<Vec<Piece>, HullError> {
    let whole = Piece::of(corners_m.to_vec())?;
    if params.parts_max <= 1 {
        return Ok(vec![whole]);
    }
    // In units of the mesh's size: the decomposition's own tolerances are absolute.
    let unit: Vec<Vec3> = corners_m.iter().map(|c| (*c - low) / size).collect();
    let parameters = VHACDParameters {
        resolution: params.resolution,
        concavity: params.concavity,
        max_convex_hulls: params.parts_max.max(PIECES_MIN) as u32,
        plane_downsampling: 2,
        convex_hull_downsampling: 2,
        ..VHACDParameters::default()
    };
    let hulls = VHACD::decompose(&parameters, &unit, triangles, true).compute_exact_convex_hulls(&unit, triangles);
    let in_metres = |points: Vec<Vec3>| points.into_iter().map(|p| low + p * size).collect();
    let cut: Vec<Piece> = hulls.into_iter().filter_map(|(points, _)| Piece::of(in_metres(points)).ok()).collect();
    if cut.is_empty() { Ok(vec![whole]) } else { Ok(joined(cut, params.parts_max)) }
}

/// Merges pieces until there are few enough and no pair can be replaced by its common hull.
fn joined(mut pieces: Vec<Piece>, parts_max: usize) -> Vec<Piece> {
    let all_m3: f64 = pieces.iter().map(|piece| piece.volume_m3).sum();
    // The volume that a pair's common hull adds; infinite for a pair without a hull.
    let added = |a: &Piece, b: &Piece| a.with(b).map_or(f64::INFINITY, |c| c.volume_m3 - a.volume_m3 - b.volume_m3);
    let mut costs: Vec<Vec<f64>> =
        (0..pieces.len()).map(|i| (0..i).map(|j| added(&pieces[i], &pieces[j])).collect()).collect();
    loop {
        let pairs = costs.iter().enumerate().flat_map(|(i, row)| row.iter().enumerate().map(move |(j, c)| (*c, i, j)));
        let Some((cost, late, early)) = pairs.min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        let is_free = cost <= JOIN_SHARE * all_m3;
        if !(is_free || pieces.len() > parts_max) {
            break;
        }
        let Ok(both) = pieces[late].with(&pieces[early]) else { break };
        pieces.remove(late);
        costs.remove(late);
        costs.iter_mut().skip(late).for_each(|row| _ = row.remove(late));
        pieces[early] = both;
        for other in 0..pieces.len() {
            match other.cmp(&early) {
                std::cmp::Ordering::Less => costs[early][other] = added(&pieces[early], &pieces[other]),
                std::cmp::Ordering::Greater => costs[other][early] = added(&pieces[other], &pieces[early]),
                std::cmp::Ordering::Equal => {}
            }
        }
    }
    pieces
}

/// A hull with few corners: the outermost points along a few axes, then repeatedly the point farthest outside.
fn simplified(points_m: &[Vec3], corners_max: usize, tolerance_m: f32) -> Result<(Polyhedron, f32), HullError> {
    let points_m = &points_m.iter().map(|point| (*point * STEPS_PER_M).round() / STEPS_PER_M).collect::<Vec<_>>();
    let (mut chosen, mut hull) = beginning(points_m)?;
    let mut is_left = vec![true; points_m.len()];
    loop {
        let planes: Vec<Plane> = hull.planes().collect();
        let outside = |p: &Vec3| planes.iter().map(|plane| plane.normal.dot(*p) - plane.offset_m).fold(0.0, f32::max);
        let all = points_m.iter().map(outside);
        let left_m = all.clone().fold(0.0, f32::max);
        let furthest =
            all.enumerate().filter(|(i, _)| is_left[*i]).max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
        let Some((next, _)) = furthest.filter(|(_, m)| *m > tolerance_m && hull.corners_m().len() < corners_max) else {
            return Ok((hull, left_m));
        };
        is_left[next] = false;
        chosen.push(points_m[next]);
        // A point that would make almost coplanar faces is not added and counts as lying outside.
        match lasting_hull(&chosen) {
            Ok(larger) if larger.corners_m().len() <= corners_max => hull = larger,
            _ => drop(chosen.pop()),
        }
    }
}

/// A hull that stays one when it is read again: its corners in their new order, once from a catalogue and once from a
/// dataset, and as it is drawn. Whether almost coplanar faces are told apart depends on the order.
fn lasting_hull(points_m: &[Vec3]) -> Result<Polyhedron, HullError> {
    let hull = convex_hull(points_m)?;
    let read = convex_hull(hull.corners_m())?;
    convex_hull(read.corners_m())?;
    Polyhedron::hull_of(read.corners_m())?;
    Ok(hull)
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
    use schema::{Purpose, Stream};

    use super::*;

    const LAW: PartsParams =
        PartsParams { parts_max: 8, corners_max: 32, resolution: 64, concavity: 0.01, is_closed: true };

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
}
