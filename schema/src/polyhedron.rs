//! Convex polyhedra: corners, flat faces, edges, volume.
//!
//! The hull of some points is first made of triangles. Coplanar triangles become one face with its corners in order, so
//! that the hull of a box has six faces and not twelve: contacts, rays, collision tests and pictures all use faces.

use crate::hull::triangles_of_hull;
use crate::solid::sides;
use crate::{Plane, Pose, Solid, Vec3};

/// Points closer to a plane than this share of the hull's size are on it: 10 µm for 0.1 m. This is far above the
/// rounding of written coordinates and far below anything that affects a grasp.
const FLAT_SHARE: f32 = 1e-4;
/// Maximum relative difference between the volume of the faces and of the triangles; otherwise the faces do not enclose
/// the hull.
const VOLUME_SHARE: f32 = 1e-3;
/// Maximum coordinate of a corner; larger ones are in other units.
const CORNER_M_MAX: f32 = 10.0;

/// A convex polyhedron in a frame defined by its owner.
#[derive(Debug, Clone, PartialEq)]
pub struct Polyhedron {
    corners_m: Vec<Vec3>,
    faces: Vec<Face>,
    edges_m: Vec<Vec3>,
    centre_m: Vec3,
    radius_m: f32,
}

/// A flat face.
#[derive(Debug, Clone, PartialEq)]
pub struct Face {
    /// Its plane; the normal points outwards.
    pub plane: Plane,
    /// Indices of its corners, counter-clockwise seen from outside.
    pub ring: Vec<usize>,
}

impl Face {
    /// Its triangles as corner indices, counter-clockwise seen from outside.
    pub fn triangles(&self) -> impl Iterator<Item = [usize; 3]> {
        self.ring[1..].windows(2).map(|side| [self.ring[0], side[0], side[1]])
    }
}

/// Why points have no hull with a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum HullError {
    /// A coordinate is not finite, or larger than 10 m.
    #[error("corners must be numbers between −{CORNER_M_MAX} and {CORNER_M_MAX} m")]
    Corner,
    /// The points are coplanar, or nearly so.
    #[error("a hull needs at least four corners that are not in one plane")]
    Flat,
    /// Neighbouring faces are so nearly coplanar that they cannot be distinguished.
    #[error("a hull's faces must be clearly flat or clearly bent: it has too many corners")]
    Unclear,
}

impl Polyhedron {
    /// The hull of `points_m`, in the points' frame. Points inside it, or inside one of its faces, are dropped.
    ///
    /// # Errors
    /// [`HullError`].
    pub fn hull_of(points_m: &[Vec3]) -> Result<Self, HullError> {
        Self::hull_by(points_m, triangles_of_hull, |hull| Some(hull.volume_m3()))
    }

    /// The same, by another's triangles: `triangulate` gives the hull's triangles, counter-clockwise seen from outside,
    /// and `volume_m3` a second opinion on the volume that the faces enclose.
    ///
    /// # Errors
    /// [`HullError`].
    pub fn hull_by(
        points_m: &[Vec3],
        triangulate: impl FnOnce(&[Vec3]) -> Option<Vec<[Vec3; 3]>>,
        volume_m3: impl FnOnce(&Self) -> Option<f32>,
    ) -> Result<Self, HullError> {
        if points_m.iter().flat_map(|p| p.to_array()).any(|x| !x.is_finite() || x.abs() > CORNER_M_MAX) {
            return Err(HullError::Corner);
        }
        let [low, high] = bounds_m(points_m);
        // Also refuses an empty set of points, whose extents are negative.
        if points_m.len() < 4 || (high - low).min_element() <= 0.0 {
            return Err(HullError::Flat);
        }
        let flat_m = FLAT_SHARE * (high - low).length();
        let triangles = triangulate(points_m).ok_or(HullError::Flat)?;
        let enclosed_m3: f32 = triangles.iter().map(|t| volume_below_m3(*t, low)).sum();
        let area_m2: f32 = triangles.iter().map(|t| 0.5 * twice_area_m2(*t).length()).sum();
        // The thickness of a plate is twice its volume over its area.
        if enclosed_m3 <= flat_m * area_m2 {
            return Err(HullError::Flat);
        }
        let hull = Self::of_outlines(&faces_of(&triangles, flat_m));
        let is_inside = |p: &Vec3| hull.faces.iter().all(|f| f.plane.normal.dot(*p) - f.plane.offset_m <= flat_m);
        let is_whole = |volume_m3: f32| (volume_m3 - enclosed_m3).abs() <= VOLUME_SHARE * enclosed_m3;
        let is_clear = triangles.as_flattened().iter().all(is_inside) && is_whole(hull.volume_m3());
        if is_clear && volume_m3(&hull).is_some_and(is_whole) { Ok(hull) } else { Err(HullError::Unclear) }
    }

