//! rapier, set up so that friction holds: the settings, and a world that can be cloned and stepped.
//!
//! With rapier's own defaults a gripped object creeps out of the jaws: soft contacts (30 Hz) let it sink and slide,
//! friction is left out of the bias pass, and recycled contacts are stale. What holds was found by agreement with
//! PyBullet over gripped objects: see [`Physics::FAITHFUL`].

use rapier3d::prelude::*;
use schema::{Pose, Solid};

use crate::SettleLaw;
use crate::faceted::shape_of;

/// How the engine is run. Stored with every dataset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Physics {
    /// Steps a second.
    pub step_rate_hz: f32,
    /// Solver iterations a step.
    pub solver_iterations: usize,
    /// Natural frequency of the contact springs, in Hz, for dynamic and static contacts alike.
    pub contact_frequency_hz: f32,
    /// Gravity, downwards, in m/s².
    pub gravity_m_s2: f32,
    /// Friction coefficient of table and walls.
    pub table_friction: f32,
    /// Whether an attempt leaves out what decides nothing: see [`crate::AttemptWorld::execute`].
    pub shortcuts: bool,
}

impl Physics {
    /// The settings of the shipped configs: labels as those of [`Self::FAITHFUL`], as far as other engines can tell, at
    /// a fraction of the time.
    pub const STANDARD: Self = Self { solver_iterations: 4, shortcuts: true, ..Self::FAITHFUL };

    /// The settings whose labels another engine confirms; every attempt is simulated from its beginning to its end.
    pub const FAITHFUL: Self = Self {
        step_rate_hz: 240.0,
        solver_iterations: 8,
        contact_frequency_hz: 480.0,
        gravity_m_s2: 9.81,
        table_friction: 1.0,
        shortcuts: false,
    };

    /// Length of a step, in seconds.
    #[must_use]
    pub fn dt_s(&self) -> f32 {
        1.0 / self.step_rate_hz
    }

    /// Steps that last at least `time_s`.
    #[must_use]
    pub fn steps(&self, time_s: f32) -> usize {
        (time_s * self.step_rate_hz).ceil() as usize
    }

    fn integration(&self) -> IntegrationParameters {
        let softness = |of: SpringCoefficients<Real>| SpringCoefficients {
            natural_frequency: self.contact_frequency_hz,
            damping_ratio: of.damping_ratio,
        };
        IntegrationParameters {
            dt: self.dt_s(),
            num_solver_iterations: self.solver_iterations,
            contact_softness: softness(SpringCoefficients::contact_defaults()),
            static_contact_softness: softness(SpringCoefficients::contact_static_defaults()),
            contact_recycling: false,
            friction_in_bias_pass: true,
            friction_model: FrictionModel::Coulomb,
            length_unit: LENGTH_UNIT_M * UNITS_PER_M,
            ..IntegrationParameters::default()
        }
    }
}

/// The engine's unit of length: inside, a metre is 64 units (a power of two, so that conversion rounds nothing). In
/// metres parry takes the edges of small faces for parallel, whatever their angle: its clipping compares products of
/// squared lengths with a fixed 1e-7, below which all edges under 2 cm fall. A finger's edge across a facet then got one
/// contact point instead of two, and what it held swung about that point.
pub(crate) const UNITS_PER_M: f32 = 64.0;

/// rapier's idea of a typical size. It scales the slop (0.5 %) and the reach of speculative contacts (2 %): 0.5 mm and
/// 2 mm here, for objects of a few centimetres.
const LENGTH_UNIT_M: f32 = 0.1;

/// The table is a thick box, not a half-space: against a half-space parry never asks a shape which corners lie next to the
/// contact (see `faceted`), and an upright cylinder topples.
const TABLE_HALF_M: schema::Vec3 = schema::Vec3::new(1.5, 1.5, 0.5);

/// An object as the engine knows it, ready to be put into worlds.
pub(crate) struct Thing {
    shape: SharedShape,
    mass_properties: MassProperties,
    friction: f32,
}

impl Thing {
    pub(crate) fn new(solid: &Solid, mass_kg: f32, friction: f32) -> Self {
        let shape = shape_of(solid, UNITS_PER_M);
        let mut mass_properties = shape.mass_properties(1.0);
        mass_properties.set_mass(mass_kg, true);
        Self { shape, mass_properties, friction }
    }
}

/// All of rapier's state.
pub(crate) struct World {
    gravity: Vector,
    parameters: IntegrationParameters,
    islands: IslandManager,
    broad_phase: DefaultBroadPhase,
    narrow_phase: NarrowPhase,
    pub(crate) bodies: RigidBodySet,
    pub(crate) colliders: ColliderSet,
    pub(crate) joints: ImpulseJointSet,
    multibody_joints: MultibodyJointSet,
    soft_bodies: SoftBodySet,
    ccd: CCDSolver,
}

impl World {
    /// An empty world.
    pub(crate) fn new(physics: &Physics, gravity_m_s2: Vector) -> Self {
        Self {
            gravity: gravity_m_s2 * UNITS_PER_M,
            parameters: physics.integration(),
            islands: IslandManager::new(),
            broad_phase: DefaultBroadPhase::new(),
            narrow_phase: NarrowPhase::new(),
            bodies: RigidBodySet::new(),
            colliders: ColliderSet::new(),
            joints: ImpulseJointSet::new(),
            multibody_joints: MultibodyJointSet::new(),
            soft_bodies: SoftBodySet::new(),
            ccd: CCDSolver::new(),
        }
    }

