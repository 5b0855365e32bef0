//! A solid as a collision shape: parry's convex hull, with faces that hold.
//!
//! parry describes a face that two shapes share by at most four corners, and takes the *first four* of a hull's face. The
//! round end of a cylinder has 24: its first four lie side by side on the rim, do not surround the middle, and an upright
//! cylinder trembles or topples. Here a many-cornered face is described by four corners spread around its rim, one of
//! them next to where the other body touches, so that the whole rim can bear. Everything else is the hull's.

use parry3d::bounding_volume::{Aabb, BoundingSphere};
use parry3d::mass_properties::MassProperties;
use parry3d::math::Vector;
use parry3d::query::{PointProjection, PointQuery, Ray, RayCast, RayIntersection};
use parry3d::shape::{
    ConvexPolyhedron, FeatureId, PackedFeatureId, PolygonalFeature, PolygonalFeatureMap, Shape, ShapeType, SharedShape,
    SupportMap, TypedShape,
};
use schema::{Pose, ShapeKind, Solid};

/// A face touched nearer to its middle than this share of its radius is described by its standing choice of corners.
const RIM_SHARE: f32 = 0.25;

/// The collision shape of a solid, in units of which `units_per_m` make a metre.
pub(crate) fn shape_of(solid: &Solid, units_per_m: f32) -> SharedShape {
    let half = solid.extents_m * (0.5 * units_per_m);
    match solid.kind {
        ShapeKind::Cuboid => SharedShape::cuboid(half.x, half.y, half.z),
        _ => SharedShape::new(Faceted::new(solid, units_per_m)),
    }
}

/// A polygon pushed along an axis. Corners `0..n` are the lower end's, `n..2n` the upper end's; faces `0..n` are the
/// sides, `n` and `n + 1` the ends, as [`Solid`] orders them.
#[derive(Debug, Clone)]
struct Faceted {
    hull: ConvexPolyhedron,
    corners: Vec<Vector>,
    normals: Vec<Vector>,
    end_radius: f32,
}

impl Faceted {
    fn new(solid: &Solid, units_per_m: f32) -> Self {
        let corners: Vec<Vector> = solid.vertices_m().into_iter().map(|c| c * units_per_m).collect();
        let hull = ConvexPolyhedron::from_convex_hull(&corners).expect("a checked solid has a convex hull");
        let ring = &corners[..corners.len() / 2];
        let middle = middle_of(ring);
        let end_radius = ring.iter().map(|c| (*c - middle).length()).fold(0.0, f32::max);
        let normals = solid.planes().into_iter().map(|plane| plane.normal).collect();
        Self { hull, corners, normals, end_radius }
    }

    fn sides(&self) -> usize {
        self.corners.len() / 2
    }

    /// Corner `i` of a side face, going round it.
    fn side_corners(&self, side: usize) -> [usize; 4] {
        let (n, next) = (self.sides(), (side + 1) % self.sides());
        [side, next, n + next, n + side]
    }

    /// Up to four corners of an end, spread round its rim, the first next to `hint` if that lies near the rim.
    fn end_corners(&self, upper: bool, hint: Option<Vector>) -> ([usize; 4], usize) {
        let n = self.sides();
        let start = if upper { n } else { 0 };
        let ring = &self.corners[start..start + n];
        if n <= 4 {
            return (core::array::from_fn(|i| start + i.min(n - 1)), n);
        }
        let middle = middle_of(ring);
        let first = hint
            .map(|hint| hint - middle)
            .filter(|off| off.length() > RIM_SHARE * self.end_radius)
            .map_or(0, |off| nearest_along(ring, middle, off));
        (core::array::from_fn(|i| start + (first + (i * n + 2) / 4) % n), 4)
    }

    fn describe(&self, dir: Vector, hint: Option<Vector>, out: &mut PolygonalFeature) {
        let n = self.sides();
        let face = (0..self.normals.len())
            .reduce(|best, f| if self.normals[f].dot(dir) > self.normals[best].dot(dir) { f } else { best })
            .unwrap_or(0);
        let (corners, count) =
            if face < n { (self.side_corners(face), 4) } else { self.end_corners(face == n + 1, hint) };
        for (slot, corner) in corners.into_iter().enumerate() {
            out.vertices[slot] = self.corners[corner];
            out.vids[slot] = PackedFeatureId::vertex(corner as u32);
            out.eids[slot] = PackedFeatureId::edge((face * 2 * n + corner) as u32);
        }
        out.fid = PackedFeatureId::face(face as u32);
        out.num_vertices = count;
    }
}

fn middle_of(points: &[Vector]) -> Vector {
    points.iter().copied().sum::<Vector>() / points.len() as f32
}

/// The point that lies furthest from `middle` along `direction`.
fn nearest_along(points: &[Vector], middle: Vector, direction: Vector) -> usize {
    let reach = |i: usize| (points[i] - middle).dot(direction);
    (0..points.len()).reduce(|best, i| if reach(i) > reach(best) { i } else { best }).unwrap_or(0)
}

impl SupportMap for Faceted {
    fn local_support_point(&self, dir: Vector) -> Vector {
        self.corners[nearest_along(&self.corners, Vector::ZERO, dir)]
    }
}

impl PolygonalFeatureMap for Faceted {
    fn local_support_feature(&self, dir: Vector, out: &mut PolygonalFeature) {
        self.describe(dir, None, out);
    }

    fn local_support_feature_toward(&self, dir: Vector, hint: Vector, out: &mut PolygonalFeature) {
        self.describe(dir, Some(hint), out);
    }
}

impl Shape for Faceted {
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

impl RayCast for Faceted {
    fn cast_local_ray_and_get_normal(&self, ray: &Ray, max_toi: f32, solid: bool) -> Option<RayIntersection> {
        self.hull.cast_local_ray_and_get_normal(ray, max_toi, solid)
    }
}

impl PointQuery for Faceted {
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

    #[test]
    fn the_end_of_a_cylinder_is_described_by_corners_all_round() {
        let solid = Solid::new(ShapeKind::Cylinder, Vec3::new(0.04, 0.04, 0.06)).unwrap();
        let shape = Faceted::new(&solid, 1.0);
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
        let shape = Faceted::new(&solid, 1.0);
        let mut feature = PolygonalFeature::default();
        for plane in solid.planes() {
            shape.describe(plane.normal, None, &mut feature);
            for corner in &feature.vertices[..feature.num_vertices] {
                assert!((plane.normal.dot(*corner) - plane.offset_m).abs() < 1e-6, "{plane:?} {corner}");
            }
        }
    }
}
