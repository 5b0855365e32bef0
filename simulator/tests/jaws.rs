//! Jaws that move each in its own way, against closed forms.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

use schema::{Engine, Gripper, Outcome, Physics, Pose, Procedure, Quat, ShapeKind, Solid, Vec3, axis_angle};
use simulator::{AttemptWorld, Body, FloatingWorld, Grip, Hold, Load, Scene, SceneObject};

const FAITHFUL: Physics = Physics { engine: Engine::Stepper, solver_iterations: 8, ..Physics::FAITHFUL };
const TIGHT: Hold = Hold { moved_m_max: 0.002, turned_rad_max: 0.1 };

/// The left jaw stays, the right one slides.
const ONE_SLIDES: &str = "jaws = [{}, { slide_m = [0.0, -0.08, 0.0] }]";
/// The left jaw stays; the right one turns about x, 100 mm behind the tips and halfway between them. Its face goes
/// through that axis and is parallel to the left jaw when half of the turn is done; then they are 40 mm apart.
const ONE_TURNS: &str = "jaws = [{}, { turn_rad = [0.761, 0.0, 0.0], pivot_m = [0.0, 0.0, -0.1], boxes_at = 0.5, \
    boxes = [{ centre_m = [0.0, 0.005, -0.02], size_m = [0.02, 0.01, 0.0554] }] }]";
/// From that axis to the tip, in metres.
const LEVER_M: f32 = 0.1077;
/// Both tips go 50 mm forward and inwards on arcs of 80 mm, and stay parallel.
const ON_ARCS: &str = "jaws = [{ turn_rad = [-0.52, 0.0, 0.0], pivot_m = [0.0, 0.0, -0.0693], keeps_parallel = true }, \
    { turn_rad = [0.52, 0.0, 0.0], pivot_m = [0.0, 0.0, -0.0693], keeps_parallel = true }]";

fn gripper(jaws: &str) -> Gripper {
    let text = include_str!("../../configs/grippers/parallel_jaw_80.toml");
    Gripper::from_toml(&format!("{text}\n{jaws}")).unwrap()
}

fn cuboid(extents_m: [f32; 3]) -> Body {
    Solid::new(ShapeKind::Cuboid, Vec3::from_array(extents_m)).unwrap().into()
}

fn bears(grip: &Grip<'_>, acceleration_m_s2: Vec3) -> bool {
    grip.bear(&Load::Pull { acceleration_m_s2, time_s: 0.5 }, &TIGHT, 1.0).is_held
}

/// The largest pull along a direction that a grip bears, between two that it bears and does not, in m/s².
fn most(grip: &Grip<'_>, along: Vec3, [mut low, mut high]: [f32; 2]) -> f32 {
    assert!(bears(grip, along * low) && !bears(grip, along * high), "{low} to {high} along {along}");
    for _ in 0..12 {
        let middle = 0.5 * (low + high);
        *if bears(grip, along * middle) { &mut low } else { &mut high } = middle;
    }
    low
}

/// A fixed jaw answers with the force of the other: 2 μ F = m a across, as between two jaws that slide, and F = m a
/// away from it. The object is pushed towards it.
#[test]
fn a_fixed_jaw_holds_what_two_that_slide_hold() {
    let (procedure, mass_kg, friction) = (Procedure::PAPER, 0.7, 0.6);
    let block = cuboid([0.04, 0.04, 0.02]);
    for (jaws, aside_m, pushed_m) in [("", 0.0, 0.0), (ONE_SLIDES, 0.018, 0.002)] {
        for physics in [FAITHFUL, Physics { engine: Engine::Stepper, ..Physics::STANDARD }] {
            let gripper = gripper(jaws);
            let world = FloatingWorld::new(&physics, &gripper, &procedure, &block, mass_kg, friction);
            let grip = world.close(&Pose::from_translation(Vec3::new(0.0, aside_m, 0.015))).ok().unwrap();
            let moved_m = grip.closing().moved_m;
            assert!((grip.width_m() - 0.04).abs() < 5e-4 && (moved_m - pushed_m).abs() < 5e-4, "{moved_m} m: {jaws}");
            let force_n = 2.0 * gripper.friction * friction * gripper.finger_force_n;
            let mut directions = [Vec3::X, -Vec3::X, Vec3::Z, -Vec3::Z].map(|along| (along, force_n)).to_vec();
            if !jaws.is_empty() {
                directions.push((Vec3::Y, gripper.finger_force_n));
                assert!(bears(&grip, -Vec3::Y * 3.0 * force_n / mass_kg), "the fixed jaw yields to nothing");
            }
            for (along, force_n) in directions {
                let expected = force_n / mass_kg;
                let got = most(&grip, along, [0.2 * expected, 3.0 * expected]);
                assert!((got / expected - 1.0).abs() < 0.05, "{got} of {expected} m/s² along {along}: {jaws}");
            }
        }
    }
}

