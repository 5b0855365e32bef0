//! One execution of a grasp: the label's contract.
//!
//! 1. The geometric gate ([`Gate`]) plays pre-grasp and approach: a straight way needs no time steps.
//! 2. The open gripper is put at the grasp and closes until both fingers stand still, or the jaws meet.
//! 3. It retreats, smoothly, pressing with its finger force, and holds still.
//! 4. The outcome is the first that applies: `pregrasp_collision`, `approach_collision`, `empty`, `slipped`,
//!    `hit_other`, `held`.

use schema::{Engine, Gripper, GripperBox, Outcome, Physics, Polyhedron, Pose, Procedure, Vec3};

use crate::bodies::{AttemptEngine, RapierThings};
use crate::engine::EngineBody;
use crate::gate::{Gate, Hit};
use crate::gripper::RapierAttempt;
use crate::mass_scaling::LeastInertia;
use crate::shortcuts::LiftWatch;
use crate::stepper::{Jaws, Stepper, Things};
use crate::tested_part::PlacedPart;
use crate::watch::{AttemptEvent, Moment, Phase, Watcher};
use crate::{Scene, SceneObject};

/// Fingers slower than this stand still …
const STOPPED_SPEED_M_S: f32 = 0.002;
/// … if they have for this long.
const STOPPED_TIME_S: f32 = 0.025;

/// Under a board a gripper rises by this share of its way out.
const RISE: f32 = 0.2;

/// A retreating gripper is held against fixtures this often on its way.
const WAY_STEP_M: f32 = 0.002;

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
    pub(crate) objects: Objects,
}

/// Objects and fixtures as the engine wants them.
pub(crate) enum Objects {
    Stepper(Things),
    Rapier(RapierThings),
}

impl Objects {
    /// Those of a scene; no object is less sluggish than `least`.
    pub(crate) fn of(physics: &Physics, objects: &[SceneObject], fixtures: &[Polyhedron], least: LeastInertia) -> Self {
        match physics.engine {
            Engine::Stepper => Self::Stepper(Things::of(objects, fixtures, least)),
            Engine::Rapier => Self::Rapier(RapierThings {
                bodies: objects.iter().map(|o| (EngineBody::of(o, least), o.workspace_from_object)).collect(),
                fixtures: fixtures.to_vec(),
            }),
        }
    }
}

impl<'a> AttemptWorld<'a> {
    /// Makes a scene ready. The world is built from the scene's poses alone, so that stored rows give the same
    /// attempts.
    #[must_use]
    pub fn new(physics: &'a Physics, gripper: &'a Gripper, procedure: &'a Procedure, scene: &Scene) -> Self {
        let objects = Objects::of(physics, &scene.objects, &scene.fixtures, LeastInertia::of(physics, gripper));
        let gate = Gate::new(scene, gripper, procedure);
        Self { physics, gripper, procedure, table_z_m: scene.table_z_m, gate, objects }
    }

    /// Tries one grasp of object `target`.
    ///
    /// With [`Physics::shortcuts`], what decides nothing is left out: objects stand still until they are touched, the
    /// fingers start where they first come near something, jaws with nothing between them are not simulated, and the
    /// lift ends when the target rides along and nothing lies ahead.
    ///
    /// # Panics
    /// If the scene has no object `target`.
    #[must_use]
    pub fn execute(&self, workspace_from_grasp: &Pose, target: usize) -> Execution {
        self.execute_watched(workspace_from_grasp, target, None)
    }

