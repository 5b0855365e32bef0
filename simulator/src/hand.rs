//! The hand in the world: a kinematic palm and two fingers on motorised prismatic joints.
//!
//! The palm goes where it is told, like a robot's flange; the fingers feel forces. While closing, each is driven at
//! constant speed with at most its finger force. Once they have stopped, the drive presses with exactly that force and
//! ties the fingers to each other as a gear would, so that the pair does not drift sideways under the object's weight:
//!
//! force on a finger = F − k·(asymmetry − asymmetry at contact)/2 − d·speed
//!
//! where asymmetry is how much further this finger has closed than the other.

use rapier3d::prelude::*;
use schema::{Gripper, HandBox, Pose, Vec3};

use crate::engine::World;

/// Stiffness and damping of the gear between the fingers. Stiff enough that 3 N of weight shifts a grip by less than a
/// millimetre; soft and damped enough that an explicit integrator at 240 Hz can do the same.
const GEAR_STIFFNESS_N_M: f32 = 2_000.0;
const GEAR_DAMPING_N_S_M: f32 = 20.0;
/// Gain of the closing drive: large, so that only the force limit keeps a finger from its speed.
const DRIVE_GAIN: f32 = 1e5;

/// A hand in a world.
pub(crate) struct Hand {
    palm: RigidBodyHandle,
    fingers: [Finger; 2],
    opening_m_max: f32,
    force_n: f32,
}

struct Finger {
    body: RigidBodyHandle,
    collider: ColliderHandle,
    joint: ImpulseJointHandle,
    /// Direction of closing along the grasp's y.
    inward: f32,
    open_y_m: f32,
}

impl Hand {
    /// Puts the open hand at a grasp.
    pub(crate) fn insert(world: &mut World, gripper: &Gripper, workspace_from_grasp: Pose) -> Self {
        let palm = world.bodies.insert(RigidBodyBuilder::kinematic_position_based().pose(workspace_from_grasp));
        let boxed = |b: HandBox| ColliderBuilder::cuboid(b.half_m.x, b.half_m.y, b.half_m.z);
        let palm_box = gripper.palm();
        world.add_part(palm, boxed(palm_box).translation(palm_box.centre_m), gripper.friction);
        let [left, right] = gripper.fingers(gripper.opening_m_max);
        let fingers = [(left, 1.0), (right, -1.0)].map(|(finger, inward)| {
            let pose = workspace_from_grasp * Pose::from_parts(finger.centre_m, schema::Quat::IDENTITY);
            let body = world.bodies.insert(RigidBodyBuilder::dynamic().pose(pose).gravity_scale(0.0).can_sleep(false));
            let collider = world.add_part(body, boxed(finger).mass(gripper.finger_mass_kg), gripper.friction);
            let joint = PrismaticJointBuilder::new(Vec3::Y * inward)
                .local_anchor1(finger.centre_m)
                .limits([0.0, 0.5 * gripper.opening_m_max])
                .motor_max_force(gripper.finger_force_n)
                .motor_velocity(gripper.closing_speed_m_s, DRIVE_GAIN)
                .contacts_enabled(false);
            let joint = world.joints.insert(palm, body, joint, true);
            Finger { body, collider, joint, inward, open_y_m: finger.centre_m.y }
        });
        Self { palm, fingers, opening_m_max: gripper.opening_m_max, force_n: gripper.finger_force_n }
    }

    /// How far each finger has closed, in metres.
    pub(crate) fn closed_m(&self, world: &World) -> [f32; 2] {
        let grasp_from_workspace = world.pose(self.palm).inverse();
        self.fingers.each_ref().map(|finger| {
            let y = grasp_from_workspace.transform_point(world.pose(finger.body).translation).y;
            (y - finger.open_y_m) * finger.inward
        })
    }

    /// Opening between the inner faces, in metres.
    pub(crate) fn width_m(&self, world: &World) -> f32 {
        let [left, right] = self.closed_m(world);
        (self.opening_m_max - left - right).max(0.0)
    }

    /// Presses with the finger force and keeps the fingers' present asymmetry (call before every step of the lift).
    pub(crate) fn press(&self, world: &mut World, asymmetry_at_contact_m: f32) {
        let [left, right] = self.closed_m(world);
        let middle = 0.5 * (left + right);
        let preload = self.force_n / GEAR_STIFFNESS_N_M;
        for (finger, side) in self.fingers.iter().zip([0.5, -0.5]) {
            let target = middle + side * asymmetry_at_contact_m + preload;
            let joint = world.joints.get_mut(finger.joint, true).expect("the hand's joints stay in its world");
            joint
                .data
                .set_motor_model(JointAxis::LinX, MotorModel::ForceBased)
                .set_motor(JointAxis::LinX, target, 0.0, GEAR_STIFFNESS_N_M, GEAR_DAMPING_N_S_M)
                .set_motor_max_force(JointAxis::LinX, 3.0 * self.force_n);
        }
    }

    /// Tells the palm where to be at the end of the next step.
    pub(crate) fn move_to(&self, world: &mut World, workspace_from_grasp: Pose) {
        world.bodies[self.palm].set_next_kinematic_position(workspace_from_grasp);
    }

    /// Whether both fingers press on a collider.
    pub(crate) fn grips(&self, world: &World, collider: ColliderHandle) -> bool {
        self.fingers.iter().all(|finger| world.contact_force_n(finger.collider, collider) > 0.0)
    }
}
