//! The four primitive shapes of the paper (Fig. 2).
//!
//! Each is a convex polygon pushed along an axis, and is wholly given by its kind and its extents, which is what a
//! shard stores. Round outlines have [`FACETS`] flat sides a full turn, *everywhere*: in physics, in the rays that make
//! the depth images, in the collision tests and in the cross-check. (A true cylinder slipped in rapier's grip where its
//! faceted hull held; and rays must see what the physics feels.)

use settings::words;

use crate::{Pose, Vec3};

/// Flat sides of a full turn of a round outline. Divisible by four, so that the extents are those of the true circle.
pub const FACETS: usize = 24;

words! {
    /// Kind of a primitive shape, in the order of the paper's Fig. 2.
    #[derive(PartialOrd, Ord)]
    pub enum ShapeKind {
        /// A box.
        Cuboid = "cuboid",
        /// A cylinder, its axis along z.
        Cylinder = "cylinder",
        /// A triangular prism, extruded along x; in y–z an isosceles triangle, its base at −z, its apex at y = 0, +z.
        TriPrism = "tri_prism",
        /// Half a cylinder, extruded along x; its flat face at −z, its round one towards +z.
        HalfCylinder = "half_cylinder",
    }
}

/// A primitive shape with its size. The object frame's origin is the centre of its bounding box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solid {
    /// Which of the four.
    pub kind: ShapeKind,
    /// Full lengths of the bounding box along the object's axes, in metres. Invariants, kept by [`Solid::new`]: finite
    /// and positive; x = y for a cylinder; y = 2 z for a half-cylinder.
    pub extents_m: Vec3,
}

/// A half-space `normal · p ≤ offset_m` of a convex solid, in the object frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Outward unit normal.
    pub normal: Vec3,
    /// Distance of the plane from the origin along `normal`, in metres.
    pub offset_m: f32,
}

impl Plane {
    /// The plane in another frame.
    #[must_use]
    pub fn moved(&self, pose: &Pose) -> Self {
        let normal = pose.rotation * self.normal;
        Self { normal, offset_m: self.offset_m + normal.dot(pose.translation) }
    }
}

impl Solid {
    /// A solid from its kind and bounding box.
    ///
    /// # Errors
    /// If an extent is not positive or a round shape is not round (to 1e-5 relative).
    pub fn new(kind: ShapeKind, extents_m: Vec3) -> Result<Self, String> {
        if !extents_m.to_array().iter().all(|e| e.is_finite() && *e > 0.0) {
            return Err(format!("extents must be finite and above 0 m, got {extents_m}"));
        }
        let same = |a: f32, b: f32| (a - b).abs() <= 1e-5 * a.max(b);
        let round = match kind {
            ShapeKind::Cuboid | ShapeKind::TriPrism => true,
            ShapeKind::Cylinder => same(extents_m.x, extents_m.y),
            ShapeKind::HalfCylinder => same(extents_m.y, 2.0 * extents_m.z),
        };
        if !round {
            return Err(format!("a {} must have a circular outline, got extents {extents_m}", kind.name()));
        }
        Ok(Self { kind, extents_m })
    }

    /// The outline in the plane across the extrusion axis, counter-clockwise seen against that axis.
    ///
    /// Coordinates are (y, z) for shapes extruded along x and (x, y) for the cylinder, which is extruded along z.
    fn outline(&self) -> Vec<[f32; 2]> {
        let e = self.extents_m * 0.5;
        let arc = |sides: usize, turn: f32, first: usize, last: usize| {
            (first..=last).map(move |side| {
                let (sin, cos) = libm::sincosf(turn * side as f32 / sides as f32);
                [cos, sin]
            })
        };
        match self.kind {
            ShapeKind::Cuboid => vec![[-e.y, -e.z], [e.y, -e.z], [e.y, e.z], [-e.y, e.z]],
            ShapeKind::TriPrism => vec![[-e.y, -e.z], [e.y, -e.z], [0.0, e.z]],
            ShapeKind::Cylinder => {
                arc(FACETS, core::f32::consts::TAU, 0, FACETS - 1).map(|[c, s]| [e.x * c, e.y * s]).collect()
            }
            ShapeKind::HalfCylinder => arc(FACETS / 2, core::f32::consts::PI, 0, FACETS / 2)
                .map(|[c, s]| [e.y * c, 2.0 * e.z * s - e.z])
                .collect(),
        }
    }

    /// Lifts a point of the outline to the object frame, at `along_m` on the extrusion axis.
    fn lift(&self, [u, v]: [f32; 2], along_m: f32) -> Vec3 {
        match self.kind {
            ShapeKind::Cylinder => Vec3::new(u, v, along_m),
            _ => Vec3::new(along_m, u, v),
        }
    }

    fn half_length_m(&self) -> f32 {
        0.5 * match self.kind {
            ShapeKind::Cylinder => self.extents_m.z,
            _ => self.extents_m.x,
        }
    }

    /// The corners, in the object frame, metres: first the outline at the lower end of the extrusion axis, then at the
    /// upper.
    #[must_use]
    pub fn vertices_m(&self) -> Vec<Vec3> {
        let (outline, half) = (self.outline(), self.half_length_m());
        [-half, half].into_iter().flat_map(|along| outline.iter().map(move |p| self.lift(*p, along))).collect()
    }

    /// The faces as half-spaces, in the object frame: the sides in the outline's order, then the two ends.
    #[must_use]
    pub fn planes(&self) -> Vec<Plane> {
        let (outline, half) = (self.outline(), self.half_length_m());
        let side = |(a, b): ([f32; 2], [f32; 2])| {
            let normal = self.lift([b[1] - a[1], a[0] - b[0]], 0.0).normalize();
            Plane { normal, offset_m: normal.dot(self.lift(a, 0.0)) }
        };
        let axis = self.lift([0.0, 0.0], 1.0);
        let ends = [-axis, axis].map(|normal| Plane { normal, offset_m: half });
        sides(&outline).map(side).chain(ends).collect()
    }

