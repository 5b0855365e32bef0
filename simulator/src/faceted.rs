//! A convex solid as a collision shape: parry's convex hull with a better choice of contact corners.
//!
//! parry describes a contact face by at most four corners, and takes the *first four* of a hull's face. The round end
//! of a cylinder has 24 corners: the first four are adjacent on the rim and do not surround the centre, so an upright
//! cylinder trembles or topples. This shape describes a many-cornered face by four corners spread around its rim, one
//! of them next to the contact, so that the whole rim can carry load. Everything else is delegated to the hull.

use parry3d::bounding_volume::{Aabb, BoundingSphere};
use parry3d::mass_properties::MassProperties;
use parry3d::math::Vector;
use parry3d::query::{PointProjection, PointQuery, Ray, RayCast, RayIntersection};
use parry3d::shape::{
    ConvexPolyhedron, FeatureId, PackedFeatureId, PolygonalFeature, PolygonalFeatureMap, Shape, ShapeType, SharedShape,
    SupportMap, TypedShape,
};
use schema::{Polyhedron, Pose, ShapeKind, Solid};

/// If a face is touched closer to its centre than this share of its radius, a fixed choice of corners describes it.
const RIM_SHARE: f32 = 0.25;

/// The collision shape of a solid, in units of 1/`units_per_m` metre.
pub(crate) fn shape_of(solid: &Solid, units_per_m: f32) -> SharedShape {
    let half = solid.extents_m * (0.5 * units_per_m);
    match solid.kind {
        ShapeKind::Cuboid => SharedShape::cuboid(half.x, half.y, half.z),
        _ => SharedShape::new(PolyhedronShape::of_solid(solid, units_per_m)),
    }
}

/// The collision shape of a hull, in units of 1/`units_per_m` metre.
pub(crate) fn shape_of_hull(hull: &Polyhedron, units_per_m: f32) -> SharedShape {
    SharedShape::new(PolyhedronShape::of_hull(hull, units_per_m).expect("a checked hull is convex"))
}

/// A convex polyhedron whose faces are rings of corners.
#[derive(Debug, Clone)]
pub(crate) struct PolyhedronShape {
    hull: ConvexPolyhedron,
    corners: Vec<Vector>,
    faces: Vec<Ring>,
    /// Whether the corners of a many-cornered face are evenly spaced, as a solid's are.
    is_even: bool,
}

/// A face: indices of its corners, in order around it.
#[derive(Debug, Clone)]
struct Ring {
    normal: Vector,
    corners: Vec<usize>,
    middle: Vector,
    radius: f32,
}

impl PolyhedronShape {
    /// An extruded polygon. Corners `0..n` belong to the lower end and `n..2n` to the upper end; faces `0..n` are the
    /// sides, `n` and `n + 1` the ends, as in [`Solid`].
    fn of_solid(solid: &Solid, units_per_m: f32) -> Self {
        let corners: Vec<Vector> = solid.vertices_m().into_iter().map(|c| c * units_per_m).collect();
        let n = corners.len() / 2;
        let sides = (0..n).map(|side| vec![side, (side + 1) % n, n + (side + 1) % n, n + side]);
        let ends = [(0..n).collect(), (n..2 * n).collect()];
        let normals = solid.planes().into_iter().map(|plane| plane.normal);
        Self::new(corners, normals.zip(sides.chain(ends)), true).expect("a checked solid has a convex hull")
    }

    /// `None` if the engine finds no hull of the corners.
    pub(crate) fn of_hull(hull: &Polyhedron, units_per_m: f32) -> Option<Self> {
        let corners = hull.corners_m().iter().map(|c| *c * units_per_m).collect();
        Self::new(corners, hull.faces().iter().map(|face| (face.plane.normal, face.ring.clone())), false)
    }

    fn new(corners: Vec<Vector>, faces: impl Iterator<Item = (Vector, Vec<usize>)>, is_even: bool) -> Option<Self> {
        let hull = ConvexPolyhedron::from_convex_hull(&corners)?;
        let ring = |(normal, ring): (Vector, Vec<usize>)| {
            let middle = ring.iter().map(|c| corners[*c]).sum::<Vector>() / ring.len() as f32;
            let radius = ring.iter().map(|c| (corners[*c] - middle).length()).fold(0.0, f32::max);
            Ring { normal, corners: ring, middle, radius }
        };
        let faces = faces.map(ring).collect();
        Some(Self { hull, corners, faces, is_even })
    }

