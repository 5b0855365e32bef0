//! A grasp of an object that floats: no table, and no gravity while the gripper closes; then what the gripper has is
//! pulled or shaken.
//!
//! The frame is that of the grasp, and the gripper stays where it is in it. A gripper that moves is a frame that
//! accelerates, in which what is free gains the opposite acceleration; so nothing is lost, and no step is spent on a
//! way.

use schema::{Engine, Gripper, Outcome, Physics, Pose, Procedure, Quat, Vec3};

use crate::attempt::{AttemptWorld, Execution, Objects, Stopping};
use crate::bodies::{AttemptEngine as _, Bodies as _};
use crate::load::Load;
use crate::stepper::Stepper;
use crate::watch::{Moment, Phase, Watcher};
use crate::{Body, Obstruction, Scene, SceneObject};

/// A clearance is measured up to this, and as far into the object, in metres.
const CLEARANCE_M_MAX: f32 = 0.02;
/// The table of a floating object is this far below it.
const FAR_M: f32 = 1e3;
/// While jaws that are not alike close an object loses speed at this rate, as on a table: it would fly from the first
/// that touches it against the second. Two fingers that slide were compared with grasps that FleX labelled, which agree
/// less with this.
const CLOSING_DAMPING_1_S: f32 = 50.0;
/// An object is at rest in the gripper if for so long it moves no faster than [`Hold::slow`] says: two steps.
const REST_TIME_S: f32 = 0.0083;
/// What is light may leave a finger for so long.
const WINDOW_S: f32 = 0.025;
/// However far it may go: what starts to tip gets faster and faster. In m/s and rad/s.
const SLOW_MAX: [f32; 2] = [0.004, 0.08];

/// An object that floats at the origin of its own frame, made ready for grasps.
pub struct FloatingWorld<'a> {
    world: AttemptWorld<'a>,
}

/// When an object counts as lost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hold {
    /// Its centre of mass has moved further than this against the fingers.
    pub moved_m_max: f32,
    /// It has turned further than this.
    pub turned_rad_max: f32,
}

/// How an object moved in a gripper.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Motion {
    /// Its centre of mass, against the point between the fingers, in metres.
    pub moved_m: f32,
    /// In radians.
    pub turned_rad: f32,
}

/// How a load ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ending {
    /// Whether the object is still between both fingers, and has not moved too far.
    pub is_held: bool,
    /// How it moved under the load.
    pub motion: Motion,
}

/// A gripper that has closed on an object.
#[derive(Clone)]
pub struct Grip<'a> {
    world: &'a AttemptWorld<'a>,
    stepper: Stepper<'a>,
    asymmetry_m: f32,
    closing: Motion,
    /// Pose of the object in the frame of the grasp.
    grasp_from_object: Pose,
    /// The grasp in the frame of the object as it was before.
    object_from_grasp: Pose,
}

/// Who watches, if anybody does, and the steps that were before.
type Watching<'w, 'r> = Option<(&'w mut (dyn Watcher + 'r), usize)>;

/// What is seen after a step; the gripper stands still, where it came to in the object's frame.
fn moment<'r>(stepper: &'r Stepper<'_>, phase: Phase, steps: usize, object_from_grasp: &Pose) -> Moment<'r> {
    Moment { phase, steps, engine: stepper, object_count: 1, workspace_from_grasp: *object_from_grasp }
}

impl<'a> FloatingWorld<'a> {
    /// Makes an object ready, with its mass in kilograms and its friction.
    ///
    /// # Panics
    /// If the physics is not that of the stepper: the other engine has no floating objects.
    #[must_use]
    pub fn new(
        physics: &'a Physics,
        gripper: &'a Gripper,
        procedure: &'a Procedure,
        body: &Body,
        mass_kg: f32,
        friction: f32,
    ) -> Self {
        assert!(physics.engine == Engine::Stepper, "floating objects are the stepper's");
        let object = SceneObject { body: body.clone(), mass_kg, friction, workspace_from_object: Pose::IDENTITY };
        let scene = Scene { table_z_m: -FAR_M, fixtures: Vec::new(), objects: vec![object] };
        Self { world: AttemptWorld::new(physics, gripper, procedure, &scene) }
    }

