//! One execution of a grasp: the label's contract.
//!
//! 1. The geometric gate ([`Gate`]) plays pre-grasp and approach: a straight way needs no time steps.
//! 2. The open hand is put at the grasp and closes until both fingers stand still, or the jaws meet.
//! 3. It retreats, smoothly, pressing with its finger force, and holds still.
//! 4. The outcome is the first that applies: `pregrasp_collision`, `approach_collision`, `empty`, `slipped`,
//!    `hit_other`, `held`.

use rapier3d::prelude::{ColliderHandle, PhysicsPipeline, RigidBodyHandle};
use schema::{Gripper, Outcome, Pose, Procedure, Vec3};

use crate::engine::{Physics, Thing, World};
use crate::gate::{Gate, Hit, lowest_z_m};
use crate::hand::Hand;
use crate::shortcuts::{FreeClosing, LiftWatch};
use crate::{Scene, SceneObject};

/// Fingers slower than this stand still …
const STOPPED_SPEED_M_S: f32 = 0.002;
/// … if they have for this long.
const STOPPED_TIME_S: f32 = 0.025;

/// How an execution ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Execution {
    /// The outcome.
    pub outcome: Outcome,
    /// What was hit, for outcomes that hit something.
    pub hit: Option<Hit>,
    /// Opening in metres, at the end of the hold or when the fingers stopped; `None` if they never closed.
    pub width_m: Option<f32>,
    /// Steps that were simulated.
    pub steps: usize,
}

/// A scene made ready for attempts: each runs in a fresh copy of it.
pub struct AttemptWorld<'a> {
    pub(crate) physics: &'a Physics,
    pub(crate) gripper: &'a Gripper,
    pub(crate) procedure: &'a Procedure,
    pub(crate) table_z_m: f32,
    pub(crate) gate: Gate,
    things: Vec<(Thing, Pose)>,
}

impl<'a> AttemptWorld<'a> {
    /// Makes a scene ready. The world is built from the scene's poses alone, so that stored rows give the same attempts.
    #[must_use]
    pub fn new(physics: &'a Physics, gripper: &'a Gripper, procedure: &'a Procedure, scene: &Scene) -> Self {
        let thing = |o: &SceneObject| (Thing::new(&o.body, o.mass_kg, o.friction), o.workspace_from_object);
        let things = scene.objects.iter().map(thing).collect();
        let gate = Gate::new(scene, gripper, procedure);
        Self { physics, gripper, procedure, table_z_m: scene.table_z_m, gate, things }
    }

    /// Tries one grasp of object `target`.
    ///
    /// With [`Physics::shortcuts`], what decides nothing is left out: objects stand still until they are touched, the
    /// fingers start where they first come near something, jaws with nothing between them are not simulated, and the lift
    /// ends when the target rides along and nothing lies ahead.
    ///
    /// # Panics
    /// If the scene has no object `target`.
    #[must_use]
    pub fn execute(&self, workspace_from_grasp: &Pose, target: usize) -> Execution {
        if let Some(blocked) = self.blocked(workspace_from_grasp, target) {
            return blocked;
        }
        let mut skipped_steps = 0;
        if self.physics.shortcuts {
            match self.free_closing(workspace_from_grasp) {
                FreeClosing::Empty { width_m } => {
                    return Execution { outcome: Outcome::Empty, hit: None, width_m: Some(width_m), steps: 0 };
                }
                FreeClosing::Steps(steps) => skipped_steps = steps,
            }
        }
        Run::start(self, *workspace_from_grasp, target, skipped_steps, self.physics.shortcuts).finish()
    }

    /// Tries one grasp of object `target` as [`Self::execute`] does without shortcuts, and gives what it leaves behind:
    /// where each object is, in the workspace, at the moment the attempt ends and the hand is taken away. What was still
    /// held or falling then hangs in the air; [`crate::settle_again`] lets it come to rest.
    ///
    /// A hand that the gate stopped has touched nothing: the poses are the scene's, to the bit.
    ///
    /// # Panics
    /// If the scene has no object `target`.
    #[must_use]
    pub fn execute_leaving(&self, workspace_from_grasp: &Pose, target: usize) -> (Execution, Vec<Pose>) {
        if let Some(blocked) = self.blocked(workspace_from_grasp, target) {
            return (blocked, self.things.iter().map(|(_, pose)| *pose).collect());
        }
        let mut run = Run::start(self, *workspace_from_grasp, target, 0, false);
        let execution = run.finish();
        (execution, run.workspace_poses())
    }

    /// The end of an attempt that the gate stops.
    fn blocked(&self, workspace_from_grasp: &Pose, target: usize) -> Option<Execution> {
        let (outcome, hit) = self.gate.blocked(workspace_from_grasp, target)?;
        Some(Execution { outcome, hit: Some(hit), width_m: None, steps: 0 })
    }
}