    /// The corners of every face, as numbers into [`Self::vertices_m`], counter-clockwise seen from outside; in the
    /// order of [`Self::planes`].
    #[must_use]
    pub fn faces(&self) -> Vec<Vec<usize>> {
        let sides = self.outline().len();
        let side = |i: usize| vec![i, (i + 1) % sides, sides + (i + 1) % sides, sides + i];
        let ends = [(0..sides).rev().collect(), (sides..2 * sides).collect()];
        (0..sides).map(side).chain(ends).collect()
    }

    /// The directions of the edges, not normalised, in the object frame: those of the outline, then the extrusion axis.
    #[must_use]
    pub fn edges_m(&self) -> Vec<Vec3> {
        let across = self.lift([0.0, 0.0], 2.0 * self.half_length_m());
        sides(&self.outline()).map(|(a, b)| self.lift([b[0] - a[0], b[1] - a[1]], 0.0)).chain([across]).collect()
    }

    /// Volume of the faceted solid, in cubic metres.
    #[must_use]
    pub fn volume_m3(&self) -> f32 {
        let twice_area: f32 = sides(&self.outline()).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum();
        twice_area * self.half_length_m()
    }

    /// Radius of the ball about the object frame's origin that holds the solid, in metres.
    #[must_use]
    pub fn bounding_radius_m(&self) -> f32 {
        0.5 * self.extents_m.length()
    }
}

/// Consecutive pairs of a ring.
pub(crate) fn sides<T: Copy>(ring: &[T]) -> impl Iterator<Item = (T, T)> {
    ring.iter().copied().zip(ring.iter().copied().cycle().skip(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples() -> [Solid; 4] {
        [
            Solid::new(ShapeKind::Cuboid, Vec3::new(0.03, 0.05, 0.07)).unwrap(),
            Solid::new(ShapeKind::Cylinder, Vec3::new(0.04, 0.04, 0.09)).unwrap(),
            Solid::new(ShapeKind::TriPrism, Vec3::new(0.08, 0.05, 0.04)).unwrap(),
            Solid::new(ShapeKind::HalfCylinder, Vec3::new(0.08, 0.06, 0.03)).unwrap(),
        ]
    }

    #[test]
    fn vertices_span_the_extents_and_are_centred() {
        for solid in samples() {
            let vertices = solid.vertices_m();
            let low = vertices.iter().copied().reduce(Vec3::min).unwrap();
            let high = vertices.iter().copied().reduce(Vec3::max).unwrap();
            assert!((high - low - solid.extents_m).length() < 1e-6, "{solid:?}: {low} {high}");
            assert!((high + low).length() < 1e-6, "{solid:?}: {low} {high}");
        }
    }

    #[test]
    fn every_vertex_lies_within_every_plane_and_on_at_least_three() {
        for solid in samples() {
            let planes = solid.planes();
            for vertex in solid.vertices_m() {
                let gaps: Vec<f32> = planes.iter().map(|p| p.normal.dot(vertex) - p.offset_m).collect();
                assert!(gaps.iter().all(|g| *g < 1e-6), "{solid:?} {vertex}: {gaps:?}");
                assert!(gaps.iter().filter(|g| g.abs() < 1e-6).count() >= 3, "{solid:?} {vertex}: {gaps:?}");
            }
        }
    }

    #[test]
    fn faces_lie_in_their_planes_and_turn_about_their_normals() {
        for solid in samples() {
            let (corners, planes) = (solid.vertices_m(), solid.planes());
            let faces = solid.faces();
            assert_eq!(faces.len(), planes.len());
            for (face, plane) in faces.iter().zip(&planes) {
                let at = |i: usize| corners[face[i % face.len()]];
                assert!(
                    face.iter().all(|c| (plane.normal.dot(corners[*c]) - plane.offset_m).abs() < 1e-6),
                    "{solid:?}"
                );
                let turn = (0..face.len()).map(|i| (at(i) - at(0)).cross(at(i + 1) - at(0))).sum::<Vec3>();
                assert!(turn.normalize().dot(plane.normal) > 0.999, "{solid:?} {face:?}");
            }
        }
    }

    #[test]
    fn volumes_are_those_of_the_textbook() {
        let [cuboid, cylinder, prism, half] = samples();
        let circle =
            |radius: f64| 0.5 * FACETS as f64 * radius * radius * libm::sin(core::f64::consts::TAU / FACETS as f64);
        for (solid, expected) in [
            (cuboid, 0.03 * 0.05 * 0.07),
            (cylinder, circle(0.02) * 0.09),
            (prism, 0.5 * 0.08 * 0.05 * 0.04),
            (half, 0.5 * circle(0.03) * 0.08),
        ] {
            let volume = f64::from(solid.volume_m3());
            assert!((volume / expected - 1.0).abs() < 1e-5, "{solid:?}: {volume} against {expected}");
        }
    }

    #[test]
    fn what_is_not_round_or_not_positive_is_refused() {
        assert!(Solid::new(ShapeKind::Cylinder, Vec3::new(0.04, 0.05, 0.09)).is_err());
        assert!(Solid::new(ShapeKind::HalfCylinder, Vec3::new(0.04, 0.05, 0.05)).is_err());
        assert!(Solid::new(ShapeKind::Cuboid, Vec3::new(0.04, 0.0, 0.05)).is_err());
        assert!(Solid::new(ShapeKind::Cuboid, Vec3::new(0.04, f32::NAN, 0.05)).is_err());
    }
}
