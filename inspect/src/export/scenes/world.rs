//! A scene as simulators take it: what moves, what stands still, the cameras, the hand and the attempts.

use std::fmt::Display;

use schema::{
    AttemptRecord, CameraParams, Container, Grid, Gripper, HandBox, Intrinsics, MassIntegrals, ObjectRecord, Physics,
    Polyhedron, Pose, Quat, SceneRows, ShapeKind, Vec3,
};
use shards::DatasetInfo;

/// Half lengths of the table, in metres; its top is in the middle of the workspace.
pub(super) const TABLE_HALF_M: [f32; 3] = [1.5, 1.5, 0.5];
/// Density of a palm's box, in kg/m³, because a gripper's file has no mass for it.
const PALM_DENSITY_KG_M3: f32 = 1_000.0;

/// A scene.
pub(super) struct World<'a> {
    pub(super) scene_id: u64,
    pub(super) dataset_id: &'a str,
    pub(super) physics: Physics,
    pub(super) grid: Grid,
    pub(super) objects: Vec<Item<'a>>,
    pub(super) container: Option<Container>,
    /// Its convex parts, in the workspace.
    pub(super) walls: Vec<Polyhedron>,
    pub(super) lens: Intrinsics,
    /// `workspace_from_camera`: x right, y down, z forward.
    pub(super) cameras: Vec<Pose>,
    pub(super) hand: &'a Gripper,
    pub(super) attempts: &'a [AttemptRecord],
}

/// An object.
pub(super) struct Item<'a> {
    /// `object_3`, for the row's `object_id`.
    pub(super) name: String,
    pub(super) row: &'a ObjectRecord,
    /// Its parts in its frame.
    pub(super) parts: Vec<Part>,
    pub(super) mass: Mass,
}

/// How a body's mass is distributed.
pub(super) struct Mass {
    pub(super) mass_kg: f32,
    /// In the body's frame, in metres.
    pub(super) centre_m: [f64; 3],
    /// xx, yy, zz, xy, xz, yz about the centre of mass, along the body's axes.
    pub(super) inertia_kg_m2: [f64; 6],
    /// The principal moments, and the rotation from the principal axes to the body's.
    pub(super) principal: ([f64; 3], Quat),
}

/// A convex part of an object.
pub(super) enum Part {
    /// A box about the frame's origin with these half lengths, in metres.
    Cuboid(Vec3),
    /// Anything else.
    Hull(Polyhedron),
}

impl<'a> World<'a> {
    /// The scene of some rows. Datasets whose settings do not say so have the shipped configs' physics and VGN's lens.
    pub(super) fn new(info: &'a DatasetInfo, dataset_id: &'a str, rows: &'a SceneRows) -> Self {
        let (scene, grid) = (&rows.scene, info.grid);
        Self {
            scene_id: scene.scene_id,
            dataset_id,
            physics: info.section::<Physics>("physics").unwrap_or(Physics::STANDARD),
            grid,
            objects: rows.objects.iter().map(Item::new).collect(),
            container: scene.container,
            walls: scene.fixtures(&grid),
            lens: info.section::<CameraParams>("camera").map_or(Intrinsics::VGN, |camera| camera.intrinsics()),
            cameras: scene.views.iter().map(|view| view.workspace_from_camera(&grid)).collect(),
            hand: info.hand_of(scene.scene_id),
            attempts: &rows.attempts,
        }
    }

    /// The middle of the table's box, in metres.
    pub(super) fn table_centre_m(&self) -> [f32; 3] {
        let middle_m = 0.5 * self.grid.size_m;
        [middle_m, middle_m, self.grid.table_z_m - TABLE_HALF_M[2]]
    }

    /// The whole vertical angle that a camera sees, in radians.
    pub(super) fn field_of_view_rad(&self) -> f64 {
        let Intrinsics { height_px, fy_px, .. } = self.lens;
        2.0 * libm::atan(0.5 * height_px as f64 / f64::from(fy_px))
    }

    /// The cameras in the axes of OpenGL, USD and MuJoCo: x right, y up, z backwards.
    pub(super) fn cameras_looking_back(&self) -> impl Iterator<Item = Pose> {
        let about_x = Quat::from_xyzw(1.0, 0.0, 0.0, 0.0);
        self.cameras.iter().map(move |pose| Pose::from_parts(pose.translation, pose.rotation * about_x))
    }
}

impl<'a> Item<'a> {
    fn new(row: &'a ObjectRecord) -> Self {
        let polyhedra = row.shape.parts();
        let mass = Mass::of(&polyhedra, row.mass_kg);
        let parts = match row.shape.as_solid() {
            Some(solid) if solid.kind == ShapeKind::Cuboid => vec![Part::Cuboid(0.5 * solid.extents_m)],
            _ => polyhedra.into_iter().map(Part::Hull).collect(),
        };
        Self { name: format!("object_{}", row.object_id), row, parts, mass }
    }

    /// Names of its parts.
    pub(super) fn part_names(&self) -> Vec<String> {
        (0..self.parts.len()).map(|part| format!("{}_part_{part}", self.name)).collect()
    }
}

impl Mass {
    /// Of parts of one density that together have this mass. Parts that overlap count twice there, as in our physics.
    fn of(parts: &[Polyhedron], mass_kg: f32) -> Self {
        let integrals = parts.iter().map(MassIntegrals::from).fold(MassIntegrals::ZERO, |sum, part| sum.plus(&part));
        let tensor = integrals.inertia_kg_m2(f64::from(mass_kg));
        Self {
            mass_kg,
            centre_m: integrals.centre_m().to_array(),
            inertia_kg_m2: [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(|(i, j)| tensor.col(i)[j]),
            principal: integrals.principal(f64::from(mass_kg)),
        }
    }

    /// Of a box of the hand.
    pub(super) fn of_box(shape: &HandBox, mass_kg: f32) -> Self {
        let squares_m2 = shape.half_m.to_array().map(|half_m| f64::from(half_m * half_m));
        // A third of the mass times the squares of the half lengths.
        let moment = |axis: usize| f64::from(mass_kg) / 3.0 * (squares_m2.iter().sum::<f64>() - squares_m2[axis]);
        let moments = [0, 1, 2].map(moment);
        let [xx, yy, zz] = moments;
        Self {
            mass_kg,
            centre_m: shape.centre_m.to_array().map(f64::from),
            inertia_kg_m2: [xx, yy, zz, 0.0, 0.0, 0.0],
            principal: (moments, Quat::IDENTITY),
        }
    }
}

/// Mass of a palm, in kilograms.
pub(super) fn palm_mass_kg(hand: &Gripper) -> f32 {
    let [x, y, z] = hand.palm().half_m.to_array();
    8.0 * x * y * z * PALM_DENSITY_KG_M3
}

/// Numbers with spaces between them.
pub(super) fn spaced(values: impl IntoIterator<Item = impl Display>) -> String {
    joined(values, " ")
}

/// Numbers with commas between them.
pub(super) fn listed(values: impl IntoIterator<Item = impl Display>) -> String {
    joined(values, ", ")
}

fn joined(values: impl IntoIterator<Item = impl Display>, between: &str) -> String {
    values.into_iter().map(|value| value.to_string()).collect::<Vec<_>>().join(between)
}

/// A quaternion as MuJoCo and USD write it: w, x, y, z.
pub(super) fn wxyz(rotation: Quat) -> [f32; 4] {
    let [x, y, z, w] = rotation.to_array();
    [w, x, y, z]
}
