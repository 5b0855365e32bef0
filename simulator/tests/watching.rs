//! A watched attempt ends like an unwatched one, and the watcher sees what happens.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

use schema::{Engine, Gripper, Outcome, Pose, Procedure, ShapeKind, Solid, Vec3, axis_angle};
use simulator::{AttemptEvent, AttemptWorld, Execution, Moment, Phase, Physics, Scene, SceneObject, Watcher};

fn gripper() -> Gripper {
    Gripper::from_toml(include_str!("../../configs/grippers/parallel_jaw_80.toml")).unwrap()
}

fn block(extents: [f32; 3], at: [f32; 3], mass_kg: f32, friction: f32) -> SceneObject {
    SceneObject {
        body: Solid::new(ShapeKind::Cuboid, Vec3::from_array(extents)).unwrap().into(),
        mass_kg,
        friction,
        workspace_from_object: Pose::from_translation(Vec3::from_array(at)),
    }
}

/// A target and a bystander out of reach.
fn scene(mass_kg: f32, friction: f32) -> Scene {
    let target = block([0.04, 0.04, 0.05], [0.11, 0.19, 0.075], mass_kg, friction);
    Scene {
        table_z_m: 0.05,
        fixtures: Vec::new(),
        objects: vec![target, block([0.03, 0.05, 0.04], [0.23, 0.08, 0.07], 0.1, 1.0)],
    }
}

/// A grasp from above.
fn grasp(x_m: f32, tip_z_m: f32) -> Pose {
    Pose::from_parts(Vec3::new(x_m, 0.19, tip_z_m), axis_angle(Vec3::X, core::f32::consts::PI))
}

#[derive(Default)]
struct Notes {
    phases: Vec<Phase>,
    steps: Vec<usize>,
    events: Vec<AttemptEvent>,
    last_target: Option<Pose>,
}

impl Watcher for Notes {
    fn step(&mut self, moment: &Moment<'_>) {
        self.phases.push(moment.phase);
        self.steps.push(moment.steps);
        self.last_target = Some(moment.objects()[0]);
    }

    fn event(&mut self, event: AttemptEvent, _moment: Option<&Moment<'_>>) {
        self.events.push(event);
    }
}

fn watched(physics: &Physics, scene: &Scene, grasp: &Pose) -> (Execution, Notes) {
    let gripper = gripper();
    let world = AttemptWorld::new(physics, &gripper, &Procedure::PAPER, scene);
    let mut notes = Notes::default();
    let seen = world.execute_watched(grasp, 0, Some(&mut notes));
    assert_eq!(seen, world.execute(grasp, 0), "watching must change nothing");
    assert_eq!(seen.width_m.map(f32::to_bits), world.execute(grasp, 0).width_m.map(f32::to_bits));
    assert!(notes.steps.windows(2).all(|pair| pair[1] == pair[0] + 1), "every step is shown once");
    assert_eq!(notes.phases.iter().filter(|phase| **phase != Phase::After).count(), seen.steps);
    let is_decided = |event: &&AttemptEvent| matches!(event, AttemptEvent::Decided(_));
    assert_eq!(notes.events.iter().filter(is_decided).count(), 1);
    assert_eq!(notes.events.last(), Some(&AttemptEvent::Decided(seen)));
    (seen, notes)
}

#[test]
fn a_shortcut_s_end_is_told_and_the_rest_is_shown() {
    for engine in Engine::ALL {
        let (execution, notes) =
            watched(&Physics { engine, ..Physics::STANDARD }, &scene(0.1, 1.0), &grasp(0.11, 0.075));
        assert_eq!(execution.outcome, Outcome::Held);
        let told = |wanted: fn(&AttemptEvent) -> bool| notes.events.iter().any(wanted);
        assert!(
            told(|event| matches!(event, AttemptEvent::ClosedFreely { steps } if *steps > 10)),
            "{:?}",
            notes.events
        );
        assert!(told(|event| matches!(event, AttemptEvent::FingersStopped { .. })), "{:?}", notes.events);
        assert!(
            told(|event| matches!(event, AttemptEvent::RidesAlong { rest_m } if *rest_m > 0.0)),
            "{:?}",
            notes.events
        );
        assert!(notes.phases.contains(&Phase::After), "{:?}", notes.phases);
        let raised_m = notes.last_target.unwrap().translation.z - 0.075;
        assert!((raised_m - 0.1).abs() < 0.002, "the target is shown to the end of its way, {raised_m} m up");
    }
}