    /// Indexes the corners of all faces (outward normals and outlines), in order of occurrence.
    fn of_outlines(faces: &[(Vec3, Vec<Vec3>)]) -> Self {
        let mut corners_m: Vec<Vec3> = Vec::new();
        let mut number = |corner: &Vec3| {
            corners_m.iter().position(|c| c == corner).unwrap_or_else(|| {
                corners_m.push(*corner);
                corners_m.len() - 1
            })
        };
        let faces: Vec<Face> = faces
            .iter()
            .map(|(normal, ring)| {
                let offset_m = ring.iter().map(|c| normal.dot(*c)).fold(f32::NEG_INFINITY, f32::max);
                Face { plane: Plane { normal: *normal, offset_m }, ring: ring.iter().map(&mut number).collect() }
            })
            .collect();
        let edges = faces.iter().flat_map(|face| sides(&face.ring));
        let edges_m = edges.map(|(a, b)| corners_m[b] - corners_m[a]).collect();
        let [low, high] = bounds_m(&corners_m);
        let centre_m = 0.5 * (low + high);
        let radius_m = corners_m.iter().map(|c| (*c - centre_m).length()).fold(0.0, f32::max);
        Self { corners_m, faces, edges_m, centre_m, radius_m }
    }

    /// The corners, in metres.
    #[must_use]
    pub fn corners_m(&self) -> &[Vec3] {
        &self.corners_m
    }

    /// The faces.
    #[must_use]
    pub fn faces(&self) -> &[Face] {
        &self.faces
    }

    /// The centre of a bounding ball, in metres.
    #[must_use]
    pub fn centre_m(&self) -> Vec3 {
        self.centre_m
    }

    /// The radius of that ball, in metres.
    #[must_use]
    pub fn radius_m(&self) -> f32 {
        self.radius_m
    }

    /// The faces as half-spaces.
    pub fn planes(&self) -> impl Iterator<Item = Plane> {
        self.faces.iter().map(|face| face.plane)
    }

    /// The surface as triangles of corner indices, counter-clockwise seen from outside.
    #[must_use]
    pub fn triangles(&self) -> Vec<[usize; 3]> {
        self.faces.iter().flat_map(Face::triangles).collect()
    }

    /// The directions of the edges, not normalised; some more than once.
    #[must_use]
    pub fn edges_m(&self) -> &[Vec3] {
        &self.edges_m
    }

    /// Volume in cubic metres, by the divergence theorem.
    #[must_use]
    pub fn volume_m3(&self) -> f32 {
        let [from, ..] = self.corners_m[..] else { return 0.0 };
        let below = |face: &Face| -> f32 {
            let at = |i: usize| self.corners_m[i];
            sides(&face.ring).map(|(a, b)| volume_below_m3([at(face.ring[0]), at(a), at(b)], from)).sum()
        };
        self.faces.iter().map(below).sum()
    }

    /// The polyhedron in another frame.
    #[must_use]
    pub fn moved(&self, pose: &Pose) -> Self {
        let face = |face: &Face| Face { plane: face.plane.moved(pose), ring: face.ring.clone() };
        Self {
            corners_m: self.corners_m.iter().map(|c| pose.transform_point(*c)).collect(),
            faces: self.faces.iter().map(face).collect(),
            edges_m: self.edges_m.iter().map(|edge| pose.rotation * *edge).collect(),
            centre_m: pose.transform_point(self.centre_m),
            radius_m: self.radius_m,
        }
    }
}

impl From<&Solid> for Polyhedron {
    /// Corners and faces in the solid's own order, in its frame.
    fn from(solid: &Solid) -> Self {
        let faces = solid.planes().into_iter().zip(solid.faces()).map(|(plane, ring)| Face { plane, ring });
        Self {
            corners_m: solid.vertices_m(),
            faces: faces.collect(),
            edges_m: solid.edges_m(),
            centre_m: Vec3::ZERO,
            radius_m: solid.bounding_radius_m(),
        }
    }
}

/// The lower and the upper corner of the points' bounding box; infinite and the wrong way round without points.
#[must_use]
pub fn bounds_m<'a>(points_m: impl IntoIterator<Item = &'a Vec3>) -> [Vec3; 2] {
    points_m
        .into_iter()
        .fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], point_m| [low.min(*point_m), high.max(*point_m)])
}

/// A vector along a triangle's normal, with a length of twice its area.
fn twice_area_m2([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).cross(c - a)
}

