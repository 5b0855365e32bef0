//! A scene as a small picture: convex bodies on a table, and hands as forks, green if they held and red if not.
//!
//! Seen from above and the front, without perspective: a length along an axis is the same everywhere. Bodies are painted from
//! the back to the front, faces that look away are left out; hands lie over everything, for they are what is looked for.

use std::fmt::Write as _;

use schema::{Gripper, ObjectShape, Plane, Pose, Vec3};

/// A convex body, in metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Polyhedron {
    /// Its corners.
    pub corners_m: Vec<Vec3>,
    /// Its faces, as numbers of corners, counter-clockwise seen from outside.
    pub faces: Vec<Vec<usize>>,
}

/// A hand at a grasp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hand {
    /// Where the grasp is.
    pub workspace_from_grasp: Pose,
    /// Opening between the fingers, in metres.
    pub width_m: f32,
    /// Whether it held.
    pub held: bool,
    /// From 0 to 1: how much it is to be seen.
    pub strength: f32,
}

/// Bodies and hands on a table, in the workspace.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Scene {
    /// Side of the workspace, in metres.
    pub size_m: f32,
    /// Height of the table's top, in metres.
    pub table_z_m: f32,
    /// What lies there; the number picks the tint.
    pub bodies: Vec<(Polyhedron, usize)>,
    /// Hands.
    pub hands: Vec<Hand>,
}

/// Size of the picture.
const WIDTH_PX: f32 = 300.0;
const HEIGHT_PX: f32 = 280.0;
/// A face is flat to this share of the body's size: hulls of measured corners have faces of several nearly flat pieces.
const FLAT_SHARE: f32 = 1e-3;
/// More hands are drawn thin.
const CROWD: usize = 12;
/// Tints of bodies: light, so that hands stand out, and not green or red.
const TINTS: [[f32; 3]; 5] =
    [[150.0, 180.0, 214.0], [214.0, 188.0, 140.0], [178.0, 166.0, 208.0], [160.0, 196.0, 196.0], [205.0, 170.0, 190.0]];

impl Polyhedron {
    /// A convex body from its corners and the planes of its faces (outward unit normals), as [`schema::Solid::planes`] gives them.
    #[must_use]
    pub fn of_planes(corners_m: Vec<Vec3>, planes: &[Plane]) -> Self {
        let size = corners_m.iter().map(|corner| corner.length()).fold(0.0, f32::max);
        let face = |plane: &Plane| {
            let on = |at: &usize| (plane.normal.dot(corners_m[*at]) - plane.offset_m).abs() < FLAT_SHARE * size;
            let mut face: Vec<usize> = (0..corners_m.len()).filter(on).collect();
            let middle = face.iter().map(|at| corners_m[*at]).sum::<Vec3>() / face.len().max(1) as f32;
            let u = plane.normal.any_orthonormal_vector();
            let v = plane.normal.cross(u);
            let angle = |at: &usize| {
                let arm = corners_m[*at] - middle;
                libm::atan2f(arm.dot(v), arm.dot(u))
            };
            face.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
            face
        };
        let faces = planes.iter().map(face).filter(|face| face.len() > 2).collect();
        Self { corners_m, faces }
    }

    /// A convex body from its corners alone: every plane through three of them that has the others behind it is a face. That takes the
    /// fourth power of their number, so of many only those are kept that lie furthest out, each in a direction of its own.
    #[must_use]
    pub fn of_corners(corners_m: Vec<Vec3>) -> Self {
        let corners_m = outermost(corners_m);
        let size = corners_m.iter().map(|corner| corner.length()).fold(0.0, f32::max);
        let mut planes: Vec<Plane> = Vec::new();
        for (a, at) in corners_m.iter().enumerate() {
            for (b, to) in corners_m.iter().enumerate().skip(a + 1) {
                for over in &corners_m[b + 1..] {
                    let normal = (*to - *at).cross(*over - *at).normalize_or_zero();
                    for normal in [normal, -normal] {
                        let offset_m = normal.dot(*at);
                        let is_face = corners_m.iter().all(|corner| normal.dot(*corner) <= offset_m + 1e-4 * size);
                        let is_new = planes.iter().all(|plane| plane.normal.dot(normal) < 1.0 - 1e-5);
                        if normal != Vec3::ZERO && is_face && is_new {
                            planes.push(Plane { normal, offset_m });
                        }
                    }
                }
            }
        }
        Self::of_planes(corners_m, &planes)
    }

    /// The convex pieces of an object, in its frame.
    #[must_use]
    pub fn pieces(shape: &ObjectShape) -> Vec<Self> {
        match shape {
            ObjectShape::Solid(solid) => vec![Self { corners_m: solid.vertices_m(), faces: solid.faces() }],
            ObjectShape::Model { model, .. } => model.parts_m.iter().cloned().map(Self::of_corners).collect(),
        }
    }

    /// The body elsewhere.
    #[must_use]
    pub fn moved(mut self, pose: &Pose) -> Self {
        for corner in &mut self.corners_m {
            *corner = pose.transform_point(*corner);
        }
        self
    }