/// An attempt under way.
pub(crate) struct Run<'a> {
    pub(crate) setup: &'a AttemptWorld<'a>,
    pub(crate) world: World,
    pipeline: PhysicsPipeline,
    pub(crate) hand: Hand,
    pub(crate) bodies: Vec<RigidBodyHandle>,
    /// Steps of closing that were left out.
    skipped_steps: usize,
    /// Whether what decides nothing is left out.
    shortcuts: bool,
    steps: usize,
    /// Up, in the world.
    up: Vec3,
    workspace_from_grasp: Pose,
    pub(crate) target: usize,
    pub(crate) target_collider: ColliderHandle,
}

impl<'a> Run<'a> {
    fn start(
        setup: &'a AttemptWorld<'a>,
        workspace_from_grasp: Pose,
        target: usize,
        skipped_steps: usize,
        shortcuts: bool,
    ) -> Self {
        let grasp_from_workspace = workspace_from_grasp.inverse();
        let down = grasp_from_workspace.rotation * -Vec3::Z;
        let mut world = World::new(setup.physics, down * setup.physics.gravity_m_s2);
        world.add_table(&grasp_from_workspace, setup.table_z_m, setup.physics.table_friction);
        let add = |(thing, workspace_from_object): &(Thing, Pose)| {
            let pose = grasp_from_workspace * *workspace_from_object;
            if shortcuts { world.add_resting_object(thing, pose) } else { world.add_object(thing, pose) }
        };
        let bodies: Vec<RigidBodyHandle> = setup.things.iter().map(add).collect();
        let hand = Hand::insert(&mut world, setup.gripper, skipped_steps as f32 * setup.closing_step_m());
        let target_collider = world.bodies[bodies[target]].colliders()[0];
        let pipeline = PhysicsPipeline::new();
        Self {
            setup,
            world,
            pipeline,
            hand,
            bodies,
            skipped_steps,
            shortcuts,
            steps: 0,
            up: -down,
            workspace_from_grasp,
            target,
            target_collider,
        }
    }

    fn finish(&mut self) -> Execution {
        let before = self.positions();
        let width_m = self.close();
        if width_m <= self.setup.procedure.empty_width_m {
            return self.ended(Outcome::Empty, None, width_m);
        }
        let closed = self.positions();
        let pushed = self.pushed(&before, &closed);
        let held = self.retreat_and_hold(closed[self.target]);
        if !held {
            return self.ended(Outcome::Slipped, None, width_m);
        }
        let width_m = self.hand.width_m(&self.world);
        match pushed.or_else(|| self.raised(&before)) {
            Some(hit) => self.ended(Outcome::HitOther, Some(hit), width_m),
            None => self.ended(Outcome::Held, None, width_m),
        }
    }

    fn ended(&self, outcome: Outcome, hit: Option<Hit>, width_m: f32) -> Execution {
        Execution { outcome, hit, width_m: Some(width_m), steps: self.steps }
    }

    fn step(&mut self) {
        self.world.step(&mut self.pipeline);
        self.steps += 1;
    }

    /// Closes until both fingers stand still; gives the opening.
    fn close(&mut self) -> f32 {
        let physics = self.setup.physics;
        let wanted = physics.steps(STOPPED_TIME_S);
        let slow = STOPPED_SPEED_M_S * physics.dt_s();
        let mut last = self.hand.closed_m(&self.world);
        let mut stopped = 0;
        for _ in self.skipped_steps..physics.steps(self.setup.procedure.close_time_s_max) {
            self.step();
            let now = self.hand.closed_m(&self.world);
            let still = now.iter().zip(&last).all(|(a, b)| (a - b).abs() < slow);
            stopped = if still { stopped + 1 } else { 0 };
            last = now;
            if stopped >= wanted || self.hand.width_m(&self.world) <= self.setup.procedure.empty_width_m {
                break;
            }
        }
        self.hand.width_m(&self.world)
    }

    /// Moves the hand out and holds; whether the target came along and is still gripped.
    fn retreat_and_hold(&mut self, target_start_m: Vec3) -> bool {
        let (physics, procedure) = (self.setup.physics, self.setup.procedure);
        let direction = self.retreat_direction();
        let retreat_steps = physics.steps(procedure.retreat_distance_m / procedure.retreat_speed_m_s);
        let [left, right] = self.hand.closed_m(&self.world);
        let mut watch = LiftWatch::new(physics);
        let mut last_m = 0.0;
        for step in 1..=retreat_steps + physics.steps(procedure.hold_time_s) {
            let share = (step as f32 / retreat_steps as f32).min(1.0);
            // Smoothstep: the hand starts and stops without a jolt.
            let distance = procedure.retreat_distance_m * share * share * (3.0 - 2.0 * share);
            self.hand.press(&mut self.world, left - right);
            self.hand.move_to(&mut self.world, direction * distance);
            self.step();
            if self.hand.width_m(&self.world) <= procedure.empty_width_m {
                return false;
            }
            if self.shortcuts {
                let velocity_m_s = direction * ((distance - last_m) * physics.step_rate_hz);
                let rest_m = direction * (procedure.retreat_distance_m - distance);
                let is_slowing = share > 0.5 && share < 1.0;
                if watch.is_decided(self, velocity_m_s, rest_m, is_slowing) {
                    return true;
                }
            }
            last_m = distance;
        }
        let travel = (self.positions()[self.target] - target_start_m).dot(direction);
        travel >= procedure.held_travel_share_min * procedure.retreat_distance_m
            && self.hand.grips(&self.world, self.target_collider)
    }

