//! The surface of an object alone: points that are spread evenly, what is straight across from them, and where on it
//! fingers press. Of an object with a mesh the parts say what is inside, and the mesh where that ends.

use schema::{Face, Polyhedron, Vec3, bounds_m};
use simulator::Body;

use crate::normals::{SEAM_M, Within, within};

/// Bits of a coordinate in the order along a Morton curve.
const MORTON_BITS: u32 = 10;
/// Parts leave their mesh by less than this, in metres.
const OFF_M: f32 = 0.001;

/// The outer surface of an object, in its frame.
pub(super) struct Surface {
    parts: Vec<Polyhedron>,
    is_mesh: bool,
    triangles: Vec<Triangle>,
    /// The area of all triangles up to each.
    areas_m2: Vec<f32>,
}

struct Triangle {
    corners_m: [Vec3; 3],
    normal: Vec3,
    /// The direction of the longest edge of its face.
    along: Vec3,
    middle_m: Vec3,
    /// All of it is this near to its middle, in metres.
    radius_m: f32,
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
        let (mesh, is_mesh) = (body.mesh().map(AsRef::as_ref), body.mesh().is_some());
        let schema::Surface { corners_m, faces } = schema::Surface::of(mesh, body.polyhedra());
        let triangles_of = |face: &Face| -> Vec<Triangle> {
            let normal = face.plane.normal;
            let ends = face.ring.iter().zip(face.ring.iter().cycle().skip(1));
            let mut edges: Vec<Vec3> = ends.map(|(from, to)| corners_m[*to] - corners_m[*from]).collect();
            edges.sort_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
            // The longest of a triangle is mostly a diagonal, and no edge.
            let along = edges.iter().nth_back(usize::from(is_mesh)).copied().unwrap_or_default();
            let along = along.normalize_or(normal.any_orthonormal_vector());
            let triangle = |corners: [usize; 3]| {
                let corners_m = corners.map(|c| corners_m[c]);
                let middle_m = corners_m.iter().sum::<Vec3>() / 3.0;
                let radius_m = corners_m.iter().fold(0.0, |far: f32, c| c.distance(middle_m).max(far));
                Triangle { corners_m, normal, along, middle_m, radius_m }
            };
            face.triangles().map(triangle).collect()
        };
        let mut triangles: Vec<Triangle> = faces.iter().flat_map(triangles_of).collect();
        let [low, high] = bounds_m(&corners_m);
        let cells = ((1_u32 << MORTON_BITS) - 1) as f32;
        let place = |triangle: &Triangle| {
            let share = (triangle.middle_m - low) / (high - low).max(Vec3::splat(1e-9));
            share.to_array().map(|share| (share.clamp(0.0, 1.0) * cells) as u32)
        };
        triangles.sort_by_key(|triangle| (normal_octant(triangle.normal), morton(place(triangle))));
        let mut sum_m2 = 0.0;
        let areas_m2 = triangles.iter().map(|triangle| {
            let [a, b, c] = triangle.corners_m;
            sum_m2 += 0.5 * (b - a).cross(c - a).length();
            sum_m2
        });
        Self { areas_m2: areas_m2.collect(), parts: body.polyhedra().to_vec(), is_mesh, triangles }
    }

    /// The point that three numbers from 0 to 1 stand for, uniform by area; `None` if it is inside another part, or so
    /// deep in one that nothing comes to the mesh.
    pub(super) fn point(&self, [along, u, v]: [f32; 3]) -> Option<SurfacePoint> {
        let wanted_m2 = along * self.areas_m2.last()?;
        let number = self.areas_m2.partition_point(|area_m2| *area_m2 < wanted_m2).min(self.triangles.len() - 1);
        let Triangle { corners_m: [a, b, c], normal, along, .. } = self.triangles[number];
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        let at_m = a + (b - a) * u + (c - a) * v;
        let is_covered = |normal: Vec3| {
            let outside_m = at_m + normal * if self.is_mesh { OFF_M } else { SEAM_M };
            self.parts.iter().any(|part| part.planes().all(|plane| plane.normal.dot(outside_m) <= plane.offset_m))
        };
        // A mesh may be inside out.
        let normal = if self.is_mesh && is_covered(normal) { -normal } else { normal };
        (!is_covered(normal)).then_some(SurfacePoint { at_m, normal, along })
    }

    /// Where the line through a point is inside the object's parts, on both sides of the point.
    pub(super) fn inside(&self, at_m: Vec3, direction: Vec3) -> Vec<Within> {
        // Most lines pass by most parts.
        let is_near = |part: &&Polyhedron| {
            let (to_m, far_m) = (part.centre_m() - at_m, 1.001 * part.radius_m() + 1e-5);
            let along_m = to_m.dot(direction);
            to_m.length_squared() - along_m * along_m <= far_m * far_m
        };
        within(self.parts.iter().filter(is_near), at_m, direction)
    }

    /// The same with the end on the mesh, if there is one.
    pub(super) fn ended(&self, within: Within, at_m: Vec3, direction: Vec3) -> Within {
        if !self.is_mesh {
            return within;
        }
        let [on_m, exit_normal] = self.touched([at_m + direction * within.exit_m, -direction]);
        Within { exit_m: (on_m - at_m).dot(direction), exit_normal, ..within }
    }

    /// The point of the surface that is nearest to one at which something presses that moves along `push`, and the
    /// outward normal there. A side that looks away is pressed only if no other is near: of a mesh that is inside out.
    pub(super) fn touched(&self, [at_m, push]: [Vec3; 2]) -> [Vec3; 2] {
        let (mut least_m, mut best) = (f32::INFINITY, [at_m, -push]);
        for triangle in &self.triangles {
            // Rounding is far below the slack.
            if triangle.middle_m.distance(at_m) > 1.001 * (least_m + triangle.radius_m) {
                continue;
            }
            let (on_m, normal) = (nearest_m(triangle, at_m), triangle.normal);
            let (behind_m, normal) = if normal.dot(push) < 0.0 { (0.0, normal) } else { (OFF_M, -normal) };
            let far_m = on_m.distance(at_m) + behind_m;
            if far_m < least_m {
                (least_m, best) = (far_m, [on_m, normal]);
            }
        }
        best
    }
}