#[test]
fn what_is_simulated_to_its_end_has_nothing_after() {
    for engine in Engine::ALL {
        let (execution, notes) =
            watched(&Physics { engine, ..Physics::FAITHFUL }, &scene(0.1, 1.0), &grasp(0.11, 0.075));
        assert_eq!(execution.outcome, Outcome::Held);
        assert!(!notes.phases.contains(&Phase::After));
        for phase in [Phase::Close, Phase::Retreat, Phase::Hold] {
            assert!(notes.phases.contains(&phase), "{phase:?}");
        }
        assert!(notes.events.iter().any(|event| matches!(event, AttemptEvent::Gripped { .. })), "{:?}", notes.events);
    }
}

#[test]
fn every_way_to_lose_is_told() {
    for engine in Engine::ALL {
        let (slipped, notes) =
            watched(&Physics { engine, ..Physics::STANDARD }, &scene(8.0, 0.05), &grasp(0.11, 0.075));
        assert_eq!(slipped.outcome, Outcome::Slipped);
        let is_loss = |event: &AttemptEvent| {
            matches!(event, AttemptEvent::LeftBehind { .. } | AttemptEvent::JawsMet { .. } | AttemptEvent::NotGripped)
        };
        assert!(notes.events.iter().any(is_loss), "{:?}", notes.events);
        let (empty, notes) = watched(&Physics { engine, ..Physics::STANDARD }, &scene(0.1, 1.0), &grasp(0.11, 0.16));
        assert_eq!(empty.outcome, Outcome::Empty);
        assert!(matches!(notes.events[0], AttemptEvent::ClosedFreely { steps } if steps > 50), "{:?}", notes.events);
        let (empty, notes) = watched(&Physics { engine, ..Physics::FAITHFUL }, &scene(0.1, 1.0), &grasp(0.11, 0.16));
        assert_eq!(empty.outcome, Outcome::Empty);
        assert!(matches!(notes.events[0], AttemptEvent::JawsMet { .. }), "{:?}", notes.events);
    }
}

#[test]
fn an_obstruction_is_where_the_gripper_first_comes_too_near() {
    let gripper = gripper();
    let scene = scene(0.1, 1.0);
    let world = AttemptWorld::new(&Physics::STANDARD, &gripper, &Procedure::PAPER, &scene);
    assert_eq!(world.obstruction(&grasp(0.11, 0.075), 0), None);

    // The palm, a finger's length behind the tips, comes down on the target's top at 0.1 m, a clearance early; the
    // pre-grasp is 0.05 m up.
    let found = world.obstruction(&grasp(0.11, 0.045), 0).unwrap();
    assert_eq!(found.outcome, Outcome::ApproachCollision, "{found:?}");
    let expected_m = 0.05 - (0.1 - (0.045 + gripper.finger_length_m)) - gripper.clearance_m;
    assert!((found.travel_m - expected_m).abs() < 1e-5, "{} m, {expected_m} m", found.travel_m);

    // A finger on the target's top: off by half the opening along y, tips lower than the top.
    let off = Pose::from_parts(Vec3::new(0.11, 0.19 + 0.04, 0.08), axis_angle(Vec3::X, core::f32::consts::PI));
    let found = world.obstruction(&off, 0).unwrap();
    let executed = world.execute(&off, 0);
    assert_eq!((found.outcome, Some(found.hit)), (executed.outcome, executed.hit));
    assert_eq!(found.hit.object_id, Some(0));
    let expected_m = 0.05 - (0.1 - 0.08) - gripper.clearance_m;
    assert!((found.travel_m - expected_m).abs() < 1e-5, "{} m, {expected_m} m", found.travel_m);
}
