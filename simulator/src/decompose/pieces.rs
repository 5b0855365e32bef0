//! A mesh in convex pieces, by cuts along planes until the hull of each piece lies on the mesh's surface.
//!
//! The piece whose hull leaves the surface most is cut next. Where to cut is tried: through its middle and through the
//! worst point, along axes and along the faces there; the cut that leaves the least volume wins. A cut divides
//! triangles, so no piece reaches into another, and what the mesh fills, and nothing else, is filled up to the
//! tolerance.

use std::collections::BTreeMap;

use glamx::{DMat3, DSymmetricEigen3, DVec3};
use schema::{Plane, Vec3, bounds_m};

use super::{Hull, PartsParams, hull, left_out_m};

/// Points this near to a plane are on it, as a share of the mesh's size.
const ON_PLANE_SHARE: f32 = 1e-6;
/// Directions along which the outermost points of a piece stand for all of them while cuts are compared.
const DIRECTIONS: usize = 48;
/// Faces that may be extended to a cut, and how finely their normals are told apart.
const FACES: usize = 6;
const NORMAL_STEPS: f32 = 50.0;
/// A cut leaves at least this share of a piece's length on each side.
const SHARE_MIN: f32 = 0.02;
/// Of cuts that leave as little, the more even one is taken: what the larger part counts beside the sum.
const EVENNESS: f32 = 0.1;
/// Two pieces are joined if their hull fills no more beside them than this share of the tolerance before their surface.
const FILLED_SHARE: f32 = 0.35;
/// Pieces are cut into so many times more than are wanted, because many are joined; where too many are left, they are
/// joined again with a tolerance that is so many times as large.
const CUT_TIMES: usize = 4;
const COARSER: f32 = 1.1;
/// Triangles of a piece by which cuts are compared.
const TRIANGLES: usize = 1_500;

/// A piece of a mesh: what is left of its triangles, and the outlines of the cuts.
#[derive(Debug, Clone, Default)]
struct Piece {
    /// Corners as numbers.
    triangles: Vec<[u32; 3]>,
    /// The outlines of the cuts: the plane's number, and the ends.
    outlines: Vec<(u32, [u32; 2])>,
    /// The planes that bound it, by number; it lies on the side from which the sign is −1 or 1 times the normal.
    cuts: Vec<(u32, f32)>,
}

/// A piece, its hull, and how far that leaves the surface.
struct Measured {
    piece: Piece,
    /// By how much it is too far off, in metres, and the triangle where it is.
    worst_m: f32,
    worst: usize,
    /// How far the surface lies inside of the hull, in metres.
    filled_m: f32,
    /// The hull's corners; none if it is too far off.
    corners_m: Vec<Vec3>,
    volume_m3: f32,
    area_m2: f32,
    bounds_m: [Vec3; 2],
}

/// All points and planes.
struct Cutter<'a> {
    params: &'a PartsParams,
    tolerance_m: f32,
    points_m: Vec<Vec3>,
    planes: Vec<Plane>,
    on_plane_m: f32,
    directions: Vec<Vec3>,
}