    /// Adds a table whose top is at `table_z_m` in the workspace.
    pub(crate) fn add_table(&mut self, world_from_workspace: &Pose, table_z_m: f32, friction: f32) {
        let centre = Pose::from_parts(Vector::new(0.0, 0.0, table_z_m - TABLE_HALF_M.z), Rotation::IDENTITY);
        self.add_fixed_box(*world_from_workspace * centre, TABLE_HALF_M, friction);
    }

    /// Adds a box that never moves.
    pub(crate) fn add_fixed_box(&mut self, pose: Pose, half_m: Vector, friction: f32) -> ColliderHandle {
        let half = half_m * UNITS_PER_M;
        let collider = ColliderBuilder::cuboid(half.x, half.y, half.z).position(in_units(pose));
        self.colliders.insert(surface(collider, friction))
    }

    /// Adds a free object.
    pub(crate) fn add_object(&mut self, thing: &Thing, world_from_object: Pose) -> RigidBodyHandle {
        let body = RigidBodyBuilder::dynamic().pose(in_units(world_from_object)).can_sleep(false);
        self.add_body(thing, body.build())
    }

    /// Lets a body lose speed, and fall asleep when it rests, by the law of settling.
    pub(crate) fn let_settle(&mut self, body: RigidBodyHandle, law: &SettleLaw, velocity_m_s: Vector) {
        let body = &mut self.bodies[body];
        body.set_linear_damping(law.damping_1_s);
        body.set_angular_damping(law.damping_1_s);
        body.set_linvel(velocity_m_s * UNITS_PER_M, true);
        let activation = body.activation_mut();
        activation.normalized_linear_threshold = law.linear_speed_m_s_max / LENGTH_UNIT_M;
        activation.angular_threshold = law.angular_speed_rad_s_max;
        activation.time_until_sleep = law.rest_time_s;
    }

    /// Adds a free object that stands still until something touches it.
    pub(crate) fn add_resting_object(&mut self, thing: &Thing, world_from_object: Pose) -> RigidBodyHandle {
        let mut body = RigidBodyBuilder::dynamic().pose(in_units(world_from_object)).build();
        // Once awake, it stays awake.
        body.activation_mut().time_until_sleep = f32::MAX;
        body.sleep();
        self.add_body(thing, body)
    }

    fn add_body(&mut self, thing: &Thing, body: RigidBody) -> RigidBodyHandle {
        let body = self.bodies.insert(body);
        let collider = ColliderBuilder::new(thing.shape.clone()).mass_properties(thing.mass_properties);
        self.add_part(body, collider, thing.friction);
        body
    }

    /// Attaches a collider to a body.
    pub(crate) fn add_part(
        &mut self,
        body: RigidBodyHandle,
        collider: ColliderBuilder,
        friction: f32,
    ) -> ColliderHandle {
        self.colliders.insert_with_parent(surface(collider, friction), body, &mut self.bodies)
    }

    /// Takes a fixed collider out again.
    pub(crate) fn remove_fixed(&mut self, handle: ColliderHandle) {
        self.colliders.remove(handle, &mut self.islands, &mut self.bodies, &mut self.soft_bodies, true);
    }

    /// Advances the world by one step.
    pub(crate) fn step(&mut self, pipeline: &mut PhysicsPipeline) {
        pipeline.step(
            self.gravity,
            &self.parameters,
            &mut self.islands,
            &mut self.broad_phase,
            &mut self.narrow_phase,
            &mut self.bodies,
            &mut self.colliders,
            &mut self.joints,
            &mut self.multibody_joints,
            &mut self.soft_bodies,
            &mut self.ccd,
            &(),
            &(),
        );
    }

    /// Steps a second.
    pub(crate) fn step_rate_hz(&self) -> f32 {
        1.0 / self.parameters.dt
    }

    /// Where a body's frame is.
    pub(crate) fn pose(&self, body: RigidBodyHandle) -> Pose {
        let pose = self.bodies[body].position();
        Pose::from_parts(pose.translation / UNITS_PER_M, pose.rotation)
    }

    /// Velocity of a body's centre of mass in m/s, and its angular velocity in rad/s.
    pub(crate) fn velocities(&self, body: RigidBodyHandle) -> [Vector; 2] {
        let body = &self.bodies[body];
        [body.linvel() / UNITS_PER_M, body.angvel()]
    }

    /// Whether a body has not been touched yet.
    pub(crate) fn is_asleep(&self, body: RigidBodyHandle) -> bool {
        self.bodies[body].is_sleeping()
    }

    /// Whether anything but `others` pressed on a collider in the last step.
    pub(crate) fn is_touched_except_by(&self, collider: ColliderHandle, others: &[ColliderHandle]) -> bool {
        self.narrow_phase.contact_pairs_with(collider).any(|pair| {
            let other = if pair.collider1 == collider { pair.collider2 } else { pair.collider1 };
            !others.contains(&other) && pair.total_impulse_magnitude() > 0.0
        })
    }

    /// Force with which two colliders press on each other in the last step, in newtons.
    pub(crate) fn contact_force_n(&self, a: ColliderHandle, b: ColliderHandle) -> f32 {
        self.narrow_phase
            .contact_pair(a, b)
            .map_or(0.0, |pair| pair.total_impulse_magnitude() / (self.parameters.dt * UNITS_PER_M))
    }
}

fn in_units(pose: Pose) -> Pose {
    Pose::from_parts(pose.translation * UNITS_PER_M, pose.rotation)
}

fn surface(collider: ColliderBuilder, friction: f32) -> ColliderBuilder {
    collider.friction(friction).friction_combine_rule(CoefficientCombineRule::Multiply).restitution(0.0)
}
