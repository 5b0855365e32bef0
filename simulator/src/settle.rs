//! Dropping objects until they rest (paper 2.3, Fig. 2).
//!
//! The objects fall one after the other into an open box. When the last one rests, the box is removed, and the pile
//! comes to rest again. The free part of a fall is not simulated, and resting objects sleep until something touches
//! them. Objects that have left the workspace are not part of the scene.

use rapier3d::prelude::*;
use schema::{Grid, Physics, Pose, SettleParams, Vec3};

use crate::engine::{EngineBody, World};
use crate::{Scene, SceneObject};

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
    drops: &[SceneObject],
) -> Result<Settled, Unsettled> {
    let mut pile = Pile::new(physics, params, grid);
    let walls = pile.add_walls();
    for drop in drops {
        let low_z_m = lowest_z_m(drop);
        let fall = Fall::until_near(physics, params, low_z_m - pile.top_z_m(drops));
        let mut pose = drop.workspace_from_object;
        pose.translation.z -= fall.way_m;
        pile.add(drop, pose, -Vec3::Z * fall.speed_m_s);
        pile.steps += fall.steps;
        pile.rest()?;
    }
    for wall in walls {
        pile.world.remove_fixed(wall);
    }
    pile.rest()?;
    let mut objects = pile.objects(drops)?;
    objects.retain(|object| is_over_workspace(object, grid));
    if objects.is_empty() { Err(Unsettled::Empty) } else { Ok(pile.settled(objects)) }
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
    let mut objects = objects.to_vec();
    let mut steps = 0;
    // The loop ends: every round but the last has fewer objects.
    loop {
        let mut pile = Pile { steps, ..Pile::new(physics, params, grid) };
        all_sane(&objects, grid)?;
        for object in &objects {
            pile.add(object, object.workspace_from_object, Vec3::ZERO);
        }
        if !objects.is_empty() {
            pile.rest()?;
        }
        let count = objects.len();
        objects = pile.objects(&objects)?;
        objects.retain(|object| is_over_workspace(object, grid));
        if objects.len() == count {
            return Ok(pile.settled(objects));
        }
        steps = pile.steps;
    }
}

/// A world in which objects come to rest on the table.
struct Pile<'a> {
    physics: Physics,
    params: &'a SettleParams,
    grid: &'a Grid,
    world: World,
    pipeline: PhysicsPipeline,
    bodies: Vec<RigidBodyHandle>,
    steps: usize,
}

impl<'a> Pile<'a> {
    fn new(physics: &Physics, params: &'a SettleParams, grid: &'a Grid) -> Self {
        let physics = Physics { solver_iterations: params.solver_iterations, ..*physics };
        let mut world = World::new(&physics, -Vec3::Z * physics.gravity_m_s2);
        world.add_table(&Pose::IDENTITY, grid.table_z_m, physics.table_friction);
        Self { physics, params, grid, world, pipeline: PhysicsPipeline::new(), bodies: Vec::new(), steps: 0 }
    }

    fn add(&mut self, object: &SceneObject, pose: Pose, velocity_m_s: Vec3) {
        let engine_body = EngineBody::new(&object.body, object.mass_kg, object.friction);
        let body = self.world.add_object(&engine_body, pose);
        self.world.let_settle(body, self.params, velocity_m_s);
        self.bodies.push(body);
    }

    fn add_walls(&mut self) -> [ColliderHandle; 4] {
        let middle = 0.5 * self.grid.size_m;
        let out = middle + 0.5 * WALL_THICKNESS_M;
        let centre_z = self.grid.table_z_m + 0.5 * WALL_HEIGHT_M;
        let long = middle + WALL_THICKNESS_M;
        [(out, 0.0), (-out, 0.0), (0.0, out), (0.0, -out)].map(|(x, y)| {
            let half = if y == 0.0 { [0.5 * WALL_THICKNESS_M, long] } else { [long, 0.5 * WALL_THICKNESS_M] };
            let pose = Pose::from_translation(Vec3::new(middle + x, middle + y, centre_z));
            let half_m = Vec3::new(half[0], half[1], 0.5 * WALL_HEIGHT_M);
            self.world.add_fixed_box(pose, half_m, self.physics.table_friction)
        })
    }

    /// Height of the highest corner of the dropped objects, or of the table.
    fn top_z_m(&self, drops: &[SceneObject]) -> f32 {
        let corner_z_m = self.bodies.iter().zip(drops).flat_map(|(body, drop)| {
            let pose = self.world.pose(*body);
            drop.body.vertices_m().into_iter().map(move |corner| pose.transform_point(corner).z)
        });
        corner_z_m.fold(self.grid.table_z_m, f32::max)
    }

    /// Simulates until every body rests.
    fn rest(&mut self) -> Result<(), Unsettled> {
        let (physics, params) = (self.physics, self.params);
        let (wanted, limit) = (physics.steps(params.rest_time_s), physics.steps(params.time_s_max));
        let mut resting = 0;
        for step in 1..=limit {
            self.world.step(&mut self.pipeline);
            let still = self.bodies.iter().all(|body| {
                let [linear_m_s, angular_rad_s] = self.world.velocities(*body).map(Vec3::length);
                linear_m_s <= params.linear_speed_m_s_max && angular_rad_s <= params.angular_speed_rad_s_max
            });
            resting = if still { resting + 1 } else { 0 };
            if resting >= wanted {
                self.steps += step;
                return Ok(());
            }
        }
        Err(Unsettled::Moving)
    }

    /// The objects at the poses that they have now.
    fn objects(&self, objects: &[SceneObject]) -> Result<Vec<SceneObject>, Unsettled> {
        let moved = |(object, body): (&SceneObject, &RigidBodyHandle)| SceneObject {
            workspace_from_object: self.world.pose(*body),
            ..object.clone()
        };
        let objects: Vec<SceneObject> = objects.iter().zip(&self.bodies).map(moved).collect();
        all_sane(&objects, self.grid)?;
        Ok(objects)
    }

    fn settled(&self, objects: Vec<SceneObject>) -> Settled {
        let scene = Scene { table_z_m: self.grid.table_z_m, objects };
        Settled { scene, settle_time_s: self.steps as f32 * self.physics.dt_s() }
    }
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

/// Height of an object's lowest corner.
fn lowest_z_m(object: &SceneObject) -> f32 {
    let z_m = |corner: &Vec3| object.workspace_from_object.transform_point(*corner).z;
    object.body.vertices_m().iter().map(z_m).fold(f32::INFINITY, f32::min)
}

fn all_sane(objects: &[SceneObject], grid: &Grid) -> Result<(), Unsettled> {
    let middle = Vec3::splat(0.5 * grid.size_m);
    let is_sane = |object: &SceneObject| {
        (object.workspace_from_object.translation - middle).length() < ESCAPE_DISTANCE_M
            && lowest_z_m(object) > grid.table_z_m - SUNK_DEPTH_M
    };
    if objects.iter().all(is_sane) { Ok(()) } else { Err(Unsettled::Unstable) }
}

fn is_over_workspace(object: &SceneObject, grid: &Grid) -> bool {
    let point = object.workspace_from_object.translation;
    [point.x, point.y].iter().all(|c| (0.0..grid.size_m).contains(c))
}
