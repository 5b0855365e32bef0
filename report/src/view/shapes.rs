//! Solids, grippers, tables and cameras as bodies and lines of a view.

use schema::{Grid, Gripper, GripperBox, Intrinsics, ObjectRecord, Pose, SceneRecord, Surface, Vec3};

use super::{Body, Class, Line, flat, flat_points};

/// Thickness of a table's top in a view, in metres, for display only.
const TABLE_THICKNESS_M: f32 = 0.004;
/// Length of a camera's pyramid in a view, in metres.
const CAMERA_LENGTH_M: f32 = 0.03;
/// Faces of a box as corner indices (bit 0 for +x, bit 1 for +y, bit 2 for +z), seen from outside.
const BOX_FACES: [[usize; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

impl Body {
    /// What is seen of an object.
    #[must_use]
    pub fn of_surface(class: Class, label: impl Into<String>, surface: Surface, poses: &[Pose]) -> Self {
        Self {
            class,
            label: label.into(),
            corners_m: flat_points(surface.corners_m),
            faces: surface.faces.into_iter().map(|face| face.ring).collect(),
            poses: poses.iter().map(flat).collect(),
        }
    }

    /// An object at rest, with what is known of it for a label.
    #[must_use]
    pub fn of_object(class: Class, object: &ObjectRecord) -> Self {
        let size_mm = object.shape.extents_m() * 1000.0;
        let label = format!(
            "object {}: {}\n{:.1} × {:.1} × {:.1} mm, {:.0} g, friction {:.2}",
            object.object_id,
            object.shape.name(),
            size_mm.x,
            size_mm.y,
            size_mm.z,
            object.mass_kg * 1000.0,
            object.friction
        );
        Self::of_surface(class, label, object.shape.surface(), &[object.workspace_from_object])
    }

    /// The container of a scene; none where the objects lie on the bare table.
    #[must_use]
    pub fn of_container(scene: &SceneRecord, grid: &Grid) -> Option<Self> {
        let container = scene.container?;
        let [x_mm, y_mm, height_mm, thickness_mm, _] = container.sizes().map(|size_m| size_m * 1000.0);
        let label = format!(
            "{}\n{x_mm:.0} × {y_mm:.0} mm inside, walls {height_mm:.0} mm high and {thickness_mm:.1} mm thick",
            container.kind.name()
        );
        let surface = Surface::of(None, &container.parts(grid));
        Some(Self::of_surface(Class::Container, label, surface, &[Pose::IDENTITY]))
    }

    /// An axis-parallel box in its frame.
    #[must_use]
    pub fn of_box(class: Class, label: impl Into<String>, gripper_box: &GripperBox, poses: &[Pose]) -> Self {
        let corners_m = flat_points(box_corners_m(gripper_box));
        let bare = Self::of_surface(class, label, Surface::default(), poses);
        Self { corners_m, faces: BOX_FACES.map(Vec::from).into(), ..bare }
    }

    /// The top of the table below a workspace of side `size_m`.
    #[must_use]
    pub fn table(size_m: f32, table_z_m: f32) -> Self {
        let half_m = Vec3::new(0.5 * size_m, 0.5 * size_m, 0.5 * TABLE_THICKNESS_M);
        let centre_m = Vec3::new(half_m.x, half_m.y, table_z_m - half_m.z);
        let label = format!("table, {:.0} mm above the workspace's floor", table_z_m * 1000.0);
        Self::of_box(Class::Table, label, &GripperBox { centre_m, half_m }, &[Pose::IDENTITY])
    }
}

pub(crate) fn box_corners_m(gripper_box: &GripperBox) -> impl Iterator<Item = Vec3> {
    let sign = |corner: usize, bit: usize| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
    let corner = move |c: usize| Vec3::new(sign(c, 0), sign(c, 1), sign(c, 2));
    (0..8).map(move |c| gripper_box.centre_m + gripper_box.half_m * corner(c))
}

impl Line {
    /// The twelve edges of the workspace from its lower to its upper corner, as one line that covers some of them
    /// twice.
    #[must_use]
    pub fn workspace([low_m, high_m]: [Vec3; 2]) -> Self {
        let (centre_m, half_m) = (0.5 * (low_m + high_m), 0.5 * (high_m - low_m));
        let corners: Vec<Vec3> = box_corners_m(&GripperBox { centre_m, half_m }).collect();
        let way = [0, 1, 3, 2, 0, 4, 5, 1, 5, 7, 3, 7, 6, 2, 6, 4];
        let [x, y, z] = (2e3 * half_m).to_array();
        let label = if x == y && y == z {
            format!("workspace, {x:.0} mm a side")
        } else {
            format!("workspace, {x:.0} x {y:.0} x {z:.0} mm")
        };
        Self { class: Class::Workspace, label, points_m: flat_points(way.map(|c| corners[c])), frames: None }
    }

    /// A gripper at a grasp as a fork: from the back of the palm to the fingers' roots, and out to their tips.
    #[must_use]
    pub fn fork(
        class: Class,
        label: impl Into<String>,
        gripper: &Gripper,
        workspace_from_grasp: &Pose,
        width_m: f32,
    ) -> Self {
        let (root_m, side_m) = (-gripper.finger_length_m, 0.5 * (width_m + gripper.finger_thickness_m));
        let back_m = root_m - gripper.palm_length_m;
        let way = [(-1.0, 0.0), (-1.0, root_m), (0.0, root_m), (0.0, back_m), (0.0, root_m), (1.0, root_m), (1.0, 0.0)];
        let point = |(side, z_m): (f32, f32)| workspace_from_grasp.transform_point(Vec3::new(0.0, side * side_m, z_m));
        Self { class, label: label.into(), points_m: flat_points(way.map(point)), frames: None }
    }

    /// A camera as the pyramid of its field of view.
    #[must_use]
    pub fn camera(label: impl Into<String>, workspace_from_camera: &Pose, lens: &Intrinsics) -> Self {
        let (right, bottom) = (lens.width_px as f32 - 1.0, lens.height_px as f32 - 1.0);
        let at = |[u, v]: [f32; 2]| {
            let ray = Vec3::new((u - lens.cx_px) / lens.fx_px, (v - lens.cy_px) / lens.fy_px, 1.0);
            workspace_from_camera.transform_point(ray * CAMERA_LENGTH_M)
        };
        let [a, b, c, d] = [[0.0, 0.0], [right, 0.0], [right, bottom], [0.0, bottom]].map(at);
        let eye = workspace_from_camera.translation;
        let points_m = flat_points([eye, a, b, eye, c, d, eye, d, a, b, c]);
        Self { class: Class::Camera, label: label.into(), points_m, frames: None }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};
    use std::sync::Arc;

    use schema::{Model, ModelPart, ObjectShape, ShapeKind, Solid, TriangleMesh};

    use super::*;

    fn vector(p: [f32; 3]) -> Vec3 {
        Vec3::from_array(p)
    }

    /// Every edge is traversed once in each direction, faces are flat, and point outwards.
    fn assert_closed(body: &Body, flat_m: f32) {
        let mut edges: BTreeMap<(usize, usize), usize> = BTreeMap::new();
        for face in &body.faces {
            for (place, from) in face.iter().enumerate() {
                *edges.entry((*from, face[(place + 1) % face.len()])).or_default() += 1;
            }
            let [a, b, c] = [0, 1, 2].map(|i| vector(body.corners_m[face[i]]));
            let normal = (b - a).cross(c - b).normalize();
            for corner in &body.corners_m {
                assert!(normal.dot(vector(*corner) - a) < flat_m, "{}: {face:?} does not look outwards", body.label);
            }
            for corner in face {
                let off = normal.dot(vector(body.corners_m[*corner]) - a);
                assert!(off.abs() < flat_m, "{}: {face:?} is not flat", body.label);
            }
        }
        for ((from, to), count) in &edges {
            assert_eq!((*count, edges.get(&(*to, *from))), (1, Some(&1)), "{}: edge {from} {to}", body.label);
        }
        let euler = body.corners_m.len() + body.faces.len() - edges.len() / 2;
        assert_eq!(euler, 2, "{}", body.label);
    }

    #[test]
    fn bodies_are_closed() {
        let sizes = [[0.03, 0.05, 0.07], [0.04, 0.04, 0.09], [0.08, 0.05, 0.04], [0.08, 0.06, 0.03]];
        for (kind, size) in ShapeKind::ALL.into_iter().zip(sizes) {
            let solid = Solid::new(kind, Vec3::from_array(size)).unwrap();
            let surface = ObjectShape::from(solid).surface();
            assert_closed(&Body::of_surface(Class::Object, kind.name(), surface, &[Pose::IDENTITY]), 1e-6);
        }
        assert_closed(&Body::table(0.3, 0.05), 1e-6);
    }

    #[test]
    fn a_part_of_more_than_48_corners_is_shown_with_its_hull_unless_there_is_a_mesh() {
        let corner = |at: u16| {
            let z = 1.0 - f32::from(2 * at + 1) / 200.0;
            let (sin, cos) = libm::sincosf(2.399_963_2 * f32::from(at)); // the golden angle
            Vec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() * 0.05 + Vec3::Z * z * 0.05
        };
        let corners: Vec<Vec3> = (0..200).map(corner).collect();
        let mut model = Model {
            name: "ball".to_owned(),
            mass_kg: 0.1,
            friction: 0.5,
            extents_m: Vec3::splat(0.1),
            volume_m3: 5e-4,
            parts: vec![ModelPart { corners_m: corners.clone() }],
            mesh: None,
        };
        let shown = |model: &Model| {
            let shape = ObjectShape::Model { number: 0, model: Arc::new(model.clone()) };
            Body::of_surface(Class::Object, "ball", shape.surface(), &[Pose::IDENTITY])
        };
        let body = shown(&model);
        // A hull's faces are flat to 1e-4 of its size.
        assert_closed(&body, 2e-5);
        let shown_bits: BTreeSet<[u32; 3]> = body.corners_m.iter().map(|corner| corner.map(f32::to_bits)).collect();
        assert_eq!(shown_bits, corners.iter().map(|corner| corner.to_array().map(f32::to_bits)).collect());
        let mesh = TriangleMesh::new(&corners[..4], vec![[0, 1, 2], [0, 2, 3]]).unwrap();
        model.mesh = Some(Arc::new(mesh.clone()));
        let body = shown(&model);
        assert_eq!(body.corners_m, flat_points(mesh.corners_m().iter().copied()));
        assert_eq!(body.faces, [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn the_table_s_top_is_the_table_s_height() {
        let highest = Body::table(0.3, 0.05).corners_m.iter().map(|c| c[2]).fold(0.0, f32::max);
        assert!((highest - 0.05).abs() < 1e-7, "{highest}");
    }

    #[test]
    fn the_workspace_s_line_goes_along_all_twelve_edges() {
        let line = Line::workspace([Vec3::ZERO, Vec3::splat(0.3)]);
        let mut edges: Vec<[Vec<u32>; 2]> = line
            .points_m
            .windows(2)
            .map(|pair| {
                let mut ends = [pair[0], pair[1]].map(|p| p.map(f32::to_bits).to_vec());
                ends.sort();
                ends
            })
            .collect();
        edges.sort();
        edges.dedup();
        assert_eq!(edges.len(), 12);
        for pair in line.points_m.windows(2) {
            assert!(((vector(pair[1]) - vector(pair[0])).length() - 0.3).abs() < 1e-6, "{pair:?}");
        }
    }

    #[test]
    fn a_fork_s_tips_are_where_the_fingers_end() {
        let gripper = Gripper::from_toml(Gripper::BUILT_IN[0].1).unwrap();
        let fork = Line::fork(Class::Gripper, "", &gripper, &Pose::from_translation(Vec3::X), 0.03);
        let (first, last) = (vector(fork.points_m[0]), vector(fork.points_m[6]));
        assert!(((last - first).length() - 0.03 - gripper.finger_thickness_m).abs() < 1e-6);
        assert!((0.5 * (first + last) - Vec3::X).length() < 1e-6, "midway between the tips is the grasp");
    }

    #[test]
    fn a_camera_s_pyramid_holds_what_it_looks_at() {
        let pose = Pose::from_translation(Vec3::new(0.1, 0.2, 0.3));
        let line = Line::camera("", &pose, &Intrinsics::VGN);
        assert_eq!(line.points_m[0], [0.1, 0.2, 0.3]);
        for corner in &line.points_m[1..3] {
            assert!((corner[2] - 0.3 - CAMERA_LENGTH_M).abs() < 1e-6, "{corner:?}");
        }
    }
}