    fn middle_m(&self) -> Vec3 {
        self.corners_m.iter().sum::<Vec3>() / self.corners_m.len().max(1) as f32
    }
}

/// Corners that a picture's body has at most.
const CORNERS_MAX: usize = 48;

/// The corners, or of many those that are the furthest in as many directions, spread evenly (a Fibonacci lattice).
fn outermost(corners_m: Vec<Vec3>) -> Vec<Vec3> {
    if corners_m.len() <= CORNERS_MAX {
        return corners_m;
    }
    let direction = |at: usize| {
        let z = 1.0 - (2.0 * at as f32 + 1.0) / CORNERS_MAX as f32;
        let (sin, cos) = libm::sincosf(2.399_963_2 * at as f32); // the golden angle
        Vec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + Vec3::Z * z
    };
    let furthest = |at: usize| {
        let along = |corner: &usize| corners_m[*corner].dot(direction(at));
        (0..corners_m.len()).max_by(|a, b| along(a).total_cmp(&along(b))).unwrap_or_default()
    };
    let kept: std::collections::BTreeSet<usize> = (0..CORNERS_MAX).map(furthest).collect();
    kept.into_iter().map(|corner| corners_m[corner]).collect()
}

/// The eye: what is right, up and towards it.
struct Eye {
    right: Vec3,
    up: Vec3,
    towards: Vec3,
    middle_m: Vec3,
    px_per_m: f32,
}

impl Eye {
    fn at(scene: &Scene) -> Self {
        let towards = Vec3::new(0.45, -1.0, 1.15).normalize();
        let right = Vec3::Z.cross(towards).normalize();
        let middle_m = Vec3::new(0.5 * scene.size_m, 0.5 * scene.size_m, scene.table_z_m + 0.2 * scene.size_m);
        // The table's diagonal fits.
        Self { right, up: towards.cross(right), towards, middle_m, px_per_m: WIDTH_PX / (1.34 * scene.size_m) }
    }

    fn px(&self, point_m: Vec3) -> [f32; 2] {
        let arm = (point_m - self.middle_m) * self.px_per_m;
        [0.5 * WIDTH_PX + arm.dot(self.right), 0.5 * HEIGHT_PX - arm.dot(self.up)]
    }
}

/// The scene as SVG, its colours in part by the page's style sheet.
#[must_use]
pub fn svg(scene: &Scene) -> String {
    let eye = Eye::at(scene);
    let mut text = format!("<svg class=\"scene\" viewBox=\"0 0 {WIDTH_PX} {HEIGHT_PX}\" role=\"img\">");
    // Writing to a String cannot fail, here and below.
    let side = scene.size_m;
    let table = [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]].map(|[x, y]| Vec3::new(x, y, scene.table_z_m));
    let _ = write!(text, "<polygon class=\"ground\" points=\"{}\"/>", points(&eye, table.iter().copied()));
    let mut bodies: Vec<&(Polyhedron, usize)> = scene.bodies.iter().collect();
    bodies.sort_by(|(a, _), (b, _)| eye.towards.dot(a.middle_m()).total_cmp(&eye.towards.dot(b.middle_m())));
    for (body, tint) in bodies {
        paint(&mut text, &eye, body, TINTS[tint % TINTS.len()]);
    }
    let mut hands: Vec<&Hand> = scene.hands.iter().collect();
    hands.sort_by_key(|hand| hand.held); // what held lies on top
    let is_crowded = hands.len() > CROWD;
    for hand in hands {
        let class = if hand.held { "held" } else { "failed" };
        let width = if is_crowded { 1.0 } else { 1.5 } * if hand.held { 1.6_f32 } else { 1.2 };
        let strength = hand.strength;
        let lines = fork(hand).map(|line| format!("M{}", points(&eye, line.into_iter()).replace(' ', "L"))).concat();
        let _ = write!(
            text,
            "<path class=\"{class}\" stroke-width=\"{width:.1}\" stroke-opacity=\"{strength:.2}\" d=\"{lines}\"/>"
        );
    }
    text + "</svg>"
}

fn paint(text: &mut String, eye: &Eye, body: &Polyhedron, tint: [f32; 3]) {
    let light = Vec3::new(-0.35, -0.55, 1.0).normalize();
    for face in &body.faces {
        let at = |i: usize| body.corners_m[face[i]];
        let normal = (at(1) - at(0)).cross(at(2) - at(0)).normalize_or_zero();
        if normal.dot(eye.towards) <= 0.0 {
            continue;
        }
        let shade = 0.62 + 0.38 * normal.dot(light).max(0.0);
        let [r, g, b] = tint.map(|channel| (channel * shade) as u8);
        let corners = points(eye, face.iter().map(|corner| body.corners_m[*corner]));
        let _ = write!(text, "<polygon class=\"face\" fill=\"#{r:02x}{g:02x}{b:02x}\" points=\"{corners}\"/>");
    }
}

