//! Objects on a table, as an engine has them: what attempts and piles ask of physics. The frame of an attempt is that
//! of the grasp, the frame of a pile that of the workspace.
//!
//! [`Stepper`](crate::stepper::Stepper) is ours and made for this; [`RapierAttempt`] is the reference.

use rapier3d::prelude::{ColliderHandle, PhysicsPipeline, RigidBodyHandle};
use schema::{Gripper, Physics, Polyhedron, Pose, SettleParams, Vec3};

use crate::contact::{Contact, ContactBody};
use crate::engine::{EngineBody, World};
use crate::hand::Hand;

/// Objects that move. They are known by their indices.
pub(crate) trait Bodies {
    /// Advances by one step.
    fn step(&mut self);

    /// Where an object is.
    fn pose(&self, object_id: usize) -> Pose;

    /// Velocity of an object's centre of mass in m/s, and its angular velocity in rad/s.
    fn velocities(&self, object_id: usize) -> [Vec3; 2];
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

    /// Tells the hand where to be at the end of the next step.
    fn move_to(&mut self, position_m: Vec3);

    /// By how much the boxes of the open hand have moved since the beginning: left and right finger, palm.
    fn hand_moved_m(&self) -> [Vec3; 3];

    /// Whether nothing has touched an object yet.
    fn is_asleep(&self, object_id: usize) -> bool;

    /// Whether both fingers pressed on an object in the last step.
    fn is_gripped(&self, object_id: usize) -> bool;

    /// Whether anything but the hand pressed on an object in the last step.
    fn is_touched_by_others(&self, object_id: usize) -> bool;

    /// What pressed on each other in the last step, in this frame.
    fn contacts(&self) -> Vec<Contact>;
}

/// Objects in rapier, and what is there beside them.
pub(crate) struct InRapier<T> {
    world: World,
    pipeline: PhysicsPipeline,
    bodies: Vec<RigidBodyHandle>,
    fixtures: Vec<ColliderHandle>,
    beside: T,
}

impl<T> Bodies for InRapier<T> {
    fn step(&mut self) {
        self.world.step(&mut self.pipeline);
    }

    fn pose(&self, object_id: usize) -> Pose {
        self.world.pose(self.bodies[object_id])
    }

    fn velocities(&self, object_id: usize) -> [Vec3; 2] {
        self.world.velocities(self.bodies[object_id])
    }
}

/// Objects and fixtures as rapier wants them.
pub(crate) struct RapierThings {
    pub(crate) bodies: Vec<(EngineBody, Pose)>,
    pub(crate) fixtures: Vec<Polyhedron>,
}

/// The hand and its objects in rapier.
pub(crate) type RapierAttempt = InRapier<Hand>;

impl RapierAttempt {
    /// The `things` at rest on a table at `table_z_m`, and a hand at `workspace_from_grasp` whose
    /// fingers have closed by `closed_m` each. Objects are asleep until touched, unless `all_awake`.
    pub(crate) fn new(
        physics: &Physics,
        gripper: &Gripper,
        things: &RapierThings,
        table_z_m: f32,
        workspace_from_grasp: &Pose,
        closed_m: f32,
        all_awake: bool,
    ) -> Self {
        let grasp_from_workspace = workspace_from_grasp.inverse();
        let gravity_m_s2 = grasp_from_workspace.rotation * -Vec3::Z * physics.gravity_m_s2;
        let mut world = World::new(physics, gravity_m_s2);
        world.add_table(&grasp_from_workspace, table_z_m, physics.table_friction);
        let add_fixture = |part| world.add_fixture(&grasp_from_workspace, part, physics.table_friction);
        let fixtures = things.fixtures.iter().map(add_fixture).collect();
        let add = |(engine_body, workspace_from_object): &(EngineBody, Pose)| {
            let pose = grasp_from_workspace * *workspace_from_object;
            world.add_object(engine_body, pose, all_awake)
        };
        let bodies = things.bodies.iter().map(add).collect();
        let hand = Hand::insert(&mut world, gripper, closed_m);
        Self { world, pipeline: PhysicsPipeline::new(), bodies, fixtures, beside: hand }
    }

