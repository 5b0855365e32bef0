//! The surface of an object alone: points that are spread evenly, and what is straight across from them.

use schema::{Polyhedron, Vec3, bounds_m};
use simulator::Body;

use super::part::LinedPart;
use crate::normals::{SEAM_M, Within};

/// Bits of a coordinate in the order along a Morton curve.
const MORTON_BITS: u32 = 10;

/// The outer surface of an object, in its frame.
pub(super) struct Surface {
    parts: Vec<LinedPart>,
    triangles: Vec<Triangle>,
    /// The area of all triangles up to each.
    areas_m2: Vec<f32>,
}

struct Triangle {
    corners_m: [Vec3; 3],
    normal: Vec3,
    part: usize,
}

/// A point on the surface and the outward normal there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SurfacePoint {
    pub(super) at_m: Vec3,
    pub(super) normal: Vec3,
}

impl Surface {
    /// Triangles that are near each other in space are near each other in their order, so that numbers that are spread
    /// evenly between 0 and 1 make points that are spread evenly over the surface.
    pub(super) fn of(body: &Body) -> Self {
        let polyhedra = body.polyhedra();
        let mut triangles: Vec<Triangle> =
            polyhedra.iter().enumerate().flat_map(|(part, polyhedron)| triangles_of(part, polyhedron)).collect();
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
        Self {
            areas_m2: areas_m2.collect(),
            parts: polyhedra.iter().map(|p| LinedPart::new(p.planes().collect(), p.corners_m())).collect(),
            triangles,
        }
    }

    /// The point that three numbers from 0 to 1 stand for, uniform by area; `None` if it is inside another part.
    pub(super) fn point(&self, [along, u, v]: [f32; 3]) -> Option<SurfacePoint> {
        let wanted_m2 = along * self.areas_m2.last()?;
        let number = self.areas_m2.partition_point(|area_m2| *area_m2 < wanted_m2).min(self.triangles.len() - 1);
        let Triangle { corners_m: [a, b, c], normal, part } = self.triangles[number];
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        let at_m = a + (b - a) * u + (c - a) * v;
        let outside_m = at_m + normal * SEAM_M;
        let is_within =
            |part: &LinedPart| part.planes.iter().all(|plane| plane.normal.dot(outside_m) <= plane.offset_m);
        let covered = self.parts.iter().enumerate().any(|(other, own)| other != part && is_within(own));
        (!covered).then_some(SurfacePoint { at_m, normal })
    }

    /// Where a line from a point of the surface, going into the object along `inwards`, leaves it: at the other side of
    /// a wall, and behind a hollow again.
    pub(super) fn across(&self, from_m: Vec3, inwards: Vec3) -> Vec<SurfacePoint> {
        let mut inside: Vec<Within> =
            self.parts.iter().filter_map(|part| part.within(from_m, inwards)).filter(|w| w.exit_m > 0.0).collect();
        inside.sort_by(|a, b| a.enter_m.total_cmp(&b.enter_m));
        let mut ends: Vec<(f32, Vec3)> = Vec::new();
        for part in inside {
            match ends.last_mut() {
                Some(end) if part.enter_m <= end.0 + SEAM_M => {
                    if part.exit_m > end.0 {
                        *end = (part.exit_m, part.exit_normal);
                    }
                }
                _ => ends.push((part.exit_m, part.exit_normal)),
            }
        }
        let point = |(exit_m, normal): (f32, Vec3)| SurfacePoint { at_m: from_m + inwards * exit_m, normal };
        ends.into_iter().map(point).collect()
    }

    /// The outward normal of the face that is nearest to a point of the surface.
    pub(super) fn normal_at(&self, at_m: Vec3) -> Vec3 {
        let face = |part: &LinedPart| {
            let highest = part.planes.iter().map(|p| (p.normal.dot(at_m) - p.offset_m, p.normal));
            highest.max_by(|a, b| a.0.total_cmp(&b.0))
        };
        let nearest = self.parts.iter().filter_map(face).min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
        nearest.map_or(Vec3::Z, |(_, normal)| normal)
    }
}

fn triangles_of(part: usize, polyhedron: &Polyhedron) -> Vec<Triangle> {
    let corners_m = polyhedron.corners_m();
    let fan = |face: &schema::Face| -> Vec<Triangle> {
        let normal = face.plane.normal;
        let triangle = |side: &[usize]| Triangle {
            corners_m: [face.ring[0], side[0], side[1]].map(|corner| corners_m[corner]),
            normal,
            part,
        };
        face.ring[1..].windows(2).map(triangle).collect()
    };
    polyhedron.faces().iter().flat_map(fan).collect()
}

/// Faces that look the same way are one after the other, so that both sides of a wall are not mixed.
fn normal_octant(normal: Vec3) -> u8 {
    u8::from(normal.x < 0.0) | u8::from(normal.y < 0.0) << 1 | u8::from(normal.z < 0.0) << 2
}

fn morton(cell: [u32; 3]) -> u64 {
    let spread = |value: u32| (0..MORTON_BITS).fold(0_u64, |code, bit| code | u64::from(value >> bit & 1) << (3 * bit));
    spread(cell[0]) | spread(cell[1]) << 1 | spread(cell[2]) << 2
}