/// Volume between a triangle and a point, positive if the triangle faces away from the point.
fn volume_below_m3(triangle: [Vec3; 3], from: Vec3) -> f32 {
    twice_area_m2(triangle).dot(triangle[0] - from) / 6.0
}

/// Merges triangles to flat faces: outward normals, and corners counter-clockwise seen from outside.
fn faces_of(triangles: &[[Vec3; 3]], flat_m: f32) -> Vec<(Vec3, Vec<Vec3>)> {
    // The largest first: small and narrow triangles have no reliable normal and join their neighbours' faces.
    let mut left: Vec<([Vec3; 3], Vec3)> = triangles.iter().map(|t| (*t, twice_area_m2(*t))).collect();
    left.sort_by(|a, b| b.1.length_squared().total_cmp(&a.1.length_squared()));
    let mut faces = Vec::new();
    while let Some(normal) = left.first().and_then(|(_, normal)| normal.try_normalize()) {
        let origin = left[0].0[0];
        let is_flat = |(triangle, across): &([Vec3; 3], Vec3)| {
            across.dot(normal) >= 0.0 && triangle.iter().all(|c| (*c - origin).dot(normal).abs() <= flat_m)
        };
        let (flat, rest): (Vec<_>, Vec<_>) = left.into_iter().partition(is_flat);
        left = rest;
        faces.push((normal, outline(normal, flat.iter().flat_map(|(triangle, _)| *triangle))));
    }
    faces
}

/// The corners of the convex outline of coplanar points, counter-clockwise about the normal (Andrew's monotone chain).
fn outline(normal: Vec3, points: impl Iterator<Item = Vec3>) -> Vec<Vec3> {
    let u = normal.any_orthonormal_vector();
    let v = normal.cross(u);
    let mut points: Vec<Vec3> = points.collect();
    points.sort_by(|a, b| u.dot(*a).total_cmp(&u.dot(*b)).then(v.dot(*a).total_cmp(&v.dot(*b))));
    points.dedup();
    let half = |points: &mut dyn Iterator<Item = Vec3>| {
        let mut chain: Vec<Vec3> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..]
                && turns_no_further([a, b, point], normal)
            {
                chain.pop();
            }
            chain.push(point);
        }
        // The other half starts where this one ends.
        chain.pop();
        chain
    };
    let mut ring = half(&mut points.iter().copied());
    ring.extend(half(&mut points.iter().rev().copied()));
    ring
}

