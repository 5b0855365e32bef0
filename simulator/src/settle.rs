//! Dropping objects until they rest (paper 2.3, Fig. 2).
//!
//! The objects fall one after the other into an open box. When the last one rests, the box is removed, and the pile
//! comes to rest again. The free part of a fall is not simulated, and resting objects sleep until something touches
//! them. Objects that have left the workspace are not part of the scene.

use rapier3d::prelude::*;
use schema::{Grid, Physics, Pose, SettleParams, Vec3};

use crate::engine::{EngineBody, World};
use crate::{Body, Scene, SceneObject};

/// An object about to fall.
#[derive(Debug, Clone, PartialEq)]
pub struct ReleasedObject {
    /// Shape and size.
    pub body: Body,
    /// Mass in kilograms.
    pub mass_kg: f32,
    /// Coulomb friction coefficient.
    pub friction: f32,
    /// Pose at which it is released.
    pub workspace_from_object: Pose,
}

/// A scene that came to rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Settled {
    /// The objects that stayed in the workspace.
    pub scene: Scene,
    /// Simulated time, in seconds.
    pub settle_time_s: f32,
}

/// Why a scene was rejected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unsettled {
    /// An object still moved at the time limit.
    Moving,
    /// No object stayed in the workspace.
    Empty,
    /// A pose is not finite, or an object was shot through the table or far away.
    Unstable,
}

/// A falling object is simulated from this far above what it may hit.
const NEAR_M: f32 = 0.005;
/// Thickness and height of the temporary walls, in metres: high enough for objects dropped from 0.2 m.
const WALL_THICKNESS_M: f32 = 0.1;
const WALL_HEIGHT_M: f32 = 0.4;
/// An object this far from the workspace's centre, or this deep in the table, was shot away by the engine.
const ESCAPE_DISTANCE_M: f32 = 2.0;
const SUNK_DEPTH_M: f32 = 0.01;

/// Drops `drops` one by one into a box over the workspace and waits until they rest.
///
/// # Errors
/// [`Unsettled`] says why the scene is rejected; the caller draws another.
pub fn settle(
    physics: &Physics,
    params: &SettleParams,
    grid: &Grid,
    drops: &[ReleasedObject],
) -> Result<Settled, Unsettled> {
    let physics = &Physics { solver_iterations: params.solver_iterations, ..*physics };
    let mut world = World::new(physics, -Vec3::Z * physics.gravity_m_s2);
    world.add_table(&Pose::IDENTITY, grid.table_z_m, physics.table_friction);
    let mut pipeline = PhysicsPipeline::new();
    let walls = add_walls(&mut world, physics, grid);
    let mut bodies = Vec::with_capacity(drops.len());
    let mut steps = 0;
    for drop in drops {
        let low_z_m = lowest_z_m(&drop.body.vertices_m(), &drop.workspace_from_object);
        let fall = Fall::until_near(physics, params, low_z_m - top_z_m(&world, &bodies, drops, grid));
        let mut pose = drop.workspace_from_object;
        pose.translation.z -= fall.way_m;
        let body = world.add_object(&EngineBody::new(&drop.body, drop.mass_kg, drop.friction), pose);
        world.let_settle(body, params, -Vec3::Z * fall.speed_m_s);
        bodies.push(body);
        steps += fall.steps + rest(&mut world, &mut pipeline, physics, params, &bodies)?;
    }
    for wall in walls {
        world.remove_fixed(wall);
    }
    steps += rest(&mut world, &mut pipeline, physics, params, &bodies)?;

    let mut objects = Vec::with_capacity(drops.len());
    for (drop, body) in drops.iter().zip(&bodies) {
        let workspace_from_object = world.pose(*body);
        if !is_sane(&workspace_from_object, &drop.body, grid) {
            return Err(Unsettled::Unstable);
        }
        if is_over_workspace(workspace_from_object.translation, grid) {
            objects.push(SceneObject {
                body: drop.body.clone(),
                mass_kg: drop.mass_kg,
                friction: drop.friction,
                workspace_from_object,
            });
        }
    }
    if objects.is_empty() {
        return Err(Unsettled::Empty);
    }
    let scene = Scene { table_z_m: grid.table_z_m, objects };
    Ok(Settled { scene, settle_time_s: steps as f32 * physics.dt_s() })
}

/// Lets the `objects` that an attempt left behind come to rest, without walls. An object that rests outside the
/// workspace is removed, and the others come to rest again. The result may be empty.
///
/// # Errors
/// [`Unsettled::Moving`] or [`Unsettled::Unstable`]; an empty scene is valid.
pub fn settle_again(
    physics: &Physics,
    params: &SettleParams,
    grid: &Grid,
    objects: &[SceneObject],
) -> Result<Settled, Unsettled> {
    let physics = &Physics { solver_iterations: params.solver_iterations, ..*physics };
    let mut objects = objects.to_vec();
    let mut steps = 0;
    // The loop ends: every round but the last has fewer objects.
    loop {
        let count = objects.len();
        steps += rest_from(physics, params, grid, &mut objects)?;
        objects.retain(|object| is_over_workspace(object.workspace_from_object.translation, grid));
        if objects.len() == count {
            let scene = Scene { table_z_m: grid.table_z_m, objects };
            return Ok(Settled { scene, settle_time_s: steps as f32 * physics.dt_s() });
        }
    }
}