/// A jaw sinks into a face by its depth where it presses with its force.
#[test]
fn jaws_sink_in_as_springs_do() {
    let (gripper, procedure) = (gripper(ONE_SLIDES), Procedure::PAPER);
    for depth_m in [0.000_1, 0.001] {
        let physics = Physics { finger_depth_m_max: depth_m, ..FAITHFUL };
        let block = cuboid([0.04, 0.04, 0.02]);
        let world = FloatingWorld::new(&physics, &gripper, &procedure, &block, 0.3, 0.6);
        let grip = world.close(&Pose::from_translation(Vec3::new(0.0, 0.018, 0.005))).ok().unwrap();
        let sunk_m = 0.04 - grip.width_m();
        assert!((sunk_m - 2.0 * depth_m).abs() < 0.05 * depth_m, "{sunk_m} of {depth_m} a side");
    }
}

/// A block that is wider than the jaws are parallel, gripped by one corner and an edge: its face is pressed on at
/// several points, and friction at them bears the moment of its weight, 0.5 N at 15 mm.
#[test]
fn what_is_gripped_by_a_corner_does_not_swing() {
    let gripper = Gripper { closing_speed_m_s: 0.1, ..gripper(ONE_TURNS) };
    let (procedure, block) = (Procedure::PAPER, cuboid([0.022_192, 0.059_840, 0.035_687]));
    let grasp = Pose::from_parts(
        Vec3::new(-0.002_26, -0.006_82, 0.007_035),
        Quat::from_xyzw(0.993_187, 0.013_838, -0.115_709, 0.000_166).normalize(),
    );
    for physics in [Physics { finger_depth_m_max: 0.000_05, ..Physics::STANDARD }, FAITHFUL] {
        let world = FloatingWorld::new(&physics, &gripper, &procedure, &block, 0.05, 0.8);
        let grip = world.close(&grasp).ok().unwrap();
        for along in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().flat_map(|axis| [axis, -axis]) {
            assert!(bears(&grip, along * 9.81), "{along}: {:?}", grip.closing());
        }
    }
}

/// The drive's force is at the tip: N l = F L at a block that is held at l from the axis, and 2 μ N = m a.
#[test]
fn a_jaw_that_turns_presses_by_its_lever() {
    let (gripper, procedure, mass_kg, friction) = (gripper(ONE_TURNS), Procedure::PAPER, 0.7, 0.6);
    let block = cuboid([0.04, 0.04, 0.008]);
    for behind_m in [0.01, 0.035] {
        // The block begins 1.5 mm beside the fixed jaw, and ends there.
        let grasp = Pose::from_translation(Vec3::new(0.0, 0.0185, behind_m));
        let world = FloatingWorld::new(&FAITHFUL, &gripper, &procedure, &block, mass_kg, friction);
        let grip = world.close(&grasp).ok().unwrap();
        assert!((grip.width_m() - 0.04).abs() < 1e-3 && grip.closing().turned_rad < 0.02, "{}", grip.width_m());
        let press_n = gripper.finger_force_n * LEVER_M / (0.1 - behind_m);
        let expected = 2.0 * gripper.friction * friction * press_n / mass_kg;
        // The force may be at either end of the block.
        let unsure = 0.005 / (0.1 - behind_m) + 0.03;
        let got = most(&grip, Vec3::X, [0.2 * expected, 3.0 * expected]);
        assert!((got / expected - 1.0).abs() < unsure, "{got} of {expected} m/s² at {behind_m} m");
    }
}

