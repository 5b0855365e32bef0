//! The hand in the world: a kinematic palm and two fingers that slide along the grasp's y.
//!
//! The palm goes where it is told, like a robot's flange. A finger is rigid but for its one direction of closing: along
//! the others it has no inverse mass and moves with the palm. (On a prismatic joint it has to be held sideways by the
//! joint's rows, and a solver that goes row by row does that badly when a light finger carries a heavy object: objects
//! crept out of the jaws.) While closing, each finger is driven at constant speed with at most its finger force. Once
//! both have stopped, the drive presses with exactly that force and ties the fingers to each other as a gear would, so
//! that the pair does not drift sideways under the object's weight:
//!
//! force on a finger = F − k·(asymmetry − asymmetry at contact)/2 − d·speed
//!
//! where asymmetry is how much further this finger has closed than the other.

use rapier3d::prelude::*;
use schema::{Gripper, HandBox, Vec3};

use crate::engine::{UNITS_PER_M, pose_of, surface};

/// Stiffness and damping of the gear between the fingers. Stiff enough that 3 N of weight shifts a grip by less than a
/// millimetre; soft and damped enough that an explicit integrator at 240 Hz can do the same.
pub(crate) const GEAR_STIFFNESS_N_M: f32 = 2_000.0;
pub(crate) const GEAR_DAMPING_N_S_M: f32 = 20.0;
/// Gain of the closing drive: large, so that only the force limit keeps a finger from its speed.
const DRIVE_GAIN: f32 = 1e5;

/// A hand in a world.
pub(crate) struct Hand {
    palm: RigidBodyHandle,
    palm_collider: ColliderHandle,
    fingers: [Finger; 2],
    force_n: f32,
}

struct Finger {
    body: RigidBodyHandle,
    collider: ColliderHandle,
    joint: ImpulseJointHandle,
    /// Direction of closing along the grasp's y.
    inward: f32,
    open_m: Vec3,
}

impl Hand {
    /// Puts the hand at the world's origin, its fingers closed by `closed_m` each, and closing if that is above 0.
    pub(crate) fn insert(world: &mut PhysicsWorld, gripper: &Gripper, closed_m: f32) -> Self {
        let palm = world.bodies.insert(RigidBodyBuilder::kinematic_position_based());
        let boxed = |b: HandBox| {
            let half = b.half_m * UNITS_PER_M;
            ColliderBuilder::cuboid(half.x, half.y, half.z)
        };
        let palm_box = gripper.palm();
        let palm_collider = boxed(palm_box).translation(palm_box.centre_m * UNITS_PER_M);
        let palm_collider = world.insert_collider(surface(palm_collider, gripper.friction), Some(palm));
        let [left, right] = gripper.fingers(gripper.opening_m_max);
        let fingers = [(left, 1.0), (right, -1.0)].map(|(finger, inward)| {
            let speed_m_s = if closed_m > 0.0 { gripper.closing_speed_m_s } else { 0.0 };
            let axis = Vec3::Y * inward;
            let body = RigidBodyBuilder::dynamic()
                .translation((finger.centre_m + axis * closed_m) * UNITS_PER_M)
                .linvel(axis * speed_m_s * UNITS_PER_M)
                .gravity_scale(0.0)
                .locked_axes(LockedAxes::all() - LockedAxes::TRANSLATION_LOCKED_Y)
                .can_sleep(false);
            let collider = surface(boxed(finger).mass(gripper.finger_mass_kg), gripper.friction);
            let (body, collider) = world.insert(body, collider);
            let joint = GenericJointBuilder::new(JointAxesMask::empty())
                .local_axis1(axis)
                .local_axis2(axis)
                .local_anchor1(finger.centre_m * UNITS_PER_M)
                .limits(JointAxis::LinX, [0.0, 0.5 * gripper.opening_m_max * UNITS_PER_M])
                .motor_max_force(JointAxis::LinX, gripper.finger_force_n * UNITS_PER_M)
                .motor_velocity(JointAxis::LinX, gripper.closing_speed_m_s * UNITS_PER_M, DRIVE_GAIN)
                .contacts_enabled(false);
            let joint = world.insert_impulse_joint(palm, body, joint);
            Finger { body, collider, joint, inward, open_m: finger.centre_m }
        });
        Self { palm, palm_collider, fingers, force_n: gripper.finger_force_n }
    }

    /// How far each finger has closed, in metres.
    pub(crate) fn closed_m(&self, world: &PhysicsWorld) -> [f32; 2] {
        let palm_y_m = pose_of(world, self.palm).translation.y;
        self.fingers.each_ref().map(|f| (pose_of(world, f.body).translation.y - palm_y_m - f.open_m.y) * f.inward)
    }

    /// Presses with the finger force and keeps the fingers' present asymmetry (call before every step of the lift).
    pub(crate) fn press(&self, world: &mut PhysicsWorld, asymmetry_at_contact_m: f32) {
        let [left, right] = self.closed_m(world);
        let middle = 0.5 * (left + right);
        let preload = self.force_n / GEAR_STIFFNESS_N_M;
        for (finger, side) in self.fingers.iter().zip([0.5, -0.5]) {
            let target = middle + side * asymmetry_at_contact_m + preload;
            let joint = world.impulse_joints.get_mut(finger.joint, true).expect("the hand's joints stay in its world");
            joint
                .data
                .set_motor_model(JointAxis::LinX, MotorModel::ForceBased)
                .set_motor(JointAxis::LinX, target * UNITS_PER_M, 0.0, GEAR_STIFFNESS_N_M, GEAR_DAMPING_N_S_M)
                .set_motor_max_force(JointAxis::LinX, 3.0 * self.force_n * UNITS_PER_M);
        }
    }

    /// Tells the hand where to be at the end of the next step. Along their locked axes the fingers go with the palm.
    pub(crate) fn move_to(&self, world: &mut PhysicsWorld, position_m: Vec3) {
        world.bodies[self.palm].set_next_kinematic_translation(position_m * UNITS_PER_M);
        let step_rate_hz = 1.0 / world.integration_parameters.dt;
        for finger in &self.fingers {
            let body = &mut world.bodies[finger.body];
            let sideways = ((position_m + finger.open_m) * UNITS_PER_M - body.translation()) * step_rate_hz;
            body.set_linvel(Vec3::new(sideways.x, body.linvel().y, sideways.z), true);
        }
    }

    /// Whether both fingers press on a collider.
    pub(crate) fn grips(&self, world: &PhysicsWorld, collider: ColliderHandle) -> bool {
        let pair = |finger: &Finger| world.contact_pair(finger.collider, collider);
        self.fingers.iter().all(|finger| pair(finger).is_some_and(|pair| pair.total_impulse_magnitude() > 0.0))
    }

    /// By how much its boxes have moved since it was open and at the origin: left and right finger, palm.
    pub(crate) fn moved_m(&self, world: &PhysicsWorld) -> [Vec3; 3] {
        let moved = |finger: &Finger| pose_of(world, finger.body).translation - finger.open_m;
        [moved(&self.fingers[0]), moved(&self.fingers[1]), pose_of(world, self.palm).translation]
    }

    /// Its colliders.
    pub(crate) fn colliders(&self) -> [ColliderHandle; 3] {
        [self.fingers[0].collider, self.fingers[1].collider, self.palm_collider]
    }
}
