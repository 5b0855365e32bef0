//! A small picture of a scene: convex bodies on a table, and grasps as forks, coloured by how their attempts ended.
//!
//! The view is from above and the front, without perspective, so lengths along an axis are equal everywhere. Bodies are
//! painted from back to front without the faces that point away; grasps are on top, because they are the subject.

use std::fmt::Write as _;

use maud::Escaper;
use schema::{Outcome, Polyhedron, Pose, Vec3};

/// A grasp, drawn as a fork.
#[derive(Debug, Clone, PartialEq)]
pub struct Grasp {
    /// Pose of the grasp.
    pub workspace_from_grasp: Pose,
    /// Opening between the fingers, in metres.
    pub width_m: f32,
    /// How its attempt ended.
    pub outcome: Outcome,
    /// What a page says where the mouse rests on it, first its id: `7/19`.
    pub label: String,
}

/// Bodies and grasps on a table, in the workspace.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Scene {
    /// Side of the workspace, in metres.
    pub size_m: f32,
    /// Height of the table's top, in metres.
    pub table_z_m: f32,
    /// The bodies; the number selects the colour.
    pub bodies: Vec<(Polyhedron, usize)>,
    /// What the bodies lie in, drawn as edges.
    pub fixtures: Vec<Polyhedron>,
    /// Grasps.
    pub grasps: Vec<Grasp>,
}

/// Size of the picture.
const WIDTH_PX: f32 = 300.0;
const HEIGHT_PX: f32 = 280.0;
/// If there are more grasps, they are drawn thin.
const CROWD: usize = 12;
/// Colours of bodies: light, so that grasps stand out, and neither green nor red.
const TINTS: [[f32; 3]; 5] =
    [[150.0, 180.0, 214.0], [214.0, 188.0, 140.0], [178.0, 166.0, 208.0], [160.0, 196.0, 196.0], [205.0, 170.0, 190.0]];

/// From above and the front.
const TOWARDS_EYE: Vec3 = Vec3::new(0.45, -1.0, 1.15);

/// Where a point is, in pixels from the left and from the top: the table's diagonal fits.
fn see(scene: &Scene, point_m: Vec3) -> [f32; 2] {
    let middle_m = Vec3::new(0.5 * scene.size_m, 0.5 * scene.size_m, scene.table_z_m + 0.2 * scene.size_m);
    let off_px = (point_m - middle_m) * (WIDTH_PX / (1.34 * scene.size_m));
    let right = Vec3::Z.cross(TOWARDS_EYE).normalize_or_zero();
    let up = TOWARDS_EYE.cross(right).normalize_or_zero();
    [0.5 * WIDTH_PX + off_px.dot(right), 0.5 * HEIGHT_PX - off_px.dot(up)]
}

/// The scene as SVG; some colours come from the page's style sheet.
#[must_use]
pub fn svg(scene: &Scene) -> String {
    let mut text = format!("<svg class=\"scene\" viewBox=\"0 0 {WIDTH_PX} {HEIGHT_PX}\" role=\"img\">");
    // Writing to a String cannot fail, here and below.
    let side = scene.size_m;
    let table = [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]].map(|[x, y]| Vec3::new(x, y, scene.table_z_m));
    let _ = write!(text, "<polygon class=\"ground\" points=\"{}\"/>", points(scene, table.iter().copied()));
    paint(&mut text, scene);
    for (part, face) in scene.fixtures.iter().flat_map(|part| part.faces().iter().map(move |face| (part, face))) {
        let corners = points(scene, face.ring.iter().map(|corner| part.corners_m()[*corner]));
        let _ = write!(text, "<polygon class=\"face\" fill=\"none\" points=\"{corners}\"/>");
    }
    let mut grasps: Vec<&Grasp> = scene.grasps.iter().collect();
    grasps.sort_by_key(|grasp| grasp.outcome); // held grasps on top, collisions below
    let is_crowded = grasps.len() > CROWD;
    for grasp in grasps {
        let class = grasp.outcome.name();
        let (thick, strength) = if grasp.outcome == Outcome::Held { (1.6_f32, 1.0) } else { (1.2, 0.4) };
        let width = if is_crowded { thick } else { 1.5 * thick };
        let lines = fork(grasp).map(|line| format!("M{}", points(scene, line.into_iter()).replace(' ', "L"))).concat();
        let _ = write!(
            text,
            "<path class=\"{class}\" stroke-width=\"{width:.1}\" stroke-opacity=\"{strength:.2}\" d=\"{lines}\"><title>"
        );
        let _ = Escaper::new(&mut text).write_str(&grasp.label);
        text += "</title></path>";
    }
    text + "</svg>"
}