/// The point of a triangle that is nearest to another.
fn nearest_m(triangle: &Triangle, at_m: Vec3) -> Vec3 {
    let Triangle { corners_m: [a, b, c], normal, .. } = *triangle;
    let sides = [[a, b], [b, c], [c, a]];
    if sides.iter().all(|[from, to]| normal.dot((*to - *from).cross(at_m - *from)) >= 0.0) {
        return at_m - normal * normal.dot(at_m - a);
    }
    let on_sides = sides.map(|[from, to]: [Vec3; 2]| {
        let way_m = to - from;
        from + way_m * ((at_m - from).dot(way_m) / way_m.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0)
    });
    on_sides.into_iter().fold(a, |one, other| if other.distance(at_m) < one.distance(at_m) { other } else { one })
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
    use core::f32::consts::{PI, TAU};
    use std::sync::Arc;

    use schema::{Pose, Purpose, ShapeKind, Solid, Stream, TriangleMesh};
    use simulator::{Part, PartShape};

    use super::*;
    use crate::catalogue::CatalogueObject;
    use crate::{AnnotateParams, Annotated, annotate};

    /// A cup without a bottom, 60 mm wide and high, with a wall of 3 mm: a mesh of so many sides, and so many parts,
    /// whose corners are on the same circles.
    fn cup(sides: u32, parts: u32) -> Body {
        let at = |[radius_m, z_m]: [f32; 2], side: u32, all: u32| {
            let (sin, cos) = libm::sincosf(TAU * (side % all) as f32 / all as f32);
            Vec3::new(radius_m * cos, radius_m * sin, z_m)
        };
        let outline_m = [[0.027, -0.03], [0.03, -0.03], [0.03, 0.03], [0.027, 0.03]];
        let part = |number: u32| {
            let corners = outline_m.iter().flat_map(|point| [number, number + 1].map(|side| at(*point, side, parts)));
            let hull = Polyhedron::hull_of(&corners.collect::<Vec<_>>()).unwrap();
            Part { shape: PartShape::Hull(hull), object_from_part: Pose::IDENTITY }
        };
        let corners_m = outline_m.iter().flat_map(|point| (0..sides).map(move |side| at(*point, side, sides)));
        let triangles = (0..4).flat_map(|ring| (0..sides).map(move |side| (ring, side))).flat_map(|(ring, side)| {
            let [a, b] = [side, (side + 1) % sides].map(|side| ring * sides + side);
            let [d, c] = [side, (side + 1) % sides].map(|side| (ring + 1) % 4 * sides + side);
            [[a, b, c], [a, c, d]]
        });
        let mesh = TriangleMesh::new(&corners_m.collect::<Vec<_>>(), triangles.collect()).unwrap();
        Body::of_parts("cup", (0..parts).map(part).collect()).unwrap().with_mesh(Some(Arc::new(mesh)))
    }

    #[test]
    fn the_nearest_point_is_on_the_side_that_is_pressed() {
        let surface = Surface::of(&cup(96, 12));
        // In the wall, nearer to its inner side; both fingers are told the side that they come from. There is an edge,
        // beside which the sides lean by half of the angle between them.
        let at_m = Vec3::new(0.0, 0.0283, 0.0);
        for (push, y_m) in [(Vec3::Y, 0.027), (Vec3::NEG_Y, 0.03)] {
            let [on_m, normal] = surface.touched([at_m, push]);
            assert!((on_m - Vec3::new(0.0, y_m, 0.0)).length() < 0.0018 * PI / 96.0, "{on_m}");
            assert!(normal.dot(push) < -0.99, "{normal}");
        }
    }

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

    /// The parts leave the mesh by up to a millimetre, and what is drawn and told is the mesh.
    #[test]
    fn fingers_press_on_the_mesh_of_a_cup() {
        let (body, origin_m) = (cup(96, 12), Vec3::new(0.5, -1.0, 2.0));
        let object = CatalogueObject { body, mass_kg: 0.1, friction: 0.8, origin_m: Vec3::ZERO };
        let file = "a test".to_owned();
        let object = Annotated { object, file, file_sha256: None, scale_m: 1.0, origin_m, warnings: Vec::new() };
        let params = AnnotateParams { grasps: 200, drops: 0, repeats: 0, ..AnnotateParams::default() };
        let set = annotate(&object, &params, &mut |_| true).unwrap();
        assert_eq!(set.mesh.as_ref().unwrap().corners_m().len(), 4 * 96);
        let (mut pressed, mut off_parts) = (0, 0);
        for grasp in set.grasps.iter().filter(|grasp| grasp.width_m.is_some_and(|width_m| width_m > 0.001)) {
            for (at_m, normal) in grasp.contacts_m.into_iter().zip(grasp.normals) {
                let (Some(at_m), Some(normal)) = (at_m, normal) else { continue };
                let at_m = at_m - object.origin_m;
                let (outwards, radius_m) = (at_m.truncate().normalize().extend(0.0), at_m.truncate().length());
                // A side of a 96-gon is 16 µm within its circle.
                let walls_m = [0.03, 0.027].map(|wall_m: f32| (radius_m - wall_m).abs());
                let is_at_rim = (at_m.z.abs() - 0.03).abs() < 2e-6 && (0.0269..0.0301).contains(&radius_m);
                let is_on_wall = walls_m[0].min(walls_m[1]) < 2e-5 && at_m.z.abs() < 0.0301;
                assert!(is_at_rim || is_on_wall, "{at_m}: {grasp:?}");
                let side = if walls_m[0] < walls_m[1] { 1.0 } else { -1.0 };
                assert!(is_at_rim || normal.dot(outwards) * side > 0.99, "{at_m} {normal}");
                pressed += 1;
                off_parts += u32::from(object.object.body.distance_outside_m(at_m).abs() > 1e-4);
            }
        }
        assert!(pressed > 150 && off_parts > pressed / 4, "{off_parts} of {pressed}");
    }
}