/// The hand as two lines: the fingers with what joins them, and the stem behind.
fn fork(hand: &Hand) -> [Vec<Vec3>; 2] {
    let (half, root, stem) = (0.5 * hand.width_m, -0.04, -0.06);
    let at = |y: f32, z: f32| hand.workspace_from_grasp.transform_point(Vec3::new(0.0, y, z));
    [vec![at(-half, 0.0), at(-half, root), at(half, root), at(half, 0.0)], vec![at(0.0, root), at(0.0, stem)]]
}

fn points(eye: &Eye, points_m: impl Iterator<Item = Vec3>) -> String {
    let one = |point_m: Vec3| {
        let [x, y] = eye.px(point_m);
        format!("{x:.1},{y:.1}")
    };
    points_m.map(one).collect::<Vec<_>>().join(" ")
}

/// How wide a hand is drawn that never closed: as it came.
#[must_use]
pub fn width_m(gripper: &Gripper, width_m: Option<f32>) -> f32 {
    width_m.unwrap_or(gripper.opening_m_max)
}

#[cfg(test)]
mod tests {
    use schema::{Quat, ShapeKind, Solid};

    use super::*;

    fn block() -> Polyhedron {
        let solid = Solid::new(ShapeKind::Cuboid, Vec3::new(0.06, 0.04, 0.08)).unwrap();
        Polyhedron { corners_m: solid.vertices_m(), faces: solid.faces() }
    }

    #[test]
    fn faces_from_planes_are_those_of_the_solid() {
        for kind in ShapeKind::ALL {
            let solid =
                Solid::new(kind, Vec3::new(0.06, 0.06, if kind == ShapeKind::HalfCylinder { 0.03 } else { 0.08 }));
            let solid = solid.unwrap();
            let found = Polyhedron::of_planes(solid.vertices_m(), &solid.planes());
            let turned = |face: &Vec<usize>| {
                let least = (0..face.len()).min_by_key(|at| face[*at]).unwrap();
                face.iter().cycle().skip(least).take(face.len()).copied().collect::<Vec<_>>()
            };
            let expected: Vec<Vec<usize>> = solid.faces().iter().map(turned).collect();
            assert_eq!(found.faces.iter().map(turned).collect::<Vec<_>>(), expected, "{kind:?}");
            let mut guessed: Vec<Vec<usize>> =
                Polyhedron::of_corners(solid.vertices_m()).faces.iter().map(turned).collect();
            let mut expected = expected;
            guessed.sort();
            expected.sort();
            assert_eq!(guessed, expected, "{kind:?} from its corners alone");
        }
    }

    #[test]
    fn of_a_ball_of_many_corners_a_closed_body_is_left() {
        let corner = |at: usize| {
            let (turn, rise) = (at as f32 * 0.37, libm::asinf(2.0 * at as f32 / 999.0 - 1.0));
            let (flat, z) = (libm::cosf(rise), libm::sinf(rise));
            Vec3::new(flat * libm::cosf(turn), flat * libm::sinf(turn), z) * 0.05
        };
        let ball = Polyhedron::of_corners((0..1000).map(corner).collect());
        assert!((30..=CORNERS_MAX).contains(&ball.corners_m.len()));
        let edges: Vec<(usize, usize)> =
            ball.faces.iter().flat_map(|f| (0..f.len()).map(|i| (f[i], f[(i + 1) % f.len()]))).collect();
        assert!(edges.iter().all(|(a, b)| edges.iter().filter(|edge| **edge == (*b, *a)).count() == 1));
    }

    #[test]
    fn of_a_block_three_faces_are_seen_and_hands_lie_on_top() {
        let at = Pose::from_parts(Vec3::new(0.15, 0.15, 0.09), Quat::IDENTITY);
        let hand = |held| Hand { workspace_from_grasp: at, width_m: 0.06, held, strength: 0.5 };
        let scene = Scene {
            size_m: 0.3,
            table_z_m: 0.05,
            bodies: vec![(block().moved(&at), 0)],
            hands: vec![hand(true), hand(false)],
        };
        let svg = svg(&scene);
        assert_eq!(svg.matches("class=\"face\"").count(), 3, "{svg}");
        let places = ["class=\"face\"", "class=\"failed\"", "class=\"held\""].map(|word| svg.find(word).unwrap());
        assert!(places.is_sorted(), "{svg}");
    }

    #[test]
    fn the_workspace_fits_into_the_picture() {
        let scene = Scene { size_m: 0.3, table_z_m: 0.05, ..Scene::default() };
        let eye = Eye::at(&scene);
        for corner in 0..8_u8 {
            let side = |bit: u8| if corner & bit == 0 { 0.0 } else { 0.3 };
            let [x, y] = eye.px(Vec3::new(side(1), side(2), 0.05 + 0.4 * side(4)));
            assert!((0.0..=WIDTH_PX).contains(&x) && (0.0..=HEIGHT_PX).contains(&y), "{corner}: {x} {y}");
        }
    }
}
