//! rapier, set up so that friction holds: the settings, and a world that can be cloned and stepped.
//!
//! With rapier's own defaults a gripped object creeps out of the jaws: soft contacts (30 Hz) let it sink and slide,
//! friction is left out of the bias pass, and recycled contacts are stale. What holds was found by agreement with
//! PyBullet over gripped objects: see [`Physics::FAITHFUL`].

use rapier3d::prelude::*;
use schema::{Pose, Solid};

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
}

impl Physics {
    /// The settings whose labels another engine confirms.
    pub const FAITHFUL: Self = Self {
        step_rate_hz: 240.0,
        solver_iterations: 8,
        contact_frequency_hz: 480.0,
        gravity_m_s2: 9.81,
        table_friction: 1.0,
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
            length_unit: LENGTH_UNIT_M,
            ..IntegrationParameters::default()
        }
    }
}

/// rapier's idea of a typical size. It scales the slop (0.5 %) and the reach of speculative contacts (2 %): 0.5 mm and
/// 2 mm here, for objects of a few centimetres.
const LENGTH_UNIT_M: f32 = 0.1;

/// The table is a thick box, not a half-space: against a half-space parry never asks a shape which corners lie next to the
/// contact (see `faceted`), and an upright cylinder topples.
const TABLE_HALF_M: schema::Vec3 = schema::Vec3::new(1.5, 1.5, 0.5);

/// All of rapier's state, cloneable: a template world is built once a scene and copied for every attempt.
#[derive(Clone)]
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
    /// An empty world: gravity along −z, nothing in it.
    pub(crate) fn new(physics: &Physics) -> Self {
        Self {
            gravity: Vector::new(0.0, 0.0, -physics.gravity_m_s2),
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

    /// A world with a table whose top is at `table_z_m`.
    pub(crate) fn with_table(physics: &Physics, table_z_m: f32) -> Self {
        let mut world = Self::new(physics);
        let half = TABLE_HALF_M;
        let centre = Vector::new(0.0, 0.0, table_z_m - half.z);
        world.add_fixed(ColliderBuilder::cuboid(half.x, half.y, half.z).translation(centre), physics.table_friction);
        world
    }

    /// Adds something that never moves.
    pub(crate) fn add_fixed(&mut self, collider: ColliderBuilder, friction: f32) -> ColliderHandle {
        self.colliders.insert(surface(collider, friction))
    }

    /// Adds a free object at rest.
    pub(crate) fn add_object(
        &mut self,
        solid: &Solid,
        mass_kg: f32,
        friction: f32,
        workspace_from_object: Pose,
    ) -> RigidBodyHandle {
        let body = self.bodies.insert(RigidBodyBuilder::dynamic().pose(workspace_from_object).can_sleep(false));
        self.add_part(body, ColliderBuilder::new(shape_of(solid)).mass(mass_kg), friction);
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

    /// Where a body's frame is.
    pub(crate) fn pose(&self, body: RigidBodyHandle) -> Pose {
        *self.bodies[body].position()
    }

    /// Force with which two colliders press on each other in the last step, in newtons.
    pub(crate) fn contact_force_n(&self, a: ColliderHandle, b: ColliderHandle) -> f32 {
        self.narrow_phase.contact_pair(a, b).map_or(0.0, |pair| pair.total_impulse_magnitude() / self.parameters.dt)
    }
}

fn surface(collider: ColliderBuilder, friction: f32) -> ColliderBuilder {
    collider.friction(friction).friction_combine_rule(CoefficientCombineRule::Multiply).restitution(0.0)
}