/// Whether a path along three points is straight, or turns clockwise about `normal`. A turn of less than 1e-4 rad
/// counts as rounding.
fn turns_no_further([a, b, c]: [Vec3; 3], normal: Vec3) -> bool {
    let (first, second) = (b - a, c - b);
    first.cross(second).dot(normal) <= 1e-4 * first.length() * second.length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Purpose, ShapeKind, Stream};

    fn has_plane(hull: &Polyhedron, plane: &Plane) -> bool {
        let is_same =
            |p: &Plane| (p.normal - plane.normal).length() < 1e-5 && (p.offset_m - plane.offset_m).abs() < 1e-7;
        hull.planes().filter(is_same).count() == 1
    }

    /// Every edge belongs to two faces that traverse it in opposite directions, and Euler's formula holds.
    fn assert_closed(hull: &Polyhedron) {
        let edges: Vec<(usize, usize)> = hull.faces.iter().flat_map(|face| sides(&face.ring)).collect();
        for (a, b) in &edges {
            let count = |edge: (usize, usize)| edges.iter().filter(|e| **e == edge).count();
            assert_eq!((count((*a, *b)), count((*b, *a))), (1, 1), "edge {a}–{b}");
        }
        assert_eq!(hull.corners_m.len() + hull.faces.len(), edges.len() / 2 + 2);
    }

    #[test]
    fn the_hull_of_a_solids_corners_is_the_solid() {
        for (kind, extents) in [
            (ShapeKind::Cuboid, Vec3::new(0.03, 0.05, 0.07)),
            (ShapeKind::Cuboid, Vec3::new(0.08, 0.08, 0.001)),
            (ShapeKind::Cylinder, Vec3::new(0.04, 0.04, 0.07)),
            (ShapeKind::TriPrism, Vec3::new(0.08, 0.05, 0.04)),
            (ShapeKind::HalfCylinder, Vec3::new(0.06, 0.06, 0.03)),
        ] {
            let solid = Solid::new(kind, extents).unwrap();
            let hull = Polyhedron::hull_of(&solid.vertices_m()).unwrap();
            assert_closed(&hull);
            assert_eq!(hull.corners_m().len(), solid.vertices_m().len(), "{kind:?}");
            assert_eq!(hull.planes().count(), solid.planes().len(), "{kind:?}");
            for plane in solid.planes() {
                assert!(has_plane(&hull, &plane), "{kind:?}: {plane:?} is not in {:?}", hull.faces());
            }
            let volume = hull.volume_m3() / solid.volume_m3();
            assert!((volume - 1.0).abs() < 1e-5, "{kind:?}: {volume} of its volume");
        }
    }

    #[test]
    fn points_within_and_within_faces_and_edges_are_left_out() {
        let solid = Solid::new(ShapeKind::Cuboid, Vec3::new(0.03, 0.05, 0.07)).unwrap();
        let corners = solid.vertices_m();
        let mut points = corners.clone();
        for (i, a) in corners.iter().enumerate() {
            points.extend(corners[i + 1..].iter().map(|b| 0.5 * (*a + *b)));
            points.push(*a);
        }
        let hull = Polyhedron::hull_of(&points).unwrap();
        assert_closed(&hull);
        assert_eq!((hull.corners_m.len(), hull.faces.len()), (8, 6));
        assert!(hull.faces.iter().all(|face| face.ring.len() == 4), "{:?}", hull.faces);
    }

    /// A slow, obvious implementation in double precision: three points form a face if all others are behind their
    /// plane.
    #[test]
    fn faces_and_volume_are_those_of_all_triples_of_points() {
        let mut stream = Stream::new(4, 0, Purpose::Objects, 0);
        for case in 0..40 {
            let points: Vec<Vec3> = (0..12).map(|_| stream.point(Vec3::splat(-0.05), Vec3::splat(0.04))).collect();
            let double = |i: usize| points[i].to_array().map(f64::from);
            let (mut facets, mut volume) = (0, 0.0);
            for (i, j, k) in (0..12).flat_map(|i| (0..12).flat_map(move |j| (0..12).map(move |k| (i, j, k)))) {
                let (a, b, c) = (double(i), double(j), double(k));
                let minus = |p: [f64; 3], q: [f64; 3]| [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
                let (u, v) = (minus(b, a), minus(c, a));
                let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
                let height = |p: [f64; 3]| n[0] * p[0] + n[1] * p[1] + n[2] * p[2];
                let others = (0..12).filter(|o| ![i, j, k].contains(o));
                // Each facet comes three times, as its corners go round; the other way round all others lie before it.
                if i < j && i < k && j != k && others.into_iter().all(|o| height(double(o)) < height(a)) {
                    facets += 1;
                    volume += height(a) / 6.0;
                }
            }
            let hull = Polyhedron::hull_of(&points).unwrap();
            assert_closed(&hull);
            // Two facets that are coplanar within some micrometres are one face.
            let triangles: usize = hull.faces.iter().map(|face| face.ring.len() - 2).sum();
            assert_eq!(triangles, facets, "case {case}");
            let found = f64::from(hull.volume_m3());
            assert!((found / volume - 1.0).abs() < 1e-4, "case {case}: {found} instead of {volume}");
        }
    }

    /// Written coordinates have few digits: the side of a slanted prism is flat only within some micrometres.
    #[test]
    fn rounded_corners_make_the_faces_that_were_meant() {
        let mut stream = Stream::new(5, 0, Purpose::Objects, 0);
        for case in 0..40 {
            let turn = stream.rotation();
            let solid = Solid::new(ShapeKind::Cylinder, Vec3::new(0.05, 0.05, 0.09)).unwrap();
            let rounded = |v: Vec3| (v * 2e5).round() / 2e5;
            let points: Vec<Vec3> = solid.vertices_m().into_iter().map(|v| rounded(turn * v)).collect();
            let hull = Polyhedron::hull_of(&points).unwrap();
            assert_closed(&hull);
            assert_eq!(hull.faces.len(), solid.planes().len(), "case {case}");
        }
    }

    #[test]
    fn what_has_no_inside_is_refused() {
        let square = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::X + Vec3::Y].map(|v| 0.05 * v);
        let slanted = square.map(|v| v + Vec3::Z * (v.x + 2.0 * v.y));
        let line: Vec<Vec3> = (0..6).map(|i| Vec3::new(0.01, 0.02, 0.03) * i as f32).collect();
        for flat in [&[][..], &square[..3], &square, &slanted, &line, &[Vec3::ONE; 5]] {
            assert_eq!(Polyhedron::hull_of(flat), Err(HullError::Flat), "{flat:?}");
        }
        for wrong in [f32::NAN, f32::INFINITY, 50.0] {
            let mut corners = Solid::new(ShapeKind::Cuboid, Vec3::splat(0.05)).unwrap().vertices_m();
            corners[3].y = wrong;
            assert_eq!(Polyhedron::hull_of(&corners), Err(HullError::Corner), "{wrong}");
        }
    }
}