/// The pieces of a mesh: so many that their hulls leave its surface by no more than the tolerance, if not too many. Of
/// each the corners of its hull, and how far the surface lies inside of that, in metres.
pub(super) fn pieces(corners_m: &[Vec3], triangles: &[[u32; 3]], params: &PartsParams) -> Vec<(Vec<Vec3>, f32)> {
    let [low, high] = bounds_m(corners_m);
    let size_m = (high - low).max_element();
    let golden = core::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
    let direction = |i: usize| {
        let z = 1.0 - (2.0 * i as f32 + 1.0) / DIRECTIONS as f32;
        let (sin, cos) = libm::sincosf(golden * i as f32);
        Vec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
    };
    let mut cutter = Cutter {
        params,
        tolerance_m: params.tolerance_m,
        points_m: corners_m.to_vec(),
        planes: Vec::new(),
        on_plane_m: ON_PLANE_SHARE * size_m,
        directions: (0..DIRECTIONS).map(direction).chain([Vec3::X, Vec3::Y, Vec3::Z]).collect(),
    };
    let whole = Piece { triangles: triangles.to_vec(), ..Piece::default() };
    let mut all = vec![cutter.measured(whole)];
    while all.len() < CUT_TIMES * params.parts_max {
        let worst = (0..all.len()).max_by(|a, b| all[*a].worst_m.total_cmp(&all[*b].worst_m));
        let Some(worst) = worst.filter(|number| all[*number].worst_m > 0.0) else { break };
        match cutter.cut(&all[worst]) {
            Some(halves) => {
                all.swap_remove(worst);
                all.extend(halves.map(|half| cutter.measured(half)));
            }
            None => all[worst].worst_m = 0.0,
        }
    }
    let mut all = cutter.joined(all);
    while all.len() > params.parts_max && cutter.tolerance_m < size_m {
        cutter.tolerance_m *= COARSER;
        all = cutter.joined(all);
    }
    // What touches nothing, as separate things in one mesh, is joined to what is left in the end.
    while all.len() > params.parts_max.max(1) {
        let smallest = (0..all.len()).min_by(|a, b| all[*a].volume_m3.total_cmp(&all[*b].volume_m3)).unwrap_or(0);
        let small = all.swap_remove(smallest);
        let away_m2 = |one: &Measured| (one.middle_m() - small.middle_m()).length_squared();
        let nearest = (0..all.len()).min_by(|a, b| away_m2(&all[*a]).total_cmp(&away_m2(&all[*b]))).unwrap_or(0);
        all[nearest] = cutter.measured(cutter.united(&all[nearest].piece, &small.piece));
    }
    let finished = |Measured { piece, corners_m, filled_m, .. }: Measured| {
        let corners_m = if corners_m.is_empty() { cutter.all_m(&cutter.points_of(&piece)) } else { corners_m };
        (corners_m, filled_m)
    };
    all.into_iter().map(finished).collect()
}

impl Measured {
    fn middle_m(&self) -> Vec3 {
        0.5 * (self.bounds_m[0] + self.bounds_m[1])
    }
}