    /// Closes the gripper at a grasp in the object's frame; or how the attempt ended before anything was between the
    /// fingers: the gripper cannot come there, or the jaws met.
    ///
    /// # Errors
    /// The end of the attempt.
    pub fn close(&self, object_from_grasp: &Pose) -> Result<Grip<'_>, Execution> {
        self.close_watched(object_from_grasp, None)
    }

    /// As [`Self::close`], and shows every step, in the frame of the object as it was before.
    ///
    /// # Errors
    /// The end of the attempt.
    pub fn close_watched(
        &self,
        object_from_grasp: &Pose,
        mut watcher: Option<&mut (dyn Watcher + '_)>,
    ) -> Result<Grip<'_>, Execution> {
        let world = &self.world;
        let skipped = world.begin(object_from_grasp, 0, watcher.as_deref_mut())?;
        let Objects::Stepper(things) = &world.objects else { unreachable!("the stepper was asked for") };
        let closed_m = skipped as f32 * world.closing_step_m();
        let mut stepper = world.stepper(things, object_from_grasp, closed_m, !world.physics.shortcuts);
        stepper.accelerate(Vec3::ZERO, None);
        stepper.jaws.keep_pace(true);
        if !world.gripper.jaws.is_empty() {
            stepper.jaws.depth_m = world.physics.finger_depth_m_max;
            stepper.damping_1_s = CLOSING_DAMPING_1_S;
        }
        let before = Placed::of(&stepper, world.gripper);
        let mut fingers = Stopping::new(world.physics, stepper.closed_m());
        // What floats would drift on between two fingers that know nothing of each other. From when both press, they
        // are tied as in a lift.
        let mut asymmetry_m = None;
        for step in skipped..world.physics.steps(world.procedure.close_time_s_max) {
            stepper.step();
            if let Some(watcher) = watcher.as_deref_mut() {
                watcher.step(&moment(&stepper, Phase::Close, step + 1, object_from_grasp));
            }
            let closed_m = stepper.closed_m();
            let width_m = world.width_m(closed_m);
            if width_m <= world.procedure.empty_width_m {
                let (width_m, steps) = (Some(width_m), step + 1 - skipped);
                return Err(Execution { outcome: Outcome::Empty, hit: None, width_m, steps });
            }
            if asymmetry_m.is_none() && stepper.is_gripped(0) {
                asymmetry_m = Some(closed_m[0] - closed_m[1]);
                if world.physics.shortcuts {
                    stepper.keep_contacts();
                }
            }
            if let Some(asymmetry_m) = asymmetry_m {
                stepper.press(asymmetry_m);
            }
            if fingers.have_stopped(closed_m) {
                break;
            }
        }
        stepper.jaws.keep_pace(false);
        stepper.damping_1_s = 0.0;
        let [left, right] = stepper.closed_m();
        let asymmetry_m = asymmetry_m.unwrap_or(left - right);
        let after = Placed::of(&stepper, world.gripper);
        let closing =
            Motion { moved_m: (after.centre_m - before.centre_m).length(), turned_rad: after.turned_rad(&before) };
        let grasp_from_object = stepper.pose(0);
        Ok(Grip { world, stepper, asymmetry_m, closing, grasp_from_object, object_from_grasp: *object_from_grasp })
    }

    /// Whether the open gripper comes to a grasp without touching the object.
    #[must_use]
    pub fn is_reached(&self, object_from_grasp: &Pose) -> bool {
        self.world.gate.blocked(object_from_grasp, 0).is_none()
    }

    /// How near the open gripper comes to the object, at a grasp in the object's frame and on its straight way there,
    /// in metres: by so much its boxes could grow on every side before they touch; below 0 how deep they are in it.
    /// Between -0.02 and 0.02, to 0.04 mm.
    #[must_use]
    pub fn clearance_m(&self, object_from_grasp: &Pose) -> f32 {
        let grown_m = self.world.gripper.clearance_m;
        let ends_m = [-CLEARANCE_M_MAX - grown_m, CLEARANCE_M_MAX - grown_m];
        self.world.gate.room_m(object_from_grasp, 0, ends_m) + grown_m
    }

    /// A grasp whose way the object is in, as it is once the object, which is free, was pushed aside by as little as
    /// frees the way, and how far that was, in metres: across the approach or along it, in steps of 0.5 mm. `None` if
    /// `most_m` is not enough.
    #[must_use]
    pub fn pushed_aside(&self, object_from_grasp: &Pose, most_m: f32) -> Option<(Pose, f32)> {
        let way_m = self.world.gate.way_aside_m(object_from_grasp, 0, most_m)?;
        let aside = *object_from_grasp * Pose::from_translation(way_m);
        // At the edge of the last step rounding decides.
        self.is_reached(&aside).then(|| (aside, way_m.abs().max_element()))
    }

    /// [`AttemptWorld::beside_fixed_jaw`], in the object's frame.
    #[must_use]
    pub fn beside_fixed_jaw(&self, object_from_grasp: &Pose) -> Pose {
        self.world.beside_fixed_jaw(object_from_grasp, 0)
    }

    /// What blocks the gripper on its way to a grasp, in the object's frame; `None` if nothing does.
    #[must_use]
    pub fn obstruction(&self, object_from_grasp: &Pose) -> Option<Obstruction> {
        self.world.obstruction(object_from_grasp, 0)
    }

    /// The object's centre of mass, in its frame, in metres.
    #[must_use]
    pub fn centre_of_mass_m(&self) -> Vec3 {
        let Objects::Stepper(things) = &self.world.objects else { unreachable!("the stepper was asked for") };
        things.moving[0].centre_m
    }

    /// By how much the open gripper stops short of a grasp when it comes along the approach and halts before the
    /// object; `None` if it touches the object at the pre-grasp.
    #[must_use]
    pub fn stops_short_m(&self, object_from_grasp: &Pose) -> Option<f32> {
        self.world.stops_short_m(object_from_grasp)
    }
}