/// Paints bodies, the farthest first.
fn paint(text: &mut String, scene: &Scene) {
    let nearness = |body: &Polyhedron| {
        let corners_m = body.corners_m();
        TOWARDS_EYE.dot(corners_m.iter().sum::<Vec3>() / corners_m.len().max(1) as f32)
    };
    let mut bodies: Vec<&(Polyhedron, usize)> = scene.bodies.iter().collect();
    bodies.sort_by(|(a, _), (b, _)| nearness(a).total_cmp(&nearness(b)));
    let light = Vec3::new(-0.35, -0.55, 1.0).normalize();
    for (body, tint) in bodies {
        for face in body.faces() {
            let at = |i: usize| body.corners_m()[face.ring[i]];
            let normal = (at(1) - at(0)).cross(at(2) - at(0)).normalize_or_zero();
            if normal.dot(TOWARDS_EYE) <= 0.0 {
                continue;
            }
            let shade = 0.62 + 0.38 * normal.dot(light).max(0.0);
            let [r, g, b] = TINTS[tint % TINTS.len()].map(|channel| (channel * shade) as u8);
            let corners = points(scene, face.ring.iter().map(|corner| body.corners_m()[*corner]));
            let _ = write!(text, "<polygon class=\"face\" fill=\"#{r:02x}{g:02x}{b:02x}\" points=\"{corners}\"/>");
        }
    }
}

/// The grasp as two lines: the connected fingers, and the stem behind.
fn fork(grasp: &Grasp) -> [Vec<Vec3>; 2] {
    let (half, root, stem) = (0.5 * grasp.width_m, -0.04, -0.06);
    let at = |y: f32, z: f32| grasp.workspace_from_grasp.transform_point(Vec3::new(0.0, y, z));
    [vec![at(-half, 0.0), at(-half, root), at(half, root), at(half, 0.0)], vec![at(0.0, root), at(0.0, stem)]]
}

fn points(scene: &Scene, points_m: impl Iterator<Item = Vec3>) -> String {
    points_m.map(|point_m| see(scene, point_m)).map(|[x, y]| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use schema::{Quat, ShapeKind, Solid};

    use super::*;

    fn block() -> Polyhedron {
        let solid = Solid::new(ShapeKind::Cuboid, Vec3::new(0.06, 0.04, 0.08)).unwrap();
        Polyhedron::from(&solid)
    }

    #[test]
    fn of_a_block_three_faces_are_seen_and_grasps_lie_on_top() {
        let at = Pose::from_parts(Vec3::new(0.15, 0.15, 0.09), Quat::IDENTITY);
        let grasp = |outcome| Grasp { workspace_from_grasp: at, width_m: 0.06, outcome, label: "7/19 <".to_owned() };
        let scene = Scene {
            size_m: 0.3,
            table_z_m: 0.05,
            bodies: vec![(block().moved(&at), 0)],
            fixtures: Vec::new(),
            grasps: vec![grasp(Outcome::Held), grasp(Outcome::Slipped), grasp(Outcome::PregraspCollision)],
        };
        let svg = svg(&scene);
        assert_eq!(svg.matches("class=\"face\"").count(), 3, "{svg}");
        let classes = ["face", "pregrasp_collision", "slipped", "held"];
        let places = classes.map(|class| svg.find(&format!("class=\"{class}\"")).unwrap());
        assert!(places.is_sorted(), "{svg}");
        assert_eq!(svg.matches("<title>7/19 &lt;</title></path>").count(), 3, "{svg}");
    }

    #[test]
    fn the_workspace_fits_into_the_picture() {
        let scene = Scene { size_m: 0.3, table_z_m: 0.05, ..Scene::default() };
        for corner in 0..8_u8 {
            let side = |bit: u8| if corner & bit == 0 { 0.0 } else { 0.3 };
            let [x, y] = see(&scene, Vec3::new(side(1), side(2), 0.05 + 0.4 * side(4)));
            assert!((0.0..=WIDTH_PX).contains(&x) && (0.0..=HEIGHT_PX).contains(&y), "{corner}: {x} {y}");
        }
    }
}