impl Cutter<'_> {
    fn all_m(&self, points: &[u32]) -> Vec<Vec3> {
        points.iter().map(|point| self.points_m[*point as usize]).collect()
    }

    /// The numbers of a piece's points.
    fn points_of(&self, piece: &Piece) -> Vec<u32> {
        let ends = piece.outlines.iter().flat_map(|(_, ends)| ends);
        let mut points: Vec<u32> = piece.triangles.as_flattened().iter().chain(ends).copied().collect();
        points.sort_unstable();
        points.dedup();
        points
    }

    /// The outermost of some points along many directions.
    fn outermost(&self, points: &[u32]) -> Vec<Vec3> {
        let at = |point: &u32| self.points_m[*point as usize];
        let along = |direction: &Vec3| {
            let mut ends = [(f32::INFINITY, 0), (f32::NEG_INFINITY, 0)];
            for point in points {
                let reach = direction.dot(at(point));
                if reach < ends[0].0 {
                    ends[0] = (reach, *point);
                }
                if reach > ends[1].0 {
                    ends[1] = (reach, *point);
                }
            }
            ends.map(|(_, point)| point)
        };
        let mut outermost: Vec<u32> = self.directions.iter().flat_map(along).collect();
        outermost.sort_unstable();
        outermost.dedup();
        outermost.iter().map(at).collect()
    }

    fn measured(&self, piece: Piece) -> Measured {
        let points = self.points_of(&piece);
        let rough = hull(&self.outermost(&points));
        self.measured_after(piece, &points, rough)
    }

    /// Measures a piece: first by the hull of its outermost points, `rough`, which lies within its own.
    fn measured_after(&self, piece: Piece, points: &[u32], rough: Option<Hull>) -> Measured {
        let area_m2 = piece.triangles.iter().map(|triangle| 0.5 * self.across(triangle).length()).sum();
        let bounds_m = bounds_m(points.iter().map(|point| &self.points_m[*point as usize]));
        let blank = Measured {
            piece,
            worst_m: -self.tolerance_m,
            worst: 0,
            filled_m: 0.0,
            corners_m: Vec::new(),
            volume_m3: 0.0,
            area_m2,
            bounds_m,
        };
        let with = |hull: &Hull| {
            let (filled_m, worst) = self.worst(&blank.piece, hull.planes());
            (filled_m, worst, hull.volume_m3() as f32)
        };
        if let Some((filled_m, worst, volume_m3)) = rough.as_ref().map(with).filter(|(m, ..)| *m > self.tolerance_m) {
            let worst_m = filled_m - self.tolerance_m;
            return Measured { worst_m, worst, filled_m, volume_m3, ..blank };
        }
        let points_m = self.all_m(points);
        let Some(hull) = hull(&points_m) else { return Measured { corners_m: points_m, ..blank } };
        let (filled_m, worst, volume_m3) = with(&hull);
        let left_m = left_out_m(&hull.corners_m, self.params.corners_max, self.tolerance_m);
        let worst_m = filled_m.max(left_m) - self.tolerance_m;
        Measured { worst_m, worst, filled_m, corners_m: hull.corners_m, volume_m3, ..blank }
    }

    /// The product of two sides of a triangle: twice its area, outwards.
    fn across(&self, triangle: &[u32; 3]) -> Vec3 {
        let [a, b, c] = triangle.map(|corner| self.points_m[corner as usize]);
        (b - a).cross(c - a)
    }

    /// How far the surface lies inside of a hull, seen from faces that are no cuts, and the triangle.
    fn worst(&self, piece: &Piece, planes: impl Iterator<Item = Plane>) -> (f32, usize) {
        let is_cut = |plane: &Plane| {
            piece.cuts.iter().any(|(cut, sign)| {
                let Plane { normal, offset_m } = self.planes[*cut as usize];
                plane.normal.dot(normal) * sign > 0.9999 && (plane.offset_m - sign * offset_m).abs() < 1e-5
            })
        };
        let (cuts, faces): (Vec<Plane>, Vec<Plane>) = planes.partition(is_cut);
        let below_m = |planes: &[Plane], at_m: Vec3| {
            planes.iter().map(|plane| plane.offset_m - plane.normal.dot(at_m)).fold(f32::INFINITY, f32::min)
        };
        // What is beside a cut is seen by the piece beyond, too; but a thin slice along a face is no hollow.
        let inside_m = |at_m: Vec3| {
            let beyond_m = 2.0 * below_m(&cuts, at_m).max(0.0) + 0.5 * self.tolerance_m;
            below_m(&faces, at_m).min(beyond_m)
        };
        let is_on = |plane: &Plane, at_m: &Vec3| (plane.offset_m - plane.normal.dot(*at_m)).abs() < 1e-5;
        let mut worst = (0.0, 0);
        for (number, triangle) in piece.triangles.iter().enumerate() {
            let corners = triangle.map(|corner| self.points_m[corner as usize]);
            // A cut along a face leaves that face on the surface.
            if cuts.iter().any(|cut| corners.iter().all(|corner| is_on(cut, corner))) {
                continue;
            }
            let depth_m = inside_m((corners[0] + corners[1] + corners[2]) / 3.0);
            let depth_m = corners.into_iter().map(inside_m).fold(depth_m, f32::max);
            if depth_m.is_finite() && depth_m > worst.0 {
                worst = (depth_m, number);
            }
        }
        worst
    }

    /// Joins pieces again that need not have been cut: greedy cuts leave many.
    fn joined(&self, mut all: Vec<Measured>) -> Vec<Measured> {
        let mut first = 0;
        while first < all.len() {
            let mut second = first + 1;
            while second < all.len() {
                match self.as_one(&all[first], &all[second]) {
                    Some(both) => {
                        all[first] = both;
                        all.remove(second);
                        // What was tried before may fit now.
                        second = first + 1;
                    }
                    None => second += 1,
                }
            }
            first += 1;
        }
        all
    }

    /// Two pieces as one, if that is within the tolerance, and if they fill their common hull but for what the
    /// tolerance leaves before their surface: it might reach into a third piece.
    fn as_one(&self, a: &Measured, b: &Measured) -> Option<Measured> {
        let most_m3 = a.volume_m3 + b.volume_m3 + FILLED_SHARE * self.tolerance_m * (a.area_m2 + b.area_m2);
        if !self.boxes_meet(a.bounds_m, b.bounds_m) || !self.touch(&a.piece, &b.piece) {
            return None;
        }
        let piece = self.united(&a.piece, &b.piece);
        let points = self.points_of(&piece);
        let rough = hull(&self.outermost(&points)).filter(|rough| rough.volume_m3() as f32 <= most_m3)?;
        Some(self.measured_after(piece, &points, Some(rough)))
            .filter(|both| both.worst_m <= 0.0 && both.volume_m3 <= most_m3)
    }

    /// Whether two pieces touch at a cut.
    fn touch(&self, a: &Piece, b: &Piece) -> bool {
        let touches = |cut: &(u32, f32)| b.cuts.iter().any(|other| other.0 == cut.0 && other.1 != cut.1);
        let Some((common, _)) = a.cuts.iter().copied().find(touches) else { return false };
        let bounds = |piece: &Piece| {
            let ends = piece.outlines.iter().filter(|(cut, _)| *cut == common).flat_map(|(_, ends)| *ends);
            bounds_m(ends.map(|end| &self.points_m[end as usize]))
        };
        self.boxes_meet(bounds(a), bounds(b))
    }

    fn boxes_meet(&self, [a_low, a_high]: [Vec3; 2], [b_low, b_high]: [Vec3; 2]) -> bool {
        let room = Vec3::splat(self.on_plane_m);
        (a_low - room).cmple(b_high).all() && (b_low - room).cmple(a_high).all()
    }

    /// Two pieces as one, bounded by those of their cuts that do not part them.
    fn united(&self, a: &Piece, b: &Piece) -> Piece {
        let mut both = Piece {
            triangles: [&a.triangles[..], &b.triangles].concat(),
            outlines: [&a.outlines[..], &b.outlines].concat(),
            cuts: Vec::new(),
        };
        let points = self.points_of(&both);
        let bounds = |(cut, sign): &(u32, f32)| {
            let Plane { normal, offset_m } = self.planes[*cut as usize];
            let above_m = |point: &u32| sign * (normal.dot(self.points_m[*point as usize]) - offset_m);
            points.iter().all(|point| above_m(point) <= 2.0 * self.on_plane_m)
        };
        both.cuts = a.cuts.iter().chain(&b.cuts).filter(|cut| bounds(cut)).copied().collect();
        both
    }

    /// The best cut of a piece; `None` if there is none.
    fn cut(&mut self, measured: &Measured) -> Option<[Piece; 2]> {
        let points = self.points_of(&measured.piece);
        if points.is_empty() {
            return None;
        }
        let mut best: Option<(f32, Plane)> = None;
        for plane in self.candidates(measured, &points) {
            let left = self.left_m3(&measured.piece, &plane);
            if let Some(left) = left.filter(|left| best.is_none_or(|(least, _)| *left < least)) {
                best = Some((left, plane));
            }
        }
        let (_, plane) = best?;
        let number = self.planes.len() as u32;
        self.planes.push(plane);
        let halves = self.divided(&measured.piece, number);
        halves.iter().all(|half| !half.triangles.is_empty() || half.outlines.len() > 2).then_some(halves)
    }

    /// Planes that may be cuts: through the middle of a piece, across its axes and the mesh's; through its worst point,
    /// across its axes; and along the largest of the faces that lie inside of its hull.
    fn candidates(&self, measured: &Measured, points: &[u32]) -> Vec<Plane> {
        let Measured { piece, worst, .. } = measured;
        let at = |point: &u32| self.points_m[*point as usize];
        let middle_m = measured.middle_m();
        let axes = self.axes_of(piece);
        let mut wanted: Vec<(Vec3, Vec3)> =
            [Vec3::X, Vec3::Y, Vec3::Z].into_iter().chain(axes).map(|axis| (axis, middle_m)).collect();
        if let Some(worst) = piece.triangles.get(*worst) {
            let worst_m = worst.iter().map(at).sum::<Vec3>() / 3.0;
            wanted.extend(axes.map(|axis| (axis, worst_m)));
        }
        wanted.extend(self.hidden_faces(piece, points));
        let plane = |(normal, at_m): (Vec3, Vec3)| {
            let normal = normal.try_normalize()?;
            let [low, high] = points
                .iter()
                .map(|point| normal.dot(at(point)))
                .fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], reach| [low.min(reach), high.max(reach)]);
            let (offset_m, least_m) = (normal.dot(at_m), SHARE_MIN * (high - low));
            (offset_m > low + least_m && offset_m < high - least_m).then_some(Plane { normal, offset_m })
        };
        wanted.into_iter().filter_map(plane).collect()
    }

    /// The largest flat faces that do not lie on the hull: their normals, and a point of each.
    fn hidden_faces(&self, piece: &Piece, points: &[u32]) -> Vec<(Vec3, Vec3)> {
        let Some(hull) = hull(&self.outermost(points)) else { return Vec::new() };
        let planes: Vec<Plane> = hull.planes().collect();
        let mut faces: BTreeMap<[i32; 4], (f32, Vec3, Vec3)> = BTreeMap::new();
        for triangle in &piece.triangles {
            let [a, b, c] = triangle.map(|corner| self.points_m[corner as usize]);
            let (across, middle_m) = (self.across(triangle), (a + b + c) / 3.0);
            let is_hidden = planes.iter().all(|p| p.offset_m - p.normal.dot(middle_m) > self.tolerance_m);
            if let Some(normal) = across.try_normalize().filter(|_| is_hidden) {
                let [x, y, z] = (normal * NORMAL_STEPS).round().to_array().map(|x| x as i32);
                let key = [x, y, z, (normal.dot(a) / self.tolerance_m).round() as i32];
                faces.entry(key).or_insert((0.0, normal, a)).0 += across.length();
            }
        }
        let mut faces: Vec<([i32; 4], (f32, Vec3, Vec3))> = faces.into_iter().collect();
        faces.sort_by(|(one, (a, ..)), (other, (b, ..))| b.total_cmp(a).then(one.cmp(other)));
        faces.into_iter().take(FACES).map(|(_, (_, normal, at_m))| (normal, at_m)).collect()
    }

    /// The principal axes of a piece's surface.
    fn axes_of(&self, piece: &Piece) -> [Vec3; 3] {
        let spread = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|corner| self.points_m[corner as usize].as_dvec3());
            let area_m2 = (b - a).cross(c - a).length();
            [a + b, b + c, c + a].map(|twice_m| (0.5 * twice_m, area_m2))
        };
        // Weighed on the middles of their sides, triangles have their own moments.
        let all: Vec<(DVec3, f64)> = piece.triangles.iter().flat_map(spread).collect();
        let sum_m2: f64 = all.iter().map(|(_, weight)| weight).sum();
        let middle_m = all.iter().map(|(at_m, weight)| *at_m * *weight).sum::<DVec3>() / sum_m2;
        let moment = |(at_m, weight): &(DVec3, f64)| {
            let off_m = *at_m - middle_m;
            DMat3::from_cols(off_m * off_m.x, off_m * off_m.y, off_m * off_m.z) * (*weight / sum_m2)
        };
        let moments = all.iter().map(moment).fold(DMat3::ZERO, |sum, one| sum + one);
        let axes = DSymmetricEigen3::new(moments).eigenvectors;
        [axes.x_axis, axes.y_axis, axes.z_axis].map(|axis| axis.as_vec3())
    }

    /// What volume the hulls of both sides would have, with something for an uneven cut.
    fn left_m3(&self, piece: &Piece, plane: &Plane) -> Option<f32> {
        let above_m = |point: u32| plane.normal.dot(self.points_m[point as usize]) - plane.offset_m;
        let mut sides: [Vec<u32>; 2] = [Vec::new(), Vec::new()];
        let mut crossings_m: Vec<Vec3> = Vec::new();
        // Of very many triangles some stand for all.
        let some = piece.triangles.iter().step_by(piece.triangles.len().div_ceil(TRIANGLES).max(1));
        let edges = some.flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]);
        for [a, b] in edges.chain(piece.outlines.iter().map(|(_, ends)| *ends)) {
            let [from_m, to_m] = [a, b].map(above_m);
            sides[usize::from(from_m > 0.0)].push(a);
            sides[usize::from(to_m > 0.0)].push(b);
            if (from_m > 0.0) != (to_m > 0.0) {
                let [start, end] = [a, b].map(|point| self.points_m[point as usize]);
                crossings_m.push(start + (end - start) * (from_m / (from_m - to_m)));
            }
        }
        let crossed_m = self.outermost_of(&crossings_m);
        let mut volumes_m3 = [0.0; 2];
        for (side, volume_m3) in sides.iter_mut().zip(&mut volumes_m3) {
            if side.is_empty() {
                return None;
            }
            side.sort_unstable();
            side.dedup();
            let mut points_m = self.outermost(side);
            points_m.extend(&crossed_m);
            *volume_m3 = hull(&points_m).map_or(0.0, |hull| hull.volume_m3() as f32);
        }
        Some(volumes_m3[0] + volumes_m3[1] + EVENNESS * volumes_m3[0].max(volumes_m3[1]))
    }

    fn outermost_of(&self, points_m: &[Vec3]) -> Vec<Vec3> {
        let farthest = |direction: &Vec3, sign: f32| {
            points_m.iter().copied().max_by(|a, b| (sign * direction.dot(*a)).total_cmp(&(sign * direction.dot(*b))))
        };
        self.directions.iter().flat_map(|d| [farthest(d, 1.0), farthest(d, -1.0)]).flatten().collect()
    }

    /// Both sides of a piece, below and above a plane.
    fn divided(&mut self, piece: &Piece, number: u32) -> [Piece; 2] {
        let plane = self.planes[number as usize];
        let side = |sign: f32| Piece {
            cuts: piece.cuts.iter().copied().chain([(number, sign)]).collect(),
            ..Piece::default()
        };
        let mut sides = [side(1.0), side(-1.0)];
        let mut crossings = Crossings { known: BTreeMap::new(), plane, on_plane_m: self.on_plane_m };
        for triangle in &piece.triangles {
            let above = triangle.map(|corner| crossings.above(self.points_m[corner as usize]));
            if above.iter().all(|m| *m == 0.0) {
                let [a, b, c] = triangle.map(|corner| self.points_m[corner as usize]);
                let area_m2 = (b - a).cross(c - a).dot(plane.normal);
                // A sliver has no side: its sign is chance, and on the wrong side it would be a surface far away.
                let longest_m = (b - a).length().max((c - a).length()).max((c - b).length());
                if area_m2.abs() > self.on_plane_m * longest_m {
                    let is_top_of_lower = area_m2 > 0.0;
                    sides[usize::from(!is_top_of_lower)].triangles.push(*triangle);
                }
                continue;
            }
            let (polygons, on_plane) = crossings.outline(*triangle, above, &mut self.points_m);
            for (half, polygon) in sides.iter_mut().zip(&polygons) {
                (2..polygon.len()).for_each(|i| half.triangles.push([polygon[0], polygon[i - 1], polygon[i]]));
                // A triangle that ends at the plane has no part in what is on the other side.
                if let (&[a, b], 3..) = (&on_plane[..], polygon.len()) {
                    half.outlines.push((number, [a, b]));
                }
            }
        }
        self.divide_outlines(piece, number, &mut crossings, &mut sides);
        sides
    }

    /// The outlines of older cuts, and the line along which the new cut meets each of them.
    fn divide_outlines(&mut self, piece: &Piece, number: u32, crossings: &mut Crossings, sides: &mut [Piece; 2]) {
        let mut met: [BTreeMap<u32, Vec<u32>>; 2] = Default::default();
        for (cut, [a, b]) in &piece.outlines {
            let [from_m, to_m] = [a, b].map(|end| crossings.above(self.points_m[*end as usize]));
            let (lower, upper) = if from_m < to_m { (*a, *b) } else { (*b, *a) };
            let at = match from_m * to_m < 0.0 {
                true => Some(crossings.between([*a, *b], [from_m, to_m], &mut self.points_m)),
                false => [(from_m, *a), (to_m, *b)].into_iter().find(|(m, _)| *m == 0.0).map(|(_, end)| end),
            };
            if from_m.min(to_m) < 0.0 {
                sides[0].outlines.push((*cut, [lower, at.unwrap_or(upper)]));
            }
            if from_m.max(to_m) > 0.0 {
                sides[1].outlines.push((*cut, [at.unwrap_or(lower), upper]));
            }
            // For a half an end on the plane is on the other side: an outline that passes there crosses once, one that
            // turns back twice or never, and one of the other half alone never.
            let within = [[from_m < 0.0, to_m < 0.0], [from_m > 0.0, to_m > 0.0]];
            for (met, [from, to]) in met.iter_mut().zip(within) {
                if from != to {
                    met.entry(*cut).or_default().extend(at);
                }
            }
        }
        for (half, met) in sides.iter_mut().zip(met) {
            for (cut, mut points) in met {
                let line = self.planes[cut as usize].normal.cross(self.planes[number as usize].normal);
                let along_m = |point: &u32| line.dot(self.points_m[*point as usize]);
                points.sort_by(|a, b| along_m(a).total_cmp(&along_m(b)));
                let pairs = points.chunks_exact(2).flat_map(|pair| [cut, number].map(|of| (of, [pair[0], pair[1]])));
                half.outlines.extend(pairs);
            }
        }
    }
}

