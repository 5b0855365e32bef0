//! Convex hulls as the engine triangulates them.
//!
//! The order of a hull's corners and faces decides how the engine rounds, so attempts on models repeat bit by bit only
//! with the engine's own triangles. Their faces are those of [`Polyhedron::hull_of`], in another order.

use parry3d::shape::Shape;
use parry3d::transformation::try_convex_hull;
use schema::{HullError, Polyhedron, Vec3};

use crate::faceted::PolyhedronShape;

/// The hull of some points, in the points' frame. Points within it, or within a face of it, are left out.
///
/// # Errors
/// [`HullError`].
pub fn convex_hull(points_m: &[Vec3]) -> Result<Polyhedron, HullError> {
    let triangles = |points_m: &[Vec3]| {
        let (corners_m, triangles) = try_convex_hull(points_m).ok()?;
        Some(triangles.into_iter().map(|triangle| triangle.map(|corner| corners_m[corner as usize])).collect())
    };
    // The engine makes a hull of the corners once more, and it must be the same.
    let engine_m3 = |hull: &Polyhedron| Some(PolyhedronShape::of_hull(hull, 1.0)?.mass_properties(1.0).mass());
    Polyhedron::hull_by(points_m, triangles, engine_m3)
}

#[cfg(test)]
mod tests {
    use schema::{Purpose, ShapeKind, Solid, Stream};

    use super::*;

    /// What is simulated and what is drawn have the same corners and faces.
    fn assert_same_shape(name: &str, points_m: &[Vec3]) {
        let (simulated, drawn) = (convex_hull(points_m).unwrap(), Polyhedron::hull_of(points_m).unwrap());
        let sorted = |hull: &Polyhedron| {
            let mut corners: Vec<[u32; 3]> = hull.corners_m().iter().map(|c| c.to_array().map(f32::to_bits)).collect();
            corners.sort_unstable();
            corners
        };
        assert_eq!(sorted(&simulated), sorted(&drawn), "{name}");
        assert_eq!(simulated.faces().len(), drawn.faces().len(), "{name}");
        for plane in simulated.planes() {
            let is_same = |p: schema::Plane| {
                (p.normal - plane.normal).length() < 1e-3 && (p.offset_m - plane.offset_m).abs() < 1e-5
            };
            assert_eq!(drawn.planes().filter(|p| is_same(*p)).count(), 1, "{name}: {plane:?}");
        }
    }

    #[test]
    fn a_part_is_drawn_as_it_is_simulated_however_many_corners_it_has() {
        let sizes = [[0.03, 0.05, 0.07], [0.04, 0.04, 0.09], [0.08, 0.05, 0.04], [0.08, 0.06, 0.03]];
        for (kind, size) in ShapeKind::ALL.into_iter().zip(sizes) {
            assert_same_shape(kind.name(), &Solid::new(kind, Vec3::from_array(size)).unwrap().vertices_m());
        }
        let mut stream = Stream::new(7, 0, Purpose::Objects, 0);
        for count in [8, 30, 48, 49, 100, 200, 256] {
            let direction = |stream: &mut Stream| stream.rotation() * Vec3::X;
            let ball: Vec<Vec3> = (0..count).map(|_| 0.05 * direction(&mut stream)).collect();
            assert_same_shape(&format!("{count} corners"), &ball);
        }
    }
}
