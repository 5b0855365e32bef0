//! Objects on a table, as an engine has them: what attempts and piles ask of physics. The frame of an attempt is that
//! of the grasp, the frame of a pile that of the workspace.
//!
//! [`Stepper`](crate::stepper::Stepper) is ours and made for this; rapier is the reference.

use rapier3d::prelude::{ColliderHandle, PhysicsWorld, RigidBodyHandle};
use schema::{Physics, Polyhedron, Pose, SettleParams, Vec3};

use crate::engine::{EngineBody, LENGTH_UNIT_M, UNITS_PER_M, add_fixed_box, add_object, pose_of, world_with_table};

/// Objects that move. They are known by their indices.
pub(crate) trait Bodies {
    /// Advances by one step.
    fn step(&mut self);

    /// Where an object is.
    fn pose(&self, object_id: usize) -> Pose;

    /// Velocity of an object's centre of mass in m/s, and its angular velocity in rad/s.
    fn velocities(&self, object_id: usize) -> [Vec3; 2];

    /// Whether an object moves no faster than that, in m/s and rad/s, against what moves by `frame_m_s`.
    fn is_slow(&self, object_id: usize, frame_m_s: Vec3, [most_m_s, most_rad_s]: [f32; 2]) -> bool {
        let [linear_m_s, angular_rad_s] = self.velocities(object_id);
        (linear_m_s - frame_m_s).length() <= most_m_s && angular_rad_s.length() <= most_rad_s
    }
}

/// What a pile asks of an engine.
pub(crate) trait PileEngine: Bodies {
    /// Adds the next of the objects.
    fn add(&mut self, pose: &Pose, velocity_m_s: Vec3);

    /// Puts walls around the workspace, a cube of this size.
    fn add_walls(&mut self, size_m: f32);

    /// Takes them away, and wakes what leaned on them.
    fn remove_walls(&mut self);

    /// Lets all objects sleep until something touches them: they rest.
    fn fall_asleep(&mut self);
}

/// What an attempt asks of an engine.
pub(crate) trait AttemptEngine: Bodies {
    /// How far each finger has closed, in metres.
    fn closed_m(&self) -> [f32; 2];

    /// Presses with the finger force and keeps the fingers' asymmetry at contact (call before every step of the lift).
    fn press(&mut self, asymmetry_at_contact_m: f32);

    /// Tells the gripper where to be at the end of the next step.
    fn move_to(&mut self, position_m: Vec3);

    /// Where the parts of the gripper that was open at the origin are: left and right jaw, palm.
    fn gripper_poses(&self) -> [Pose; 3];

    /// Whether nothing has touched an object yet.
    fn is_asleep(&self, object_id: usize) -> bool;

    /// Whether both fingers pressed on an object in the last step.
    fn is_gripped(&self, object_id: usize) -> bool;

    /// Whether anything but the gripper pressed on an object in the last step.
    fn is_touched_by_others(&self, object_id: usize) -> bool;
}

/// Objects in rapier, and what is there beside them.
pub(crate) struct InRapier<T> {
    pub(crate) world: PhysicsWorld,
    pub(crate) bodies: Vec<RigidBodyHandle>,
    pub(crate) beside: T,
}

impl<T> Bodies for InRapier<T> {
    fn step(&mut self) {
        self.world.step();
    }

    fn pose(&self, object_id: usize) -> Pose {
        pose_of(&self.world, self.bodies[object_id])
    }

    fn velocities(&self, object_id: usize) -> [Vec3; 2] {
        let body = &self.world.bodies[self.bodies[object_id]];
        [body.linvel() / UNITS_PER_M, body.angvel()]
    }
}

/// Objects and fixtures as rapier wants them.
pub(crate) struct RapierThings {
    pub(crate) bodies: Vec<(EngineBody, Pose)>,
    pub(crate) fixtures: Vec<Polyhedron>,
}

/// A pile in rapier.
pub(crate) type RapierPile<'a> = InRapier<PileSetup<'a>>;

/// Of a pile: the objects that it is to have, and what keeps them together.
pub(crate) struct PileSetup<'a> {
    friction: f32,
    params: &'a SettleParams,
    table_z_m: f32,
    things: &'a RapierThings,
    walls: Vec<ColliderHandle>,
}

/// Thickness and height of the walls, in metres: high enough for objects dropped from 0.2 m.
const WALL_THICKNESS_M: f32 = 0.1;
const WALL_HEIGHT_M: f32 = 0.4;

impl<'a> RapierPile<'a> {
    /// A table at `table_z_m` with the fixtures for the objects of `things`, of which none is there yet.
    pub(crate) fn new(physics: &Physics, params: &'a SettleParams, things: &'a RapierThings, table_z_m: f32) -> Self {
        let gravity_m_s2 = -Vec3::Z * physics.gravity_m_s2;
        let world = world_with_table(physics, gravity_m_s2, &Pose::IDENTITY, table_z_m, &things.fixtures);
        let beside = PileSetup { friction: physics.table_friction, params, table_z_m, things, walls: Vec::new() };
        Self { world, bodies: Vec::new(), beside }
    }
}

impl PileEngine for RapierPile<'_> {
    fn add(&mut self, pose: &Pose, velocity_m_s: Vec3) {
        let PileSetup { params, things, .. } = self.beside;
        let handle = add_object(&mut self.world, &things.bodies[self.bodies.len()].0, *pose, true);
        let body = &mut self.world.bodies[handle];
        body.set_linear_damping(params.damping_1_s);
        body.set_angular_damping(params.damping_1_s);
        body.set_linvel(velocity_m_s * UNITS_PER_M, true);
        let activation = body.activation_mut();
        activation.normalized_linear_threshold = params.linear_speed_m_s_max / LENGTH_UNIT_M;
        activation.angular_threshold = params.angular_speed_rad_s_max;
        activation.time_until_sleep = params.rest_time_s;
        self.bodies.push(handle);
    }

    fn add_walls(&mut self, size_m: f32) {
        let middle = 0.5 * size_m;
        let out = middle + 0.5 * WALL_THICKNESS_M;
        let centre_z = self.beside.table_z_m + 0.5 * WALL_HEIGHT_M;
        let long = middle + WALL_THICKNESS_M;
        for (x, y) in [(out, 0.0), (-out, 0.0), (0.0, out), (0.0, -out)] {
            let half = if y == 0.0 { [0.5 * WALL_THICKNESS_M, long] } else { [long, 0.5 * WALL_THICKNESS_M] };
            let pose = Pose::from_translation(Vec3::new(middle + x, middle + y, centre_z));
            let half_m = Vec3::new(half[0], half[1], 0.5 * WALL_HEIGHT_M);
            self.beside.walls.push(add_fixed_box(&mut self.world, pose, half_m, self.beside.friction));
        }
    }

    fn remove_walls(&mut self) {
        for wall in self.beside.walls.drain(..) {
            self.world.remove_collider(wall);
        }
    }

    /// rapier lets them sleep itself, one island after another.
    fn fall_asleep(&mut self) {}
}