/// Where an object is in the gripper.
#[derive(Clone, Copy)]
struct Placed {
    centre_m: Vec3,
    rotation: Quat,
    /// The point between the fingers, along y.
    middle_m: f32,
}

impl Placed {
    fn of(stepper: &Stepper<'_>, gripper: &Gripper) -> Self {
        let [left, right] = gripper.reach_m(stepper.closed_m());
        Self { centre_m: stepper.centre_m(0), rotation: stepper.pose(0).rotation, middle_m: 0.5 * (left - right) }
    }

    fn turned_rad(&self, before: &Self) -> f32 {
        let turn = self.rotation * before.rotation.inverse();
        let along = Vec3::new(turn.x, turn.y, turn.z).length();
        2.0 * libm::atan2f(along, turn.w.abs())
    }

    fn motion(&self, before: &Self) -> Motion {
        let sagged_m = Vec3::Y * (self.middle_m - before.middle_m);
        let moved_m = (self.centre_m - before.centre_m - sagged_m).length();
        Motion { moved_m, turned_rad: self.turned_rad(before) }
    }
}

impl Grip<'_> {
    /// Distance between the fingers, in metres.
    #[must_use]
    pub fn width_m(&self) -> f32 {
        self.world.width_m(self.stepper.closed_m())
    }

    /// How the object moved while the gripper closed.
    #[must_use]
    pub fn closing(&self) -> Motion {
        self.closing
    }

    /// Where the left (−y) and the right finger press on the object, in metres: the middle of the points on the part on
    /// which the finger presses most; and the direction in which it does. In the object's frame; `None` for one that
    /// does not press.
    #[must_use]
    pub fn contacts_m(&self) -> [Option<[Vec3; 2]>; 2] {
        let Pose { rotation, .. } = self.grasp_from_object;
        [(0, Vec3::Y), (1, Vec3::NEG_Y)].map(|(finger, push): (usize, Vec3)| {
            let at_m = self.stepper.pressed_at_m(finger, 0)?;
            Some([self.grasp_from_object.inverse_transform_point(at_m), rotation.inverse() * push])
        })
    }

    /// Whether the object stays in the gripper under a load, with the gripper's friction multiplied by
    /// `friction_factor` once it has closed. The grip itself stays as it is.
    #[must_use]
    pub fn bear(&self, load: &Load, hold: &Hold, friction_factor: f32) -> Ending {
        self.bear_watched(load, hold, friction_factor, None)
    }

    /// As [`Self::bear`], and shows every step as [`FloatingWorld::close_watched`] does; steps are counted from those
    /// that were before.
    #[must_use]
    pub fn bear_watched(
        &self,
        load: &Load,
        hold: &Hold,
        friction_factor: f32,
        mut watching: Watching<'_, '_>,
    ) -> Ending {
        let (physics, procedure) = (self.world.physics, self.world.procedure);
        let mut stepper = self.stepper.clone();
        stepper.jaws.friction *= friction_factor;
        if physics.shortcuts {
            stepper.keep_contacts();
        }
        let before = Placed::of(&stepper, self.world.gripper);
        // What got more inertia than its own moves under its weight as it would, but more slowly: a pull lasts longer.
        let share = stepper.weight_share(0);
        let slower = if matches!(load, Load::Pull { .. }) { 1.0 / share.sqrt() } else { 1.0 };
        let slow = hold.slow(load.time_s()).map(|speed| speed * share);
        let (rest_steps, window) = (physics.steps(REST_TIME_S), physics.steps(WINDOW_S));
        let (mut since_gripped, mut resting, mut motion) = (0, 0, Motion::default());
        let steps = physics.steps(load.time_s() * slower);
        for step in 0..steps {
            let time_s = (step as f32 + 0.5) * physics.dt_s();
            let (gravity_m_s2, turning) = load.at(time_s);
            stepper.accelerate(gravity_m_s2, turning);
            stepper.press(self.asymmetry_m);
            stepper.move_to(Vec3::ZERO);
            stepper.step();
            if let Some((watcher, before)) = &mut watching {
                watcher.step(&moment(&stepper, Phase::Bear, *before + step + 1, &self.object_from_grasp));
            }
            motion = Placed::of(&stepper, self.world.gripper).motion(&before);
            let width_m = self.world.width_m(stepper.closed_m());
            since_gripped = if stepper.is_gripped(0) { 0 } else { since_gripped + 1 };
            let is_lost = motion.moved_m > hold.moved_m_max || motion.turned_rad > hold.turned_rad_max;
            if is_lost || width_m <= procedure.empty_width_m {
                return Ending { is_held: false, motion };
            }
            let rests = load.is_steady(time_s) && since_gripped == 0 && stepper.is_slow(0, Vec3::ZERO, slow);
            resting = if rests { resting + 1 } else { 0 };
            if physics.shortcuts && resting >= rest_steps {
                break;
            }
        }
        Ending { is_held: since_gripped <= window, motion }
    }
}

