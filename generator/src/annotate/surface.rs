//! The surface of an object alone: points that are spread evenly, and what is straight across from them.

use schema::{Face, Polyhedron, Vec3, bounds_m};
use simulator::Body;

use crate::normals::{SEAM_M, Within, within};

/// Bits of a coordinate in the order along a Morton curve.
const MORTON_BITS: u32 = 10;

/// The outer surface of an object, in its frame.
pub(super) struct Surface {
    parts: Vec<Polyhedron>,
    triangles: Vec<Triangle>,
    /// The area of all triangles up to each.
    areas_m2: Vec<f32>,
}

struct Triangle {
    corners_m: [Vec3; 3],
    normal: Vec3,
    /// The direction of the longest edge of its face.
    along: Vec3,
    part: usize,
}

/// A point on the surface, the outward normal there, and the direction of the longest edge of the face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SurfacePoint {
    pub(super) at_m: Vec3,
    pub(super) normal: Vec3,
    pub(super) along: Vec3,
}

impl Surface {
    /// Triangles that are near each other in space are near each other in their order, so that numbers that are spread
    /// evenly between 0 and 1 make points that are spread evenly over the surface.
    pub(super) fn of(body: &Body) -> Self {
        let parts = body.polyhedra();
        let triangles_of = |(part, polyhedron): (usize, &Polyhedron)| -> Vec<Triangle> {
            let corner_m = |corner: usize| polyhedron.corners_m()[corner];
            let of_face = |face: &Face| -> Vec<Triangle> {
                let normal = face.plane.normal;
                let ends = face.ring.iter().zip(face.ring.iter().cycle().skip(1));
                let edges = ends.map(|(from, to)| corner_m(*to) - corner_m(*from));
                let longest = edges.max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
                let along = longest.unwrap_or_default().normalize_or(normal.any_orthonormal_vector());
                let triangle = |corners: [usize; 3]| Triangle { corners_m: corners.map(corner_m), normal, along, part };
                face.triangles().map(triangle).collect()
            };
            polyhedron.faces().iter().flat_map(of_face).collect()
        };
        let mut triangles: Vec<Triangle> = parts.iter().enumerate().flat_map(triangles_of).collect();
        let [low, high] = bounds_m(&body.vertices_m());
        let cells = ((1_u32 << MORTON_BITS) - 1) as f32;
        let place = |triangle: &Triangle| {
            let middle = triangle.corners_m.iter().sum::<Vec3>() / 3.0;
            let share = (middle - low) / (high - low).max(Vec3::splat(1e-9));
            share.to_array().map(|share| (share.clamp(0.0, 1.0) * cells) as u32)
        };
        triangles.sort_by_key(|triangle| (normal_octant(triangle.normal), morton(place(triangle))));
        let mut sum_m2 = 0.0;
        let areas_m2 = triangles.iter().map(|triangle| {
            let [a, b, c] = triangle.corners_m;
            sum_m2 += 0.5 * (b - a).cross(c - a).length();
            sum_m2
        });
        Self { areas_m2: areas_m2.collect(), parts: parts.to_vec(), triangles }
    }

    /// The point that three numbers from 0 to 1 stand for, uniform by area; `None` if it is inside another part.
    pub(super) fn point(&self, [along, u, v]: [f32; 3]) -> Option<SurfacePoint> {
        let wanted_m2 = along * self.areas_m2.last()?;
        let number = self.areas_m2.partition_point(|area_m2| *area_m2 < wanted_m2).min(self.triangles.len() - 1);
        let Triangle { corners_m: [a, b, c], normal, along, part } = self.triangles[number];
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        let at_m = a + (b - a) * u + (c - a) * v;
        let outside_m = at_m + normal * SEAM_M;
        let is_within = |part: &Polyhedron| part.planes().all(|plane| plane.normal.dot(outside_m) <= plane.offset_m);
        let covered = self.parts.iter().enumerate().any(|(other, own)| other != part && is_within(own));
        (!covered).then_some(SurfacePoint { at_m, normal, along })
    }

    /// Where the line through a point is inside the object, on both sides of the point.
    pub(super) fn inside(&self, at_m: Vec3, direction: Vec3) -> Vec<Within> {
        // Most lines pass by most parts.
        let is_near = |part: &&Polyhedron| {
            let (to_m, far_m) = (part.centre_m() - at_m, 1.001 * part.radius_m() + 1e-5);
            let along_m = to_m.dot(direction);
            to_m.length_squared() - along_m * along_m <= far_m * far_m
        };
        within(self.parts.iter().filter(is_near), at_m, direction)
    }

    /// The outward normal of the face that is nearest to a point of the surface.
    pub(super) fn normal_at(&self, at_m: Vec3) -> Vec3 {
        let face = |part: &Polyhedron| {
            let highest = part.planes().map(|p| (p.normal.dot(at_m) - p.offset_m, p.normal));
            highest.max_by(|a, b| a.0.total_cmp(&b.0))
        };
        let nearest = self.parts.iter().filter_map(face).min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
        nearest.map_or(Vec3::Z, |(_, normal)| normal)
    }
}

/// Faces that look the same way are one after the other, so that both sides of a wall are not mixed.
fn normal_octant(normal: Vec3) -> u8 {
    u8::from(normal.x < 0.0) | u8::from(normal.y < 0.0) << 1 | u8::from(normal.z < 0.0) << 2
}

fn morton(cell: [u32; 3]) -> u64 {
    let spread = |value: u32| (0..MORTON_BITS).fold(0_u64, |code, bit| code | u64::from(value >> bit & 1) << (3 * bit));
    spread(cell[0]) | spread(cell[1]) << 1 | spread(cell[2]) << 2
}

#[cfg(test)]
mod tests {
    use schema::{Purpose, ShapeKind, Solid, Stream};

    use super::*;

    /// Lines from anywhere, and along axes, beside edges and through corners.
    #[test]
    fn a_part_that_is_passed_over_is_nowhere_on_the_line() {
        let mut stream = Stream::new(5, 0, Purpose::Views, 0);
        let kinds = [ShapeKind::Cuboid, ShapeKind::Cylinder, ShapeKind::TriPrism, ShapeKind::HalfCylinder];
        for kind in kinds {
            let high_m = if kind == ShapeKind::HalfCylinder { 0.03 } else { 0.06 };
            let surface = Surface::of(&Solid::new(kind, Vec3::new(0.06, 0.06, high_m)).unwrap().into());
            let (mut hits, count) = (0, 20_000);
            for number in 0..count {
                let at_m = stream.point(Vec3::splat(-0.06), Vec3::splat(0.06));
                let whole = |at: Vec3, unit: f32| (at / unit).round() * unit;
                let (at_m, direction) = match number % 3 {
                    0 => (at_m, stream.rotation() * Vec3::X),
                    1 => (whole(at_m, 0.01), [Vec3::X, Vec3::NEG_Y, Vec3::Z][number / 3 % 3]),
                    _ => (whole(at_m, 0.03), whole(at_m, 0.03).normalize_or(Vec3::X)),
                };
                let ends = |all: Vec<Within>| -> Vec<_> {
                    let ahead = all.into_iter().filter(|of| of.exit_m > 0.0);
                    ahead.map(|of| (of.exit_m, of.exit_normal)).collect()
                };
                let found = ends(surface.inside(at_m, direction));
                let all = ends(within(surface.parts.iter(), at_m, direction));
                assert_eq!(found, all, "{kind:?} {at_m} {direction}");
                hits += found.len();
            }
            assert!(hits > count / 20, "{kind:?}: {hits}");
        }
    }
}
