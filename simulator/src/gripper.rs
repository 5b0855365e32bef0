//! The gripper in the world: a kinematic palm and two fingers that slide along the grasp's y.
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
use schema::{Gripper, GripperBox, Physics, Pose, Vec3};

use crate::bodies::{AttemptEngine, InRapier, RapierThings};
use crate::engine::{EngineBody, UNITS_PER_M, add_object, pose_of, surface, world_with_table};

/// Stiffness and damping of the gear between the fingers. Stiff enough that 3 N of weight shifts a grip by less than a
/// millimetre; soft and damped enough that an explicit integrator at 240 Hz can do the same.
pub(crate) const GEAR_STIFFNESS_N_M: f32 = 2_000.0;
pub(crate) const GEAR_DAMPING_N_S_M: f32 = 20.0;
/// Gain of the closing drive: large, so that only the force limit keeps a finger from its speed.
const DRIVE_GAIN: f32 = 1e5;

/// A gripper in a world.
pub(crate) struct GripperBodies {
    palm: RigidBodyHandle,
    /// Of the left and the right finger, and of the palm.
    colliders: [ColliderHandle; 3],
    fingers: [Finger; 2],
    force_n: f32,
}

struct Finger {
    body: RigidBodyHandle,
    joint: ImpulseJointHandle,
    /// Direction of closing along the grasp's y.
    inward: f32,
    open_m: Vec3,
}

impl GripperBodies {
    /// Puts the gripper at the world's origin, its fingers closed by `closed_m` each, and closing if that is above 0.
    fn insert(world: &mut PhysicsWorld, gripper: &Gripper, closed_m: f32) -> Self {
        let palm = world.bodies.insert(RigidBodyBuilder::kinematic_position_based());
        let boxed = |b: GripperBox| {
            let half = b.half_m * UNITS_PER_M;
            ColliderBuilder::cuboid(half.x, half.y, half.z)
        };
        let palm_box = gripper.palm();
        let palm_collider = boxed(palm_box).translation(palm_box.centre_m * UNITS_PER_M);
        let palm_collider = world.insert_collider(surface(palm_collider, gripper.friction), Some(palm));
        let [left, right] = gripper.fingers(gripper.opening_m_max);
        let [left, right] = [(left, 1.0), (right, -1.0)].map(|(finger, inward)| {
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
            (Finger { body, joint, inward, open_m: finger.centre_m }, collider)
        });
        let colliders = [left.1, right.1, palm_collider];
        Self { palm, colliders, fingers: [left.0, right.0], force_n: gripper.finger_force_n }
    }
}

/// The gripper and its objects in rapier.
pub(crate) type RapierAttempt = InRapier<GripperBodies>;

impl RapierAttempt {
    /// The `things` at rest on a table at `table_z_m`, and a gripper at `workspace_from_grasp` whose
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
        let mut world = world_with_table(physics, gravity_m_s2, &grasp_from_workspace, table_z_m, &things.fixtures);
        let add = |(engine_body, workspace_from_object): &(EngineBody, Pose)| {
            let pose = grasp_from_workspace * *workspace_from_object;
            add_object(&mut world, engine_body, pose, all_awake)
        };
        let bodies = things.bodies.iter().map(add).collect();
        let beside = GripperBodies::insert(&mut world, gripper, closed_m);
        Self { world, bodies, beside }
    }

    fn collider(&self, object_id: usize) -> ColliderHandle {
        self.world.bodies[self.bodies[object_id]].colliders()[0]
    }
}

impl AttemptEngine for RapierAttempt {
    fn closed_m(&self) -> [f32; 2] {
        let y_m = |body: RigidBodyHandle| pose_of(&self.world, body).translation.y;
        let palm_y_m = y_m(self.beside.palm);
        self.beside.fingers.each_ref().map(|f| (y_m(f.body) - palm_y_m - f.open_m.y) * f.inward)
    }

    fn press(&mut self, asymmetry_at_contact_m: f32) {
        let [left, right] = self.closed_m();
        let (middle, force_n) = (0.5 * (left + right), self.beside.force_n);
        let preload = force_n / GEAR_STIFFNESS_N_M;
        for (finger, side) in self.beside.fingers.iter().zip([0.5, -0.5]) {
            let target = middle + side * asymmetry_at_contact_m + preload;
            let joint = self.world.impulse_joints.get_mut(finger.joint, true);
            let joint = joint.expect("the gripper's joints stay in its world");
            joint
                .data
                .set_motor_model(JointAxis::LinX, MotorModel::ForceBased)
                .set_motor(JointAxis::LinX, target * UNITS_PER_M, 0.0, GEAR_STIFFNESS_N_M, GEAR_DAMPING_N_S_M)
                .set_motor_max_force(JointAxis::LinX, 3.0 * force_n * UNITS_PER_M);
        }
    }

    /// Along their locked axes the fingers go with the palm.
    fn move_to(&mut self, position_m: Vec3) {
        self.world.bodies[self.beside.palm].set_next_kinematic_translation(position_m * UNITS_PER_M);
        let step_rate_hz = 1.0 / self.world.integration_parameters.dt;
        for finger in &self.beside.fingers {
            let body = &mut self.world.bodies[finger.body];
            let sideways = ((position_m + finger.open_m) * UNITS_PER_M - body.translation()) * step_rate_hz;
            body.set_linvel(Vec3::new(sideways.x, body.linvel().y, sideways.z), true);
        }
    }

    fn gripper_poses(&self) -> [Pose; 3] {
        let at_m = |body: RigidBodyHandle| pose_of(&self.world, body).translation;
        let [left, right] = self.beside.fingers.each_ref().map(|finger| at_m(finger.body) - finger.open_m);
        [left, right, at_m(self.beside.palm)].map(Pose::from_translation)
    }

    fn is_asleep(&self, object_id: usize) -> bool {
        self.world.bodies[self.bodies[object_id]].is_sleeping()
    }

    fn is_gripped(&self, object_id: usize) -> bool {
        let pair = |finger: &ColliderHandle| self.world.contact_pair(*finger, self.collider(object_id));
        let presses = |finger| pair(finger).is_some_and(|pair| pair.total_impulse_magnitude() > 0.0);
        self.beside.colliders[..2].iter().all(presses)
    }

    fn is_touched_by_others(&self, object_id: usize) -> bool {
        let own = self.beside.colliders;
        let is_of_gripper = |pair: &ContactPair| own.contains(&pair.collider1) || own.contains(&pair.collider2);
        let mut pairs = self.world.contact_pairs_with(self.collider(object_id));
        pairs.any(|pair| !is_of_gripper(pair) && pair.total_impulse_magnitude() > 0.0)
    }
}