    /// The same before the eyes of a watcher, with the same end to the bit. If the lift ends before its way does, the
    /// rest is shown as well ([`Phase::After`]); it decides nothing.
    ///
    /// # Panics
    /// If the scene has no object `target`.
    #[must_use]
    pub fn execute_watched<'w>(
        &'w self,
        workspace_from_grasp: &Pose,
        target: usize,
        mut watcher: Option<&'w mut (dyn Watcher + 'w)>,
    ) -> Execution {
        let skipped_steps = match self.begin(workspace_from_grasp, target, watcher.as_deref_mut()) {
            Ok(steps) => steps,
            Err(end) => {
                if let Some(watcher) = watcher {
                    watcher.event(AttemptEvent::Decided(end), None);
                }
                return end;
            }
        };
        let mut run = Run::start(self, *workspace_from_grasp, target, skipped_steps, self.physics.shortcuts);
        run.watcher = watcher;
        let execution = run.finish();
        if run.watcher.is_some() {
            run.tell(AttemptEvent::Decided(execution));
            run.go_on();
        }
        execution
    }

    /// Tries one grasp of object `target` as [`Self::execute`] does without shortcuts, and gives what it leaves behind:
    /// where each object is, in the workspace, at the moment the attempt ends and the gripper is taken away. What was
    /// still held or falling then hangs in the air; [`crate::settle_again`] lets it come to rest.
    ///
    /// A gripper that the gate stopped has touched nothing: the poses are the scene's, to the bit.
    ///
    /// # Panics
    /// If the scene has no object `target`.
    #[must_use]
    pub fn execute_leaving(&self, workspace_from_grasp: &Pose, target: usize) -> (Execution, Vec<Pose>) {
        if let Some(blocked) = self.blocked(workspace_from_grasp, target) {
            return (blocked, self.gate.poses().collect());
        }
        self.close_and_lift(workspace_from_grasp, target)
    }

    /// Where the open gripper halts that stops at the first touch of its way instead of giving up; the grasp itself if
    /// nothing is in the way, and `None` if something is at the pre-grasp.
    #[must_use]
    pub fn halted(&self, workspace_from_grasp: &Pose) -> Option<Pose> {
        let back_m = self.stops_short_m(workspace_from_grasp)?;
        Some(*workspace_from_grasp * Pose::from_translation(Vec3::new(0.0, 0.0, -back_m)))
    }

    /// How far from the grasp that is, in metres.
    pub(crate) fn stops_short_m(&self, workspace_from_grasp: &Pose) -> Option<f32> {
        let way_m = self.gate.free_way_m(workspace_from_grasp)?;
        Some((self.procedure.pregrasp_distance_m - way_m).max(0.0))
    }

    /// As [`Self::execute_leaving`] from where the gripper stands open, however it came there.
    ///
    /// # Panics
    /// If the scene has no object `target`.
    #[must_use]
    pub fn close_and_lift(&self, workspace_from_grasp: &Pose, target: usize) -> (Execution, Vec<Pose>) {
        let mut run = Run::start(self, *workspace_from_grasp, target, 0, false);
        let execution = run.finish();
        (execution, run.workspace_poses())
    }

    /// A fresh copy of the scene with a gripper in it.
    fn engine(&self, workspace_from_grasp: &Pose, closed_m: f32, all_awake: bool) -> Box<dyn AttemptEngine + '_> {
        match &self.objects {
            Objects::Stepper(things) => Box::new(self.stepper(things, workspace_from_grasp, closed_m, all_awake)),
            Objects::Rapier(things) => Box::new(RapierAttempt::new(
                self.physics,
                self.gripper,
                things,
                self.table_z_m,
                workspace_from_grasp,
                closed_m,
                all_awake,
            )),
        }
    }

    pub(crate) fn stepper<'s>(
        &self,
        things: &'s Things,
        workspace_from_grasp: &Pose,
        closed_m: f32,
        all_awake: bool,
    ) -> Stepper<'s> {
        let closed_m_max = self.gate.free_closing_m(workspace_from_grasp, self.gripper);
        let jaws = Jaws::new(self.gripper, closed_m, closed_m_max);
        Stepper::new(self.physics, jaws, things, self.table_z_m, workspace_from_grasp, all_awake)
    }

    /// A grasp of object `target` as it is once the hand went along y until its fixed jaw, if it has one, is beside
    /// what it would meet: [`Gripper::BESIDE_M`] and its clearance away.
    ///
    /// # Panics
    /// If the scene has no object `target`.
    #[must_use]
    pub fn beside_fixed_jaw(&self, workspace_from_grasp: &Pose, target: usize) -> Pose {
        let Some(side) = self.gripper.fixed_side() else { return *workspace_from_grasp };
        let (inward, grasp_from_object) =
            ([Vec3::Y, -Vec3::Y][side], self.gate.pose_from(workspace_from_grasp, target));
        let (boxes, parts) = (self.gripper.jaw_at(side, 0.0), self.gate.placed_at(Some(target), &grasp_from_object));
        let jaw = boxes.iter().map(|part| PlacedPart::from_box(part, &Pose::IDENTITY));
        let free_m = jaw.flat_map(|jaw| parts.iter().map(move |part| jaw.free_way_m(part, inward)));
        let free_m = free_m.fold(f32::INFINITY, f32::min);
        let way_m = free_m - Gripper::BESIDE_M - self.gripper.clearance_m;
        let is_way = way_m > 0.0 && way_m.is_finite();
        *workspace_from_grasp * Pose::from_translation(inward * if is_way { way_m } else { 0.0 })
    }

    /// Opening between the inner faces of fingers that have closed by `closed_m` each, in metres.
    pub(crate) fn width_m(&self, closed_m: [f32; 2]) -> f32 {
        self.gripper.gap_m(closed_m)
    }

    /// The end of an attempt that the gate stops.
    pub(crate) fn blocked(&self, workspace_from_grasp: &Pose, target: usize) -> Option<Execution> {
        let (outcome, hit) = self.gate.blocked(workspace_from_grasp, target)?;
        Some(Execution { outcome, hit: Some(hit), width_m: None, steps: 0 })
    }
}