/// Between faces at an angle β an object stays if β is less than twice the angle of friction, and is pressed out
/// otherwise: the forces of two contacts are on one line.
#[test]
fn a_jaw_that_turns_presses_out_what_is_too_wide_for_its_friction() {
    let (gripper, procedure) = (gripper(ONE_TURNS), Procedure::PAPER);
    // Its corner is 30 mm behind the tips, 20 mm beyond the plane of the axis.
    let (block, grasp) = (cuboid([0.03, 0.06, 0.02]), Pose::from_translation(Vec3::new(0.0, 0.0085, 0.02)));
    let limit = libm::tanf(0.5 * libm::atan2f(0.02, 0.07));
    for (friction, stays) in [(1.7 * limit, true), (0.6 * limit, false)] {
        let world = FloatingWorld::new(&FAITHFUL, &gripper, &procedure, &block, 0.3, friction);
        let grip = world.close(&grasp).ok();
        let is_held = grip.as_ref().is_some_and(|grip| bears(grip, Vec3::X * 0.5) && grip.closing().moved_m < 0.01);
        assert_eq!(is_held, stays, "{friction}: {:?}", grip.map(|grip| (grip.closing(), grip.width_m())));
    }
}

/// A tip on an arc drives along its tangent: across it the jaw is stiff, so at θ from y it presses with F / cos θ.
#[test]
fn tips_on_arcs_go_forward_and_press_along_their_tangents() {
    let (gripper, procedure, mass_kg, friction) = (gripper(ON_ARCS), Procedure::PAPER, 0.7, 0.6);
    let block = cuboid([0.03, 0.06, 0.02]);
    let world = FloatingWorld::new(&FAITHFUL, &gripper, &procedure, &block, mass_kg, friction);
    let grip = world.close(&Pose::from_translation(Vec3::new(0.0, 0.0, 0.005))).ok().unwrap();
    assert!((grip.width_m() - 0.06).abs() < 1e-3 && grip.closing().turned_rad < 0.02, "{}", grip.width_m());
    let slope = libm::asinf(0.03 / 0.08);
    let expected = 2.0 * gripper.friction * friction * gripper.finger_force_n / libm::cosf(slope) / mass_kg;
    let got = most(&grip, Vec3::X, [0.2 * expected, 3.0 * expected]);
    assert!((got / expected - 1.0).abs() < 0.06, "{got} of {expected} m/s²");
}

/// On a table, from above, with shortcuts and without.
#[test]
fn jaws_of_all_kinds_lift_a_block_that_is_beside_the_fixed_one() {
    let target = SceneObject {
        body: cuboid([0.03, 0.04, 0.05]),
        mass_kg: 0.1,
        friction: 1.0,
        workspace_from_object: Pose::from_translation(Vec3::new(0.15, 0.15, 0.075)),
    };
    let scene = Scene { table_z_m: 0.05, fixtures: Vec::new(), objects: vec![target] };
    let down = axis_angle(Vec3::X, core::f32::consts::PI);
    // Seen from the gripper the workspace's −y is +y: its left jaw is at the block's far side.
    for (jaws, aside_m) in [("", 0.0), (ONE_SLIDES, 0.0), (ONE_SLIDES, -0.018), (ONE_TURNS, -0.018), (ON_ARCS, 0.0)] {
        for physics in [Physics { engine: Engine::Stepper, ..Physics::STANDARD }, FAITHFUL] {
            let (gripper, procedure) = (gripper(jaws), Procedure::PAPER);
            let world = AttemptWorld::new(&physics, &gripper, &procedure, &scene);
            let execution = world.execute(&Pose::from_parts(Vec3::new(0.15, 0.15 + aside_m, 0.07), down), 0);
            assert_eq!(execution.outcome, Outcome::Held, "{jaws} {aside_m}");
            assert!((execution.width_m.unwrap() - 0.04).abs() < 2e-3, "{execution:?} {jaws}");
            // Its face is 20 mm beside the block where that is in the gripper's middle, and is to be 3 mm.
            let middle = Pose::from_parts(Vec3::new(0.15, 0.15, 0.07), down);
            let aside_m = world.beside_fixed_jaw(&middle, 0).translation - middle.translation;
            let expected_m = if gripper.fixed_side().is_some() { -0.017 } else { 0.0 };
            assert!((aside_m - Vec3::Y * expected_m).length() < 1e-5, "{aside_m} {jaws}");
            let beside = Pose::from_parts(Vec3::new(0.15, 0.25, 0.1), down);
            assert_eq!(world.execute(&beside, 0).outcome, if jaws.is_empty() { Outcome::Empty } else { empty(jaws) });
        }
    }
}

/// A jaw that goes the whole way alone needs more time than the procedure has.
fn empty(jaws: &str) -> Outcome {
    if jaws == ON_ARCS { Outcome::Empty } else { Outcome::Slipped }
}