impl Hold {
    /// What gains no more speed than this in [`REST_TIME_S`], in m/s and rad/s, comes half as far in a load of `time_s`
    /// as it may if it goes on to gain as much: the load need not be played to its end.
    fn slow(&self, time_s: f32) -> [f32; 2] {
        let [moving, turning] =
            [self.moved_m_max, self.turned_rad_max].map(|most| most * REST_TIME_S / (time_s * time_s));
        [moving.min(SLOW_MAX[0]), turning.min(SLOW_MAX[1])]
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::{PI, TAU};

    use schema::{ShapeKind, Solid, axis_angle};

    use super::*;
    use crate::load::Shake;
    use crate::stepper::{Jaws, Turning};

    const FAITHFUL: Physics = Physics { solver_iterations: 8, ..Physics::FAITHFUL };
    const TIGHT: Hold = Hold { moved_m_max: 0.002, turned_rad_max: 0.1 };

    fn parallel_jaw() -> Gripper {
        Gripper::from_toml(include_str!("../../configs/grippers/parallel_jaw_80.toml")).unwrap()
    }

    /// A block of 40 × 40 × 20 mm.
    fn block() -> Body {
        Solid::new(ShapeKind::Cuboid, Vec3::new(0.04, 0.04, 0.02)).unwrap().into()
    }

    /// The grasp that has all of it between the fingers, its weight in the middle of what they press on.
    fn about_it() -> Pose {
        Pose::from_translation(Vec3::new(0.0, 0.0, 0.015))
    }

    /// The largest of accelerations, in m/s², between which a grip holds, by halving.
    fn most(low: f32, high: f32, holds: impl Fn(f32) -> bool) -> f32 {
        let (mut low, mut high) = (low, high);
        assert!(holds(low) && !holds(high), "{low} to {high}");
        for _ in 0..12 {
            let middle = 0.5 * (low + high);
            *if holds(middle) { &mut low } else { &mut high } = middle;
        }
        low
    }

    /// Two plates with friction μ that press with F hold m against a: 2 μ F = m a.
    #[test]
    fn a_block_between_plates_holds_as_coulomb_says() {
        let (gripper, procedure) = (parallel_jaw(), Procedure::PAPER);
        for (physics, mass_kg) in [(FAITHFUL, 2.0), (FAITHFUL, 0.7), (Physics::STANDARD, 2.0)] {
            let world = FloatingWorld::new(&physics, &gripper, &procedure, &block(), mass_kg, 0.6);
            let grip = world.close(&about_it()).ok().unwrap();
            assert!((grip.width_m() - 0.04).abs() < 5e-4 && grip.closing().moved_m < 5e-4);
            let expected = 2.0 * gripper.friction * 0.6 * gripper.finger_force_n / mass_kg;
            for direction in [Vec3::X, -Vec3::X, Vec3::Z, -Vec3::Z] {
                let pull = |m_s2: f32| Load::Pull { acceleration_m_s2: direction * m_s2, time_s: 0.5 };
                let got = most(0.2 * expected, 3.0 * expected, |m_s2| grip.bear(&pull(m_s2), &TIGHT, 1.0).is_held);
                assert!((got / expected - 1.0).abs() < 0.03, "{got} of {expected} m/s² along {direction}: {physics:?}");
            }
            let pull = Load::Pull { acceleration_m_s2: Vec3::Z * 0.25 * expected, time_s: 0.5 };
            let least = 1.0 - most(0.0, 0.99, |less| grip.bear(&pull, &TIGHT, 1.0 - less).is_held);
            assert!((least / 0.25 - 1.0).abs() < 0.03, "friction by {least}: {physics:?}");
        }
    }

    /// The pull, in m/s², at which a block turns or slides out of two plates that touch it at the four corners of a
    /// rectangle of half sides `half_m`, a quarter of the force on each, when its centre of mass is `beside_m` beside
    /// the rectangle's middle. By the theorem of the upper bound it is the least, over all points on that line about
    /// which it could turn, of the power that friction takes by the power that the pull gives: a slow search.
    fn turns_at_m_s2(friction_n: f32, mass_kg: f32, [half_x_m, half_z_m]: [f32; 2], beside_m: f32) -> f32 {
        let about = |x_m: f32| {
            let arms_m = [half_x_m - x_m, half_x_m + x_m].map(|side_m| libm::hypotf(side_m, half_z_m));
            // Two corners each, on two plates.
            friction_n * (arms_m[0] + arms_m[1]) / (mass_kg * (beside_m - x_m).abs())
        };
        (-100_000..100_000).map(|step| about(step as f32 * 1e-5)).fold(2.0 * friction_n / mass_kg, f32::min)
    }

    /// A block that is gripped beside its centre of mass turns before it slides.
    #[test]
    fn a_block_gripped_beside_its_centre_of_mass_turns_as_coulomb_says() {
        let (gripper, procedure) = (parallel_jaw(), Procedure::PAPER);
        let block: Body = Solid::new(ShapeKind::Cuboid, Vec3::new(0.14, 0.04, 0.02)).unwrap().into();
        let friction_n = gripper.friction * 0.6 * gripper.finger_force_n;
        let slides_m_s2 = 2.0 * friction_n;
        for (physics, beside_m) in [(FAITHFUL, 0.01), (FAITHFUL, 0.03), (FAITHFUL, 0.05), (Physics::STANDARD, 0.03)] {
            let world = FloatingWorld::new(&physics, &gripper, &procedure, &block, 1.0, 0.6);
            let grip = world.close(&Pose::from_translation(Vec3::new(-beside_m, 0.0, 0.015))).ok().unwrap();
            let expected = turns_at_m_s2(friction_n, 1.0, [0.5 * gripper.finger_width_m, 0.01], beside_m);
            assert!(expected < 0.9 * slides_m_s2, "{expected} of {slides_m_s2} m/s²: it turns first");
            for direction in [Vec3::Z, -Vec3::Z] {
                let pull = |m_s2: f32| Load::Pull { acceleration_m_s2: direction * m_s2, time_s: 0.5 };
                let got = most(0.2 * expected, 3.0 * expected, |m_s2| grip.bear(&pull(m_s2), &TIGHT, 1.0).is_held);
                assert!((got / expected - 1.0).abs() < 0.03, "{got} of {expected} m/s², {beside_m} m: {physics:?}");
            }
        }
    }

    /// In a frame that turns about its origin, a body that is free and rests stays where it is for who does not turn.
    #[test]
    fn what_nothing_holds_stays_where_it_is_while_the_frame_turns() {
        let (gripper, procedure) = (parallel_jaw(), Procedure::PAPER);
        let body: Body = Solid::new(ShapeKind::Cuboid, Vec3::new(0.02, 0.04, 0.07)).unwrap().into();
        let away = Pose::from_translation(Vec3::new(0.0, 0.0, -0.5));
        let world = FloatingWorld::new(&FAITHFUL, &gripper, &procedure, &body, 0.3, 0.6);
        let Objects::Stepper(things) = &world.world.objects else { unreachable!() };
        let mut stepper = Stepper::new(&FAITHFUL, Jaws::new(&gripper, 0.0, [0.04; 2]), things, -FAR_M, &away, true);
        let pivot_m = Vec3::new(0.02, -0.03, 0.0);
        let axis = Vec3::new(1.0, 2.0, -0.5).normalize();
        let start = stepper.centre_m(0);
        // The turn grows as ½ α t² for a quarter of a second.
        let (change, steps) = (20.0, 60);
        for step in 0..steps {
            let time_s = (step as f32 + 0.5) * FAITHFUL.dt_s();
            let turning = Turning { pivot_m, rate_rad_s: axis * (change * time_s), change_rad_s2: axis * change };
            stepper.accelerate(Vec3::ZERO, Some(turning));
            stepper.step();
        }
        let time_s = steps as f32 * FAITHFUL.dt_s();
        let turned = Quat::from_axis_angle(axis, 0.5 * change * time_s * time_s);
        let expected = pivot_m + turned.inverse() * (start - pivot_m);
        assert!((stepper.centre_m(0) - start).length() > 0.2, "it went far in the frame");
        assert!((stepper.centre_m(0) - expected).length() < 0.003, "{} for {expected}", stepper.centre_m(0));
        let left = stepper.pose(0).rotation * turned;
        assert!(2.0 * libm::acosf(left.w.abs().min(1.0)) < 0.02, "{left}");
    }

    /// A shake of ± half its way asks for A/2 (2π f)² at its ends, and a turn of ± half for that at the pivot's
    /// distance.
    #[test]
    fn a_shake_loses_what_coulomb_cannot_hold() {
        let (gripper, procedure) = (parallel_jaw(), Procedure::PAPER);
        let mass_kg = 1.0;
        let world = FloatingWorld::new(&FAITHFUL, &gripper, &procedure, &block(), mass_kg, 0.5);
        let grip = world.close(&about_it()).ok().unwrap();
        let holds_m_s2 = 2.0 * gripper.friction * 0.5 * gripper.finger_force_n / mass_kg;
        let rate_hz = 4.0;
        let way_m = 2.0 * holds_m_s2 / (TAU * rate_hz).powi(2);
        let shake = |way: Vec3, turn: Vec3| {
            let pivot_m = Vec3::new(0.0, 0.0, -0.2);
            Load::Shake(Shake { way_m: way, turn_rad: turn, pivot_m, rate_hz, cycles: 3.0 })
        };
        let loose = Hold { moved_m_max: 0.01, turned_rad_max: PI };
        let bears = |load: Load| grip.bear(&load, &loose, 1.0).is_held;
        assert!(bears(shake(Vec3::Z * (0.9 * way_m), Vec3::ZERO)));
        assert!(!bears(shake(Vec3::Z * (1.6 * way_m), Vec3::ZERO)));
        assert!(bears(shake(Vec3::ZERO, Vec3::Y * (0.6 * way_m / 0.2))));
        assert!(!bears(shake(Vec3::ZERO, Vec3::Y * (2.0 * way_m / 0.2))));
    }

    /// What is light has more inertia here than its own, and holds all the same, whatever it weighs: a cup whose walls
    /// are gripped 27 degrees from their normals, within the cone of friction, turns until it lies flat.
    #[test]
    fn a_light_cup_that_is_gripped_askew_holds_as_a_heavier_one_does() {
        let gripper = Gripper::from_toml(include_str!("../../configs/grippers/franka_hand.toml")).unwrap();
        let physics = Physics { finger_depth_m_max: 0.000_05, ..Physics::STANDARD };
        let cup: Body = Solid::new(ShapeKind::Cylinder, Vec3::new(0.06, 0.06, 0.1)).unwrap().into();
        let grasp = Pose::from_parts(
            Vec3::new(0.001_107, 0.013_487, -0.012_527),
            Quat::from_xyzw(0.552_674, 0.438_879, 0.481_984, -0.519_257).normalize(),
        );
        for mass_kg in [0.001, 0.003, 0.03, 0.2] {
            let world = FloatingWorld::new(&physics, &gripper, &Procedure::PAPER, &cup, mass_kg, 0.8);
            let grip = world.close(&grasp).ok().unwrap();
            let hold = Hold { moved_m_max: 0.01, turned_rad_max: 0.349 };
            let friction_n = 2.0 * gripper.friction * 0.8 * gripper.finger_force_n;
            for (m_s2, is_held) in [(9.81, true), (2.0 * friction_n / mass_kg, false)] {
                let pull = |direction: Vec3| Load::Pull { acceleration_m_s2: direction * m_s2, time_s: 0.25 };
                let held = [Vec3::X, -Vec3::X, Vec3::Z].map(|along| grip.bear(&pull(along), &hold, 1.0).is_held);
                assert_eq!(held, [is_held; 3], "{mass_kg} kg, {m_s2} m/s2");
            }
        }
    }

    #[test]
    fn what_cannot_be_closed_on_says_why() {
        let (gripper, procedure) = (parallel_jaw(), Procedure::PAPER);
        let world = FloatingWorld::new(&Physics::STANDARD, &gripper, &procedure, &block(), 0.1, 1.0);
        let ends =
            |at: Vec3| world.close(&Pose::from_translation(at)).map_or_else(|end| end.outcome, |_| Outcome::Held);
        assert_eq!(ends(Vec3::new(0.0, 0.0, -0.1)), Outcome::Empty);
        assert_eq!(ends(Vec3::new(0.0, 0.03, 0.0)), Outcome::ApproachCollision);
        assert_eq!(ends(Vec3::new(0.0, 0.03, 0.05)), Outcome::PregraspCollision);
    }

    /// The block is 40 mm wide between fingers that are 80 mm apart, 5 mm behind their tips and 25 mm before the palm.
    #[test]
    fn a_clearance_is_the_gap_beside_the_block_or_how_deep_a_finger_is_in_it() {
        let (gripper, procedure) = (parallel_jaw(), Procedure::PAPER);
        let world = FloatingWorld::new(&Physics::STANDARD, &gripper, &procedure, &block(), 0.1, 1.0);
        let beside = |y_m: f32| Pose::from_translation(Vec3::new(0.0, y_m, 0.015));
        let over = Pose::from_translation(Vec3::new(0.0, 0.0, 0.03));
        for (pose, expected_m) in [
            (beside(0.015), 0.005),
            (beside(-0.015), 0.005),
            (beside(0.0195), 0.0005),
            (beside(0.023), -0.003),
            (beside(0.028), -0.008),
            (over, 0.01),
            (beside(0.0), CLEARANCE_M_MAX),
            (Pose::from_translation(Vec3::Z * -0.5), CLEARANCE_M_MAX),
            (Pose::from_translation(Vec3::new(0.0, 0.045, 0.06)), -CLEARANCE_M_MAX),
        ] {
            let got_m = world.clearance_m(&pose);
            assert!((got_m - expected_m).abs() < 1e-4, "{got_m} for {expected_m} m");
            assert!(
                (got_m - gripper.clearance_m).abs() < 1e-4 || (got_m > gripper.clearance_m) == world.is_reached(&pose)
            );
        }
    }

    #[test]
    fn a_block_that_is_touched_by_little_is_pushed_aside_by_as_little() {
        let (gripper, procedure) = (parallel_jaw(), Procedure::PAPER);
        let world = FloatingWorld::new(&Physics::STANDARD, &gripper, &procedure, &block(), 0.1, 1.0);
        // The finger is 1.3 mm in the block, and is to be 1 mm beside it: a step short of 2.3 mm is 2 mm.
        for (side, turn) in [(1.0, 0.0), (-1.0, 0.0), (1.0, PI), (-1.0, PI)] {
            let at_m = Vec3::new(0.0, side * 0.0213, 0.015);
            let grasp = Pose::from_parts(at_m, axis_angle(Vec3::Z, turn));
            assert_eq!(world.close(&grasp).map_err(|end| end.outcome).err(), Some(Outcome::ApproachCollision));
            assert!(world.pushed_aside(&grasp, 0.002).is_none() && world.pushed_aside(&grasp, 0.0).is_none());
            let (aside, pushed_m) = world.pushed_aside(&grasp, 0.003).unwrap();
            assert_eq!(pushed_m, 0.0025);
            let expected_m = at_m - Vec3::Y * (side * 0.0025);
            assert!((aside.translation - expected_m).length() < 1e-6, "{} {side} {turn}", aside.translation);
            assert!(world.close(&aside).is_ok_and(|grip| (grip.width_m() - 0.04).abs() < 1e-3));
        }
        // A palm that is 0.7 mm in the block stops 1 mm before it: the block goes on before it.
        let (aside, pushed_m) = world.pushed_aside(&Pose::from_translation(Vec3::Z * 0.0407), 0.003).unwrap();
        assert!((aside.translation.z - 0.0387).abs() < 1e-6 && pushed_m == 0.002, "{aside:?} {pushed_m}");
    }
}