    /// What the closing hand drove: another object, or the table, if a finger ended
    /// within half the clearance of it (the gate has kept the open hand a whole clearance away).
    fn pushed(&self, before: &[Vec3], after: &[Vec3]) -> Option<Hit> {
        let limit = self.setup.procedure.other_push_m_max;
        if let Some(id) = self.others().find(|id| (after[*id] - before[*id]).length() > limit) {
            return Some(Hit::object(id, self.target));
        }
        let closed = self.hand.closed_m(&self.world);
        let fingers = self.setup.gripper.fingers(self.setup.gripper.opening_m_max);
        let low = fingers.iter().zip(closed).zip([1.0, -1.0]).any(|((finger, closed_m), inward)| {
            let moved = schema::HandBox { centre_m: finger.centre_m + Vec3::Y * (inward * closed_m), ..*finger };
            lowest_z_m(&moved, &self.workspace_from_grasp) < self.setup.table_z_m + 0.5 * self.setup.gripper.clearance_m
        });
        low.then_some(Hit::TABLE)
    }

    /// Which other object was raised while lifting.
    fn raised(&self, before: &[Vec3]) -> Option<Hit> {
        let now = self.positions();
        let limit = self.setup.procedure.other_lift_m_max;
        self.others().find(|id| (now[*id] - before[*id]).dot(self.up) > limit).map(|id| Hit::object(id, self.target))
    }

    pub(crate) fn others(&self) -> impl Iterator<Item = usize> {
        let target = self.target;
        (0..self.bodies.len()).filter(move |id| *id != target)
    }

    fn positions(&self) -> Vec<Vec3> {
        self.bodies.iter().map(|body| self.world.pose(*body).translation).collect()
    }

    /// Where the objects are now, in the workspace. (The world's frame is that of the hand at the grasp.)
    fn workspace_poses(&self) -> Vec<Pose> {
        let in_workspace = |body: &RigidBodyHandle| {
            let pose = self.workspace_from_grasp * self.world.pose(*body);
            Pose::from_parts(pose.translation, pose.rotation.normalize())
        };
        self.bodies.iter().map(in_workspace).collect()
    }

    /// Where the hand goes with its catch: back along the approach if that is near enough to straight down, else up.
    fn retreat_direction(&self) -> Vec3 {
        let back = -Vec3::Z;
        if back.dot(self.up) >= libm::cosf(self.setup.procedure.retreat_cone_rad) { back } else { self.up }
    }
}

#[cfg(test)]
mod tests {
    use schema::{Quat, ShapeKind, Solid, axis_angle};

    use super::*;

    /// How far a block of `mass_kg` has fallen behind the hand at the end of lift and hold, in metres.
    fn lag_m(mass_kg: f32, hold_time_s: f32) -> f32 {
        let gripper = Gripper::from_toml(include_str!("../../configs/grippers/parallel_jaw_80.toml")).unwrap();
        let procedure = Procedure { hold_time_s, ..Procedure::PAPER };
        let solid = Solid::new(ShapeKind::Cuboid, Vec3::new(0.04, 0.04, 0.06)).unwrap();
        let at = Vec3::new(0.15, 0.15, 0.08);
        let workspace_from_object = Pose::from_parts(at, Quat::IDENTITY);
        let block = SceneObject { body: solid.into(), mass_kg, friction: 1.0, workspace_from_object };
        let scene = Scene { table_z_m: 0.05, objects: vec![block] };
        let setup = AttemptWorld::new(&Physics::FAITHFUL, &gripper, &procedure, &scene);
        let mut run = Run::start(&setup, Pose::from_parts(at, axis_angle(Vec3::X, core::f32::consts::PI)), 0, 0, false);
        run.close();
        let start_m = run.positions()[0];
        run.retreat_and_hold(start_m);
        procedure.retreat_distance_m - (run.positions()[0] - start_m).dot(run.up)
    }

    /// Two fingers of 20 N with friction 1 accelerate 3.6 kg by at most c = 40 N / 3.6 kg − g, and the lift asks for
    /// A = 6 d / T² at first: the block slides d·(1 − c/A)³ until it is as fast as the hand, then rests in the jaws.
    #[test]
    fn a_heavy_block_slides_as_far_as_coulomb_says_and_does_not_creep() {
        let wanted = 6.0 * 0.1 / (0.5 * 0.5);
        let expected_m = 0.1 * (1.0_f32 - (40.0 / 3.6 - 9.81) / wanted).powi(3);
        let (lifted_m, held_m) = (lag_m(3.6, 0.0), lag_m(3.6, 1.0));
        assert!((lifted_m - expected_m).abs() < 0.003, "{lifted_m} m, by the closed form {expected_m} m");
        assert!((held_m - lifted_m).abs() < 5e-5, "crept {} m in a second", held_m - lifted_m);
        assert!(lag_m(0.5, 1.0).abs() < 5e-5);
    }
}