    /// Up to four corners of a face. Those of a many-cornered face are spread around its rim; the first is next to
    /// `hint` if `hint` is near the rim.
    fn face_corners(&self, face: &Ring, hint: Option<Vector>) -> ([usize; 4], usize) {
        let (ring, n) = (&face.corners, face.corners.len());
        if n <= 4 {
            return (core::array::from_fn(|i| ring[i.min(n - 1)]), n);
        }
        let from_middle = |corner: usize| self.corners[corner] - face.middle;
        let furthest = |off: Vector| furthest_along(ring.iter().map(|c| from_middle(*c)), off);
        let first = hint
            .map(|hint| hint - face.middle)
            .filter(|off| off.length() > RIM_SHARE * face.radius)
            .map_or(0, furthest);
        if self.is_even {
            return (core::array::from_fn(|i| ring[(first + (i * n + 2) / 4) % n]), 4);
        }
        let ahead = from_middle(ring[first]);
        let across = face.normal.cross(ahead);
        ([first, furthest(across), furthest(-ahead), furthest(-across)].map(|i| ring[i]), 4)
    }

    fn describe(&self, dir: Vector, hint: Option<Vector>, out: &mut PolygonalFeature) {
        let number = furthest_along(self.faces.iter().map(|face| face.normal), dir);
        let (corners, count) = self.face_corners(&self.faces[number], hint);
        for (slot, corner) in corners.into_iter().enumerate() {
            out.vertices[slot] = self.corners[corner];
            out.vids[slot] = PackedFeatureId::vertex(corner as u32);
            out.eids[slot] = PackedFeatureId::edge((number * self.corners.len() + corner) as u32);
        }
        out.fid = PackedFeatureId::face(number as u32);
        out.num_vertices = count;
    }
}

/// Index of the first vector with the largest component along `direction`.
fn furthest_along(vectors: impl Iterator<Item = Vector>, direction: Vector) -> usize {
    let mut best = (0, f32::NEG_INFINITY);
    for (number, vector) in vectors.enumerate() {
        let reach = vector.dot(direction);
        if reach > best.1 {
            best = (number, reach);
        }
    }
    best.0
}

impl SupportMap for PolyhedronShape {
    fn local_support_point(&self, dir: Vector) -> Vector {
        self.corners[furthest_along(self.corners.iter().copied(), dir)]
    }
}

impl PolygonalFeatureMap for PolyhedronShape {
    fn local_support_feature(&self, dir: Vector, out: &mut PolygonalFeature) {
        self.describe(dir, None, out);
    }

    fn local_support_feature_toward(&self, dir: Vector, hint: Vector, out: &mut PolygonalFeature) {
        self.describe(dir, Some(hint), out);
    }
}

impl Shape for PolyhedronShape {
    fn compute_local_aabb(&self) -> Aabb {
        self.hull.compute_local_aabb()
    }

    fn compute_local_bounding_sphere(&self) -> BoundingSphere {
        self.hull.compute_local_bounding_sphere()
    }

    fn compute_aabb(&self, position: &Pose) -> Aabb {
        self.hull.compute_aabb(position)
    }

    fn clone_dyn(&self) -> Box<dyn Shape> {
        Box::new(self.clone())
    }

    fn scale_dyn(&self, _scale: Vector, _num_subdivisions: u32) -> Option<Box<dyn Shape>> {
        None
    }

    fn mass_properties(&self, density: f32) -> MassProperties {
        self.hull.mass_properties(density)
    }

    fn shape_type(&self) -> ShapeType {
        ShapeType::Custom
    }