/// Moves objects to their resting poses on the bare table; returns the number of steps.
fn rest_from(
    physics: &Physics,
    params: &SettleParams,
    grid: &Grid,
    objects: &mut [SceneObject],
) -> Result<usize, Unsettled> {
    let sane = |object: &SceneObject| is_sane(&object.workspace_from_object, &object.body, grid);
    if !objects.iter().all(sane) {
        return Err(Unsettled::Unstable);
    }
    if objects.is_empty() {
        return Ok(0);
    }
    let mut world = World::new(physics, -Vec3::Z * physics.gravity_m_s2);
    world.add_table(&Pose::IDENTITY, grid.table_z_m, physics.table_friction);
    let mut bodies = Vec::with_capacity(objects.len());
    for object in &*objects {
        let engine_body = EngineBody::new(&object.body, object.mass_kg, object.friction);
        let body = world.add_object(&engine_body, object.workspace_from_object);
        world.let_settle(body, params, Vec3::ZERO);
        bodies.push(body);
    }
    let steps = rest(&mut world, &mut PhysicsPipeline::new(), physics, params, &bodies)?;
    for (object, body) in objects.iter_mut().zip(&bodies) {
        object.workspace_from_object = world.pose(*body);
    }
    if objects.iter().all(sane) { Ok(steps) } else { Err(Unsettled::Unstable) }
}

/// A fall through empty air.
struct Fall {
    steps: usize,
    way_m: f32,
    speed_m_s: f32,
}

impl Fall {
    /// The part of a fall of `height_m` during which nothing is near.
    fn until_near(physics: &Physics, params: &SettleParams, height_m: f32) -> Self {
        let (dt_s, mut fall) = (physics.dt_s(), Self { steps: 0, way_m: 0.0, speed_m_s: 0.0 });
        loop {
            let speed_m_s = (fall.speed_m_s + physics.gravity_m_s2 * dt_s) / (1.0 + params.damping_1_s * dt_s);
            let way_m = fall.way_m + speed_m_s * dt_s;
            if way_m + NEAR_M > height_m {
                return fall;
            }
            fall = Self { steps: fall.steps + 1, way_m, speed_m_s };
        }
    }
}

/// Height of the lowest of some corners.
fn lowest_z_m(corners_m: &[Vec3], pose: &Pose) -> f32 {
    corners_m.iter().map(|corner| pose.transform_point(*corner).z).fold(f32::INFINITY, f32::min)
}

/// Height of the highest corner of the dropped objects, or of the table.
fn top_z_m(world: &World, bodies: &[RigidBodyHandle], drops: &[ReleasedObject], grid: &Grid) -> f32 {
    let corner_z_m = bodies.iter().zip(drops).flat_map(|(body, drop)| {
        let pose = world.pose(*body);
        drop.body.vertices_m().into_iter().map(move |corner| pose.transform_point(corner).z)
    });
    corner_z_m.fold(grid.table_z_m, f32::max)
}

fn add_walls(world: &mut World, physics: &Physics, grid: &Grid) -> [ColliderHandle; 4] {
    let middle = 0.5 * grid.size_m;
    let out = middle + 0.5 * WALL_THICKNESS_M;
    let centre_z = grid.table_z_m + 0.5 * WALL_HEIGHT_M;
    let long = middle + WALL_THICKNESS_M;
    [(out, 0.0), (-out, 0.0), (0.0, out), (0.0, -out)].map(|(x, y)| {
        let half = if y == 0.0 { [0.5 * WALL_THICKNESS_M, long] } else { [long, 0.5 * WALL_THICKNESS_M] };
        let pose = Pose::from_parts(Vec3::new(middle + x, middle + y, centre_z), schema::Quat::IDENTITY);
        world.add_fixed_box(pose, Vec3::new(half[0], half[1], 0.5 * WALL_HEIGHT_M), physics.table_friction)
    })
}

/// Simulates until every body rests; returns the number of steps.
fn rest(
    world: &mut World,
    pipeline: &mut PhysicsPipeline,
    physics: &Physics,
    params: &SettleParams,
    bodies: &[RigidBodyHandle],
) -> Result<usize, Unsettled> {
    let (wanted, limit) = (physics.steps(params.rest_time_s), physics.steps(params.time_s_max));
    let mut resting = 0;
    for step in 1..=limit {
        world.step(pipeline);
        let still = bodies.iter().all(|body| {
            let [linear_m_s, angular_rad_s] = world.velocities(*body).map(Vec3::length);
            linear_m_s <= params.linear_speed_m_s_max && angular_rad_s <= params.angular_speed_rad_s_max
        });
        resting = if still { resting + 1 } else { 0 };
        if resting >= wanted {
            return Ok(step);
        }
    }
    Err(Unsettled::Moving)
}

fn is_sane(pose: &Pose, body: &Body, grid: &Grid) -> bool {
    let middle = Vec3::splat(0.5 * grid.size_m);
    let lowest = lowest_z_m(&body.vertices_m(), pose);
    (pose.translation - middle).length() < ESCAPE_DISTANCE_M && lowest > grid.table_z_m - SUNK_DEPTH_M
}

fn is_over_workspace(point: Vec3, grid: &Grid) -> bool {
    [point.x, point.y].iter().all(|c| (0.0..grid.size_m).contains(c))
}
