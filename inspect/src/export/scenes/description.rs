//! `scene.json`: what a scene's other files have, as plain numbers, and what they have no place for: the objects' poses
//! for URDF, the lens, the attempts.

use program::Failure;
use schema::{Container, Gripper, Intrinsics, Pose};
use serde::Serialize;

use super::world::World;

/// The format's name and version, the first field of the JSON.
const FORMAT: &str = "graspmill-scene/1";
const UNITS: &str = "metres, kilograms, seconds, newtons, radians; poses: position x y z, then quaternion x y z w; \
                     target_from_source maps a source's coordinates to the target";
const FRAMES: &str = "workspace: z up; grasp: midway between the finger tips, +z the approach, +y the closing direction; \
                      camera: x right, y down, z forward";

#[derive(Serialize)]
struct Description<'a> {
    format: &'static str,
    units: &'static str,
    frames: &'static str,
    dataset_id: &'a str,
    scene_id: u64,
    gravity_m_s2: f32,
    table: Table,
    container: Option<Walls>,
    objects: Vec<Object<'a>>,
    cameras: Vec<Camera>,
    hand: &'a Gripper,
    attempts: Vec<Attempt>,
}

#[derive(Serialize)]
struct Table {
    z_m: f32,
    friction: f32,
}

#[derive(Serialize)]
struct Walls {
    kind: &'static str,
    inner_m: [f32; 2],
    height_m: f32,
    thickness_m: f32,
    slope_rad: f32,
    friction: f32,
}

#[derive(Serialize)]
struct Object<'a> {
    name: &'a str,
    shape: &'a str,
    extents_m: [f32; 3],
    workspace_from_object: [f32; 7],
    mass_kg: f32,
    friction: f32,
    centre_of_mass_m: [f64; 3],
    /// xx, yy, zz, xy, xz, yz, about the centre of mass.
    inertia_kg_m2: [f64; 6],
}

#[derive(Serialize)]
struct Camera {
    name: String,
    workspace_from_camera: [f32; 7],
    width_px: usize,
    height_px: usize,
    fx_px: f32,
    fy_px: f32,
    cx_px: f32,
    cy_px: f32,
    vertical_field_of_view_rad: f64,
}

#[derive(Serialize)]
struct Attempt {
    attempt_id: u32,
    object: String,
    workspace_from_grasp: [f32; 7],
    outcome: &'static str,
    width_m: Option<f32>,
}

/// The file's text.
pub(super) fn json(world: &World) -> Result<String, Failure> {
    program::json(&Description {
        format: FORMAT,
        units: UNITS,
        frames: FRAMES,
        dataset_id: world.dataset_id,
        scene_id: world.scene_id,
        gravity_m_s2: world.physics.gravity_m_s2,
        table: Table { z_m: world.grid.table_z_m, friction: world.physics.table_friction },
        container: world.container.map(|container| walls(&container, world.physics.table_friction)),
        objects: objects(world),
        cameras: cameras(world),
        hand: world.hand,
        attempts: attempts(world),
    })
}

fn seven(pose: &Pose) -> [f32; 7] {
    let ([x, y, z], [i, j, k, w]) = (pose.translation.to_array(), pose.rotation.to_array());
    [x, y, z, i, j, k, w]
}

fn walls(container: &Container, friction: f32) -> Walls {
    let Container { kind, inner_m, height_m, thickness_m, slope_rad } = *container;
    Walls { kind: kind.name(), inner_m, height_m, thickness_m, slope_rad, friction }
}

fn objects<'a>(world: &'a World) -> Vec<Object<'a>> {
    let objects = world.objects.iter().map(|item| Object {
        name: &item.name,
        shape: item.row.shape.name(),
        extents_m: item.row.shape.extents_m().to_array(),
        workspace_from_object: seven(&item.row.workspace_from_object),
        mass_kg: item.row.mass_kg,
        friction: item.row.friction,
        centre_of_mass_m: item.mass.centre_m,
        inertia_kg_m2: item.mass.inertia_kg_m2,
    });
    objects.collect()
}

fn cameras(world: &World) -> Vec<Camera> {
    let Intrinsics { width_px, height_px, fx_px, fy_px, cx_px, cy_px } = world.lens;
    let cameras = world.cameras.iter().enumerate().map(|(number, pose)| Camera {
        name: format!("camera_{number}"),
        workspace_from_camera: seven(pose),
        width_px,
        height_px,
        fx_px,
        fy_px,
        cx_px,
        cy_px,
        vertical_field_of_view_rad: world.field_of_view_rad(),
    });
    cameras.collect()
}

fn attempts(world: &World) -> Vec<Attempt> {
    let attempts = world.attempts.iter().map(|row| Attempt {
        attempt_id: row.attempt_id,
        object: format!("object_{}", row.object_id),
        workspace_from_grasp: seven(&row.workspace_from_grasp),
        outcome: row.outcome.name(),
        width_m: row.width_m,
    });
    attempts.collect()
}