    fn as_typed_shape(&self) -> TypedShape<'_> {
        TypedShape::Custom(self)
    }

    fn ccd_thickness(&self) -> f32 {
        self.hull.ccd_thickness()
    }

    fn ccd_angular_thickness(&self) -> f32 {
        self.hull.ccd_angular_thickness()
    }

    fn is_convex(&self) -> bool {
        true
    }

    fn as_support_map(&self) -> Option<&dyn SupportMap> {
        Some(self)
    }

    fn as_polygonal_feature_map(&self) -> Option<(&dyn PolygonalFeatureMap, f32)> {
        Some((self, 0.0))
    }
}

impl RayCast for PolyhedronShape {
    fn cast_local_ray_and_get_normal(&self, ray: &Ray, max_toi: f32, solid: bool) -> Option<RayIntersection> {
        self.hull.cast_local_ray_and_get_normal(ray, max_toi, solid)
    }
}

impl PointQuery for PolyhedronShape {
    fn project_local_point(&self, point: Vector, solid: bool) -> PointProjection {
        self.hull.project_local_point(point, solid)
    }

    fn project_local_point_and_get_feature(&self, point: Vector) -> (PointProjection, FeatureId) {
        self.hull.project_local_point_and_get_feature(point)
    }
}

#[cfg(test)]
mod tests {
    use schema::Vec3;

    use super::*;
    use crate::convex_hull::convex_hull;

    #[test]
    fn the_end_of_a_cylinder_is_described_by_corners_all_round() {
        let solid = Solid::new(ShapeKind::Cylinder, Vec3::new(0.04, 0.04, 0.06)).unwrap();
        let shape = PolyhedronShape::of_solid(&solid, 1.0);
        let mut feature = PolygonalFeature::default();
        for hint in [None, Some(Vec3::new(0.0, 0.019, -0.03)), Some(Vec3::new(-0.01, -0.012, -0.03))] {
            shape.describe(-Vec3::Z, hint, &mut feature);
            assert_eq!(feature.num_vertices, 4);
            let sum: Vec3 = feature.vertices.into_iter().sum();
            assert!((sum - Vec3::new(0.0, 0.0, -0.12)).length() < 1e-6, "{feature:?}");
            if let Some(hint) = hint {
                let nearest =
                    feature.vertices.iter().map(|v| v.truncate().normalize().dot(hint.truncate().normalize()));
                assert!(nearest.fold(-1.0, f32::max) > 0.99, "a corner lies next to {hint}: {feature:?}");
            }
        }
    }

    #[test]
    fn a_side_is_its_own_four_corners() {
        let solid = Solid::new(ShapeKind::HalfCylinder, Vec3::new(0.08, 0.06, 0.03)).unwrap();
        let shape = PolyhedronShape::of_solid(&solid, 1.0);
        let mut feature = PolygonalFeature::default();
        for plane in solid.planes() {
            shape.describe(plane.normal, None, &mut feature);
            for corner in &feature.vertices[..feature.num_vertices] {
                assert!((plane.normal.dot(*corner) - plane.offset_m).abs() < 1e-6, "{plane:?} {corner}");
            }
        }
    }

    /// A face with most of its corners on one side: the first four, or every third, would leave out the other side.
    #[test]
    fn an_uneven_face_is_described_by_corners_round_its_middle() {
        let arc = (0..=10).map(|i| libm::sincosf(0.05 * i as f32)).map(|(sin, cos)| [0.04 * cos, 0.04 * sin]);
        let outline: Vec<[f32; 2]> = arc.chain([[0.0, 0.02], [0.0, 0.0]]).collect();
        let corners: Vec<Vec3> =
            [-0.01, 0.01].into_iter().flat_map(|z| outline.iter().map(move |[x, y]| Vec3::new(*x, *y, z))).collect();
        let shape = PolyhedronShape::of_hull(&convex_hull(&corners).unwrap(), 1.0).unwrap();
        let mut feature = PolygonalFeature::default();
        for hint in [None, Some(Vec3::new(0.039, 0.001, 0.01)), Some(Vec3::new(0.0, 0.02, 0.01))] {
            shape.describe(Vec3::Z, hint, &mut feature);
            let [a, b, c, d] = feature.vertices;
            let area_m2 = 0.5 * (c - a).cross(d - b).z;
            assert!(area_m2 > 0.7 * 0.04 * 0.02, "{hint:?}: {area_m2} m² of {feature:?}");
        }
    }
}