/// An attempt under way.
pub(crate) struct Run<'a> {
    pub(crate) setup: &'a AttemptWorld<'a>,
    pub(crate) engine: Box<dyn AttemptEngine + 'a>,
    object_count: usize,
    /// Steps of closing that were left out.
    skipped_steps: usize,
    /// Whether what decides nothing is left out.
    shortcuts: bool,
    steps: usize,
    /// Up, in the world.
    up: Vec3,
    pub(crate) workspace_from_grasp: Pose,
    pub(crate) target: usize,
    phase: Phase,
    lift: Option<Lift>,
    watcher: Option<&'a mut (dyn Watcher + 'a)>,
}

/// The way of the gripper with its catch.
#[derive(Debug, Clone, Copy)]
struct Lift {
    direction: Vec3,
    /// How much further the left finger has closed than the right.
    asymmetry_m: f32,
    retreat_steps: usize,
    all_steps: usize,
    /// Steps that have been made.
    step: usize,
    /// How far the gripper has come.
    distance_m: f32,
}

impl<'a> Run<'a> {
    fn start(
        setup: &'a AttemptWorld<'a>,
        workspace_from_grasp: Pose,
        target: usize,
        skipped_steps: usize,
        shortcuts: bool,
    ) -> Self {
        let closed_m = skipped_steps as f32 * setup.closing_step_m();
        let object_count = setup.gate.poses().len();
        assert!(target < object_count, "the scene has {object_count} objects, and the target is number {target}");
        Self {
            setup,
            engine: setup.engine(&workspace_from_grasp, closed_m, !shortcuts),
            object_count,
            skipped_steps,
            shortcuts,
            steps: 0,
            up: workspace_from_grasp.inverse().rotation * Vec3::Z,
            workspace_from_grasp,
            target,
            phase: Phase::Close,
            lift: None,
            watcher: None,
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
        let width_m = self.width_m();
        let hit = pushed.or_else(|| self.raised(&before)).or_else(|| self.lifted_into_fixture());
        self.ended(if hit.is_some() { Outcome::HitOther } else { Outcome::Held }, hit, width_m)
    }

    fn ended(&self, outcome: Outcome, hit: Option<Hit>, width_m: f32) -> Execution {
        Execution { outcome, hit, width_m: Some(width_m), steps: self.steps }
    }

    fn step(&mut self) {
        self.engine.step();
        self.steps += 1;
        if self.watcher.is_some() {
            self.show(|watcher, moment| watcher.step(moment));
        }
    }

    /// Tells the watcher, if there is one.
    fn tell(&mut self, event: AttemptEvent) {
        self.show(|watcher, moment| watcher.event(event, Some(moment)));
    }

    fn show(&mut self, how: impl FnOnce(&mut dyn Watcher, &Moment<'_>)) {
        let Some(watcher) = self.watcher.take() else { return };
        let moment = Moment {
            phase: self.phase,
            steps: self.skipped_steps + self.steps,
            engine: &*self.engine,
            object_count: self.object_count,
            workspace_from_grasp: self.workspace_from_grasp,
        };
        how(watcher, &moment);
        self.watcher = Some(watcher);
    }

    /// Opening between the fingers' inner faces, in metres.
    fn width_m(&self) -> f32 {
        self.setup.width_m(self.engine.closed_m())
    }

    /// Closes until both fingers stand still; gives the opening.
    fn close(&mut self) -> f32 {
        let mut fingers = Stopping::new(self.setup.physics, self.engine.closed_m());
        for _ in self.skipped_steps..self.setup.physics.steps(self.setup.procedure.close_time_s_max) {
            self.step();
            let have_stopped = fingers.have_stopped(self.engine.closed_m());
            let width_m = self.width_m();
            if width_m <= self.setup.procedure.empty_width_m {
                self.tell(AttemptEvent::JawsMet { width_m });
                return width_m;
            }
            if have_stopped {
                self.tell(AttemptEvent::FingersStopped { width_m });
                return width_m;
            }
        }
        let width_m = self.width_m();
        self.tell(AttemptEvent::ClosingTimeOver { width_m });
        width_m
    }

    /// Moves the gripper out and holds; whether the target came along and is still gripped.
    fn retreat_and_hold(&mut self, target_start_m: Vec3) -> bool {
        let (physics, procedure) = (self.setup.physics, self.setup.procedure);
        let mut lift = self.begin_lift();
        let mut watch = LiftWatch::new(physics);
        while lift.step < lift.all_steps {
            let last_m = lift.distance_m;
            self.phase = if lift.step < lift.retreat_steps { Phase::Retreat } else { Phase::Hold };
            self.lift_once(&mut lift);
            let width_m = self.width_m();
            if width_m <= procedure.empty_width_m {
                self.tell(AttemptEvent::JawsMet { width_m });
                return false;
            }
            if self.shortcuts {
                let velocity_m_s = lift.direction * ((lift.distance_m - last_m) * physics.step_rate_hz);
                let rest = procedure.retreat_distance_m - lift.distance_m;
                let share = lift.share();
                let is_slowing = share > 0.5 && share < 1.0;
                if watch.is_decided(self, velocity_m_s, lift.direction * rest, is_slowing) {
                    self.tell(AttemptEvent::RidesAlong { rest_m: rest });
                    return true;
                }
            }
        }
        let travel_m = (self.positions()[self.target] - target_start_m).dot(lift.direction);
        let travel_m_min = procedure.held_travel_share_min * procedure.retreat_distance_m;
        let came_along = travel_m >= travel_m_min;
        let is_held = came_along && self.engine.is_gripped(self.target);
        self.tell(match (came_along, is_held) {
            (false, _) => AttemptEvent::LeftBehind { travel_m, travel_m_min },
            (true, false) => AttemptEvent::NotGripped,
            (true, true) => AttemptEvent::Gripped { travel_m },
        });
        is_held
    }

    fn begin_lift(&self) -> Lift {
        let (physics, procedure) = (self.setup.physics, self.setup.procedure);
        let retreat_steps = physics.steps(procedure.retreat_distance_m / procedure.retreat_speed_m_s);
        let [left, right] = self.engine.closed_m();
        Lift {
            direction: self.retreat_direction(),
            asymmetry_m: left - right,
            retreat_steps,
            all_steps: retreat_steps + physics.steps(procedure.hold_time_s),
            step: 0,
            distance_m: 0.0,
        }
    }

    /// One step of the lift.
    fn lift_once(&mut self, lift: &mut Lift) {
        lift.step += 1;
        let share = lift.share();
        // Smoothstep: the gripper starts and stops without a jolt.
        lift.distance_m = self.setup.procedure.retreat_distance_m * share * share * (3.0 - 2.0 * share);
        self.engine.press(lift.asymmetry_m);
        self.engine.move_to(lift.direction * lift.distance_m);
        self.step();
        self.lift = Some(*lift);
    }

    /// What is left of a lift, for those who look on: nothing of it decides.
    fn go_on(&mut self) {
        let Some(mut lift) = self.lift else { return };
        self.phase = Phase::After;
        while lift.step < lift.all_steps {
            self.lift_once(&mut lift);
        }
    }

    /// What the closing gripper drove: another object; or a fixture or the table, if a finger came within half the
    /// clearance of it (the gate has kept the open gripper a whole clearance away).
    fn pushed(&mut self, before: &[Vec3], after: &[Vec3]) -> Option<Hit> {
        let limit = self.setup.procedure.other_push_m_max;
        let moved_m = |id: usize| (after[id] - before[id]).length();
        let moved = self.others().find(|id| moved_m(*id) > limit);
        if let Some(object_id) = moved {
            self.tell(AttemptEvent::Pushed { object_id, moved_m: moved_m(object_id) });
            return Some(Hit::object(object_id, self.target));
        }
        let (gripper, closed_m) = (self.setup.gripper, self.engine.closed_m());
        let near_m = 0.5 * gripper.clearance_m;
        let swept = [0, 1].into_iter().flat_map(|side| gripper.jaw_sweep(side, closed_m[side]));
        let swept: Vec<GripperBox> = swept.map(|part| part.grown(near_m)).collect();
        if self.setup.gate.touches_fixtures(&self.workspace_from_grasp, &swept) {
            self.tell(AttemptEvent::NearContainer);
            return Some(Hit::CONTAINER);
        }
        let mut closed = [0, 1].into_iter().flat_map(|side| gripper.jaw_at(side, closed_m[side]));
        let low = closed.any(|b| b.lowest_z_m(&self.workspace_from_grasp) < self.setup.table_z_m + near_m);
        if low {
            self.tell(AttemptEvent::NearTable);
        }
        low.then_some(Hit::TABLE)
    }

    /// The fixture that the gripper met on the whole way of its retreat, as [`Self::pushed`] has it.
    fn lifted_into_fixture(&mut self) -> Option<Hit> {
        let (gripper, gate) = (self.setup.gripper, &self.setup.gate);
        if !gate.has_fixtures() {
            return None;
        }
        let closed = gripper.parts(self.engine.closed_m()).into_iter();
        let boxes: Vec<GripperBox> = closed.map(|(_, part)| part.grown(0.5 * gripper.clearance_m)).collect();
        let (direction, way_m) = (self.retreat_direction(), self.setup.procedure.retreat_distance_m);
        let steps = (way_m / WAY_STEP_M).ceil();
        let hits = (0..=steps as usize).any(|step| {
            let moved_m = direction * (way_m * step as f32 / steps);
            let moved: Vec<GripperBox> = boxes.iter().map(|b| b.moved(moved_m)).collect();
            gate.touches_fixtures(&self.workspace_from_grasp, &moved)
        });
        if hits {
            self.tell(AttemptEvent::NearContainer);
        }
        hits.then_some(Hit::CONTAINER)
    }

    /// Which other object was raised while lifting.
    fn raised(&mut self, before: &[Vec3]) -> Option<Hit> {
        let (now, up) = (self.positions(), self.up);
        let limit = self.setup.procedure.other_lift_m_max;
        let raised_m = |id: usize| (now[id] - before[id]).dot(up);
        let object_id = self.others().find(|id| raised_m(*id) > limit)?;
        self.tell(AttemptEvent::Pushed { object_id, moved_m: raised_m(object_id) });
        Some(Hit::object(object_id, self.target))
    }

    pub(crate) fn others(&self) -> impl Iterator<Item = usize> {
        let target = self.target;
        (0..self.object_count).filter(move |id| *id != target)
    }

    fn positions(&self) -> Vec<Vec3> {
        (0..self.object_count).map(|id| self.engine.pose(id).translation).collect()
    }

    /// Where the objects are now, in the workspace. (The world's frame is that of the gripper at the grasp.)
    fn workspace_poses(&self) -> Vec<Pose> {
        let in_workspace = |id: usize| {
            let pose = self.workspace_from_grasp * self.engine.pose(id);
            Pose::from_parts(pose.translation, pose.rotation.normalize())
        };
        (0..self.object_count).map(in_workspace).collect()
    }

    /// Where the gripper goes with its catch: back along the approach if that is near enough to straight down, else up;
    /// under a board back and a little up.
    fn retreat_direction(&self) -> Vec3 {
        let back = -Vec3::Z;
        if back.dot(self.up) >= libm::cosf(self.setup.procedure.retreat_cone_rad) {
            back
        } else if self.setup.gate.is_covered(&self.workspace_from_grasp) {
            (back + RISE * self.up).normalize()
        } else {
            self.up
        }
    }
}

/// Watches closing fingers until they stand still.
pub(crate) struct Stopping {
    slow_m: f32,
    wanted_steps: usize,
    steps: usize,
    last_closed_m: [f32; 2],
}

impl Stopping {
    pub(crate) fn new(physics: &Physics, closed_m: [f32; 2]) -> Self {
        let (slow_m, wanted_steps) = (STOPPED_SPEED_M_S * physics.dt_s(), physics.steps(STOPPED_TIME_S));
        Self { slow_m, wanted_steps, steps: 0, last_closed_m: closed_m }
    }

    /// Whether they do, now that they have closed by `closed_m` each (call after every step).
    pub(crate) fn have_stopped(&mut self, closed_m: [f32; 2]) -> bool {
        let is_still = closed_m.iter().zip(&self.last_closed_m).all(|(a, b)| (a - b).abs() < self.slow_m);
        self.steps = if is_still { self.steps + 1 } else { 0 };
        self.last_closed_m = closed_m;
        self.steps >= self.wanted_steps
    }
}

impl Lift {
    /// How much of the retreat's time is over.
    fn share(&self) -> f32 {
        (self.step as f32 / self.retreat_steps as f32).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use schema::{Quat, ShapeKind, Solid, axis_angle};

    use super::*;

    /// How far a block of `mass_kg` has fallen behind the gripper at the end of lift and hold, in metres.
    fn lag_m(physics: &Physics, mass_kg: f32, hold_time_s: f32) -> f32 {
        let gripper = Gripper::from_toml(include_str!("../../configs/grippers/parallel_jaw_80.toml")).unwrap();
        let procedure = Procedure { hold_time_s, ..Procedure::PAPER };
        let solid = Solid::new(ShapeKind::Cuboid, Vec3::new(0.04, 0.04, 0.06)).unwrap();
        let at = Vec3::new(0.15, 0.15, 0.08);
        let workspace_from_object = Pose::from_parts(at, Quat::IDENTITY);
        let block = SceneObject { body: solid.into(), mass_kg, friction: 1.0, workspace_from_object };
        let scene = Scene { table_z_m: 0.05, fixtures: Vec::new(), objects: vec![block] };
        let setup = AttemptWorld::new(physics, &gripper, &procedure, &scene);
        let mut run = Run::start(&setup, Pose::from_parts(at, axis_angle(Vec3::X, core::f32::consts::PI)), 0, 0, false);
        run.close();
        let start_m = run.positions()[0];
        run.retreat_and_hold(start_m);
        procedure.retreat_distance_m - (run.positions()[0] - start_m).dot(run.up)
    }

    /// Two fingers of 20 N with friction 1 accelerate 3.6 kg by at most c = 40 N / 3.6 kg − g, and the lift asks for
    /// A = 6 d / T² at first: the block slides d·(1 − c/A)³ until it is as fast as the gripper, then rests in the jaws.
    #[test]
    fn a_heavy_block_slides_as_far_as_coulomb_says_and_does_not_creep() {
        let wanted = 6.0 * 0.1 / (0.5 * 0.5);
        let expected_m = 0.1 * (1.0_f32 - (40.0 / 3.6 - 9.81) / wanted).powi(3);
        let faithful = Physics::FAITHFUL;
        for physics in [
            Physics { engine: Engine::Rapier, ..faithful },
            Physics { engine: Engine::Stepper, ..faithful },
            Physics { engine: Engine::Stepper, solver_iterations: 4, ..faithful },
        ] {
            let (lifted_m, held_m) = (lag_m(&physics, 3.6, 0.0), lag_m(&physics, 3.6, 1.0));
            assert!(
                (lifted_m - expected_m).abs() < 0.003,
                "{lifted_m} m, by the closed form {expected_m} m: {physics:?}"
            );
            assert!((held_m - lifted_m).abs() < 5e-5, "crept {} m in a second: {physics:?}", held_m - lifted_m);
            assert!(lag_m(&physics, 0.5, 1.0).abs() < 5e-5, "{physics:?}");
        }
    }
}