    fn collider(&self, object_id: usize) -> ColliderHandle {
        self.world.bodies[self.bodies[object_id]].colliders()[0]
    }

    fn body(&self, collider: ColliderHandle) -> ContactBody {
        let [left, right, palm] = self.beside.colliders();
        if let Some(id) = (0..self.bodies.len()).find(|id| self.collider(*id) == collider) {
            return ContactBody::Object(id);
        }
        match collider {
            _ if collider == left => ContactBody::LeftFinger,
            _ if collider == right => ContactBody::RightFinger,
            _ if collider == palm => ContactBody::Palm,
            _ if self.fixtures.contains(&collider) => ContactBody::Container,
            _ => ContactBody::Table,
        }
    }
}

impl AttemptEngine for RapierAttempt {
    fn closed_m(&self) -> [f32; 2] {
        self.beside.closed_m(&self.world)
    }

    fn press(&mut self, asymmetry_at_contact_m: f32) {
        self.beside.press(&mut self.world, asymmetry_at_contact_m);
    }

    fn move_to(&mut self, position_m: Vec3) {
        self.beside.move_to(&mut self.world, position_m);
    }

    fn hand_moved_m(&self) -> [Vec3; 3] {
        self.beside.moved_m(&self.world)
    }

    fn is_asleep(&self, object_id: usize) -> bool {
        self.world.is_asleep(self.bodies[object_id])
    }

    fn is_gripped(&self, object_id: usize) -> bool {
        self.beside.grips(&self.world, self.collider(object_id))
    }

    fn is_touched_by_others(&self, object_id: usize) -> bool {
        self.world.is_touched_except_by(self.collider(object_id), &self.beside.colliders())
    }

    fn contacts(&self) -> Vec<Contact> {
        self.world.contacts(|collider| self.body(collider))
    }
}

/// A pile in rapier.
pub(crate) type RapierPile<'a> = InRapier<PileSetup<'a>>;

/// Of a pile: the objects that it is to have, and what keeps them together.
pub(crate) struct PileSetup<'a> {
    physics: Physics,
    params: &'a SettleParams,
    table_z_m: f32,
    objects: Vec<EngineBody>,
    walls: Vec<ColliderHandle>,
}

/// Thickness and height of the walls, in metres: high enough for objects dropped from 0.2 m.
const WALL_THICKNESS_M: f32 = 0.1;
const WALL_HEIGHT_M: f32 = 0.4;

impl<'a> RapierPile<'a> {
    /// A table at `table_z_m` with `fixtures` for the `objects`, of which none is there yet.
    pub(crate) fn new(
        physics: &Physics,
        params: &'a SettleParams,
        objects: Vec<EngineBody>,
        fixtures: &[Polyhedron],
        table_z_m: f32,
    ) -> Self {
        let mut world = World::new(physics, -Vec3::Z * physics.gravity_m_s2);
        world.add_table(&Pose::IDENTITY, table_z_m, physics.table_friction);
        let add_fixture = |part| world.add_fixture(&Pose::IDENTITY, part, physics.table_friction);
        let fixtures = fixtures.iter().map(add_fixture).collect();
        let beside = PileSetup { physics: *physics, params, table_z_m, objects, walls: Vec::new() };
        Self { world, pipeline: PhysicsPipeline::new(), bodies: Vec::new(), fixtures, beside }
    }
}

impl PileEngine for RapierPile<'_> {
    fn add(&mut self, pose: &Pose, velocity_m_s: Vec3) {
        let body = self.world.add_object(&self.beside.objects[self.bodies.len()], *pose, true);
        self.world.let_settle(body, self.beside.params, velocity_m_s);
        self.bodies.push(body);
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
            self.beside.walls.push(self.world.add_fixed_box(pose, half_m, self.beside.physics.table_friction));
        }
    }

    fn remove_walls(&mut self) {
        for wall in self.beside.walls.drain(..) {
            self.world.remove_fixed(wall);
        }
    }

    /// rapier lets them sleep itself, one island after another.
    fn fall_asleep(&mut self) {}
}