/// The points where edges cross a plane; an edge of two triangles is crossed at one point.
struct Crossings {
    known: BTreeMap<[u32; 2], u32>,
    plane: Plane,
    on_plane_m: f32,
}

impl Crossings {
    fn above(&self, at_m: Vec3) -> f32 {
        let above_m = self.plane.normal.dot(at_m) - self.plane.offset_m;
        if above_m.abs() <= self.on_plane_m { 0.0 } else { above_m }
    }

    fn between(&mut self, [a, b]: [u32; 2], [from_m, to_m]: [f32; 2], points_m: &mut Vec<Vec3>) -> u32 {
        let ([a, b], [from_m, to_m]) = if a < b { ([a, b], [from_m, to_m]) } else { ([b, a], [to_m, from_m]) };
        *self.known.entry([a, b]).or_insert_with(|| {
            let [start, end] = [a, b].map(|point| points_m[point as usize]);
            points_m.push(start + (end - start) * (from_m / (from_m - to_m)));
            points_m.len() as u32 - 1
        })
    }

    /// A triangle that is cut: the polygons below and above, and the points on the plane.
    fn outline(
        &mut self,
        triangle: [u32; 3],
        above_m: [f32; 3],
        points_m: &mut Vec<Vec3>,
    ) -> ([Vec<u32>; 2], Vec<u32>) {
        let (mut sides, mut on_plane) = ([Vec::new(), Vec::new()], Vec::new());
        for i in 0..3 {
            let (j, corner) = ((i + 1) % 3, triangle[i]);
            if above_m[i] <= 0.0 {
                sides[0].push(corner);
            }
            if above_m[i] >= 0.0 {
                sides[1].push(corner);
            }
            if above_m[i] == 0.0 {
                on_plane.push(corner);
            } else if above_m[i] * above_m[j] < 0.0 {
                let at = self.between([corner, triangle[j]], [above_m[i], above_m[j]], points_m);
                sides.iter_mut().for_each(|side| side.push(at));
                on_plane.push(at);
            }
        }
        (sides, on_plane)
    }
}
