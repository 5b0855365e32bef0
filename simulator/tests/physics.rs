//! The physics must hold objects: expectations for a gripper, a block and a table.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

use schema::{Engine, Grid, Gripper, Outcome, Pose, Procedure, ShapeKind, Solid, Vec3, axis_angle};
use simulator::{AttemptWorld, Execution, Physics, Scene, SceneObject, SettleParams, settle};

const PI: f32 = core::f32::consts::PI;
fn gripper() -> Gripper {
    Gripper::from_toml(include_str!("../../configs/grippers/parallel_jaw_80.toml")).unwrap()
}

fn object(kind: ShapeKind, extents_m: [f32; 3], mass_kg: f32, friction: f32) -> SceneObject {
    let solid = Solid::new(kind, Vec3::from_array(extents_m)).unwrap();
    let at = Vec3::new(0.15, 0.15, 0.05 + 0.5 * extents_m[2] + 0.0005);
    SceneObject {
        body: solid.into(),
        mass_kg,
        friction,
        workspace_from_object: Pose::from_parts(at, axis_angle(Vec3::Z, 0.0)),
    }
}

fn at_rest(drop: SceneObject) -> Scene {
    settle(&Physics::FAITHFUL, &SettleParams::STANDARD, &Grid::PAPER, &[], &[drop])
        .expect("the object comes to rest")
        .scene
}

/// A grasp from straight above, finger tips at `tip_z_m`, closing along y.
fn from_above(tip_z_m: f32) -> Pose {
    Pose::from_parts(Vec3::new(0.15, 0.15, tip_z_m), axis_angle(Vec3::X, PI))
}

fn attempt(drop: SceneObject, grasp: Pose, procedure: &Procedure) -> Execution {
    both(&at_rest(drop), &grasp, procedure)
}

/// An attempt on the first object, by either engine, with everything simulated and with shortcuts: all must end the
/// same.
fn both(scene: &Scene, grasp: &Pose, procedure: &Procedure) -> Execution {
    let [ours, rapier] = Engine::ALL.map(|engine| by(engine, scene, grasp, procedure));
    assert_eq!((ours.outcome, ours.hit), (rapier.outcome, rapier.hit), "{ours:?} {rapier:?}");
    ours
}

fn by(engine: Engine, scene: &Scene, grasp: &Pose, procedure: &Procedure) -> Execution {
    let gripper = gripper();
    let [slow, quick] = [Physics::FAITHFUL, Physics::STANDARD]
        .map(|physics| AttemptWorld::new(&Physics { engine, ..physics }, &gripper, procedure, scene).execute(grasp, 0));
    assert_eq!((slow.outcome, slow.hit), (quick.outcome, quick.hit), "{slow:?} {quick:?}");
    let width = |end: Execution| end.width_m.unwrap_or(0.0);
    assert!((width(slow) - width(quick)).abs() < 3e-4, "{slow:?} {quick:?}");
    assert!(quick.outcome != Outcome::Held || quick.steps < slow.steps, "{slow:?} {quick:?}");
    quick
}

#[test]
fn a_gripped_block_is_lifted_and_stays_for_two_seconds() {
    let procedure = Procedure { hold_time_s: 2.0, ..Procedure::PAPER };
    for mass_kg in [0.02, 0.2, 0.5] {
        let end = attempt(object(ShapeKind::Cuboid, [0.04, 0.04, 0.05], mass_kg, 1.0), from_above(0.07), &procedure);
        assert_eq!(end.outcome, Outcome::Held, "{mass_kg} kg");
        let width = end.width_m.unwrap();
        assert!((width - 0.04).abs() < 0.001, "{mass_kg} kg: the fingers stand {width} m apart");
    }
}

#[test]
fn every_shape_is_held_by_a_good_grasp() {
    for (kind, extents, tip_z) in [
        (ShapeKind::Cuboid, [0.05, 0.03, 0.05], 0.07),
        (ShapeKind::Cylinder, [0.04, 0.04, 0.06], 0.08),
        // The prism's ends are flat and upright only across x: turn the gripper by closing along the extrusion.
        (ShapeKind::HalfCylinder, [0.05, 0.06, 0.03], 0.06),
        (ShapeKind::TriPrism, [0.05, 0.06, 0.05], 0.07),
    ] {
        let closing_along_x = matches!(kind, ShapeKind::HalfCylinder | ShapeKind::TriPrism);
        let turn = axis_angle(Vec3::Z, if closing_along_x { PI / 2.0 } else { 0.0 });
        let mut grasp = from_above(tip_z);
        grasp.rotation = turn * grasp.rotation;
        let end = attempt(object(kind, extents, 0.1, 1.0), grasp, &Procedure::PAPER);
        assert_eq!(end.outcome, Outcome::Held, "{kind:?}: {end:?}");
    }
}

/// The side edge of a finger on a standing cylinder touches along a line. With a contact at one end of it only, the
/// cylinder swings about that point and out of the jaws.
#[test]
fn a_cylinder_is_held_between_the_edges_of_the_fingers() {
    for offset_m in [0.011, 0.012, 0.013, 0.014] {
        let mut grasp = from_above(0.07);
        grasp.translation.x += offset_m;
        // Leaning back, so that the weight pulls about the line of contact.
        grasp.rotation = axis_angle(Vec3::Y, 0.16) * grasp.rotation;
        let cylinder = object(ShapeKind::Cylinder, [0.0385, 0.0385, 0.0585], 0.05, 1.0);
        let end = attempt(cylinder, grasp, &Procedure::PAPER);
        assert_eq!(end.outcome, Outcome::Held, "{offset_m} m: {end:?}");
    }
}

#[test]
fn a_frictionless_block_slips() {
    let end = attempt(object(ShapeKind::Cuboid, [0.04, 0.04, 0.05], 0.2, 0.0), from_above(0.07), &Procedure::PAPER);
    assert_eq!(end.outcome, Outcome::Slipped);
}

#[test]
fn a_block_is_held_as_coulomb_says_and_no_longer() {
    // Two fingers of 20 N hold m g = 2 µ F: with µ = 0.1, 0.408 kg.
    for (mass_kg, expected) in [(0.30, Outcome::Held), (0.55, Outcome::Slipped)] {
        let procedure = Procedure { hold_time_s: 0.5, ..Procedure::PAPER };
        let end = attempt(object(ShapeKind::Cuboid, [0.04, 0.04, 0.05], mass_kg, 0.1), from_above(0.07), &procedure);
        assert_eq!(end.outcome, expected, "{mass_kg} kg");
    }
}

#[test]
fn a_block_wider_than_the_opening_collides() {
    let end = attempt(object(ShapeKind::Cuboid, [0.04, 0.082, 0.05], 0.2, 1.0), from_above(0.07), &Procedure::PAPER);
    assert_eq!(end.outcome, Outcome::ApproachCollision);
    assert_eq!(end.hit.unwrap().kind, schema::HitKind::Target);
}

#[test]
fn a_gripper_in_the_table_collides_and_a_gripper_beside_the_object_closes_on_nothing() {
    let block = || object(ShapeKind::Cuboid, [0.04, 0.04, 0.05], 0.2, 1.0);
    let flat = object(ShapeKind::Cuboid, [0.04, 0.04, 0.03], 0.2, 1.0);
    let end = attempt(flat, from_above(0.045), &Procedure::PAPER);
    assert_eq!((end.outcome, end.hit.unwrap().kind), (Outcome::ApproachCollision, schema::HitKind::Table));
    let mut beside = from_above(0.07);
    beside.translation.x += 0.08;
    assert_eq!(attempt(block(), beside, &Procedure::PAPER).outcome, Outcome::Empty);
}

#[test]
fn a_box_on_the_table_rests_without_creeping() {
    let drop = object(ShapeKind::Cuboid, [0.05, 0.05, 0.05], 0.2, 1.0);
    let start = drop.workspace_from_object.translation;
    let patient = SettleParams { rest_time_s: 5.0, time_s_max: 8.0, ..SettleParams::STANDARD };
    let rested = settle(&Physics::FAITHFUL, &patient, &Grid::PAPER, &[], &[drop]).unwrap().scene;
    let end = rested.objects[0].workspace_from_object.translation;
    assert!((end - start).truncate().length() < 1e-4, "crept from {start} to {end}");
    assert!((end.z - 0.075).abs() < 0.001, "stands at {end}");
}

#[test]
fn thin_and_light_objects_do_not_explode() {
    for (extents, mass_kg) in [([0.08, 0.08, 0.004], 0.02), ([0.01, 0.01, 0.10], 0.02), ([0.02, 0.02, 0.02], 0.005)] {
        let mut drop = object(ShapeKind::Cuboid, extents, mass_kg, 1.0);
        drop.workspace_from_object = Pose::from_parts(Vec3::new(0.15, 0.15, 0.25), axis_angle(Vec3::X, 0.7));
        let scene = at_rest(drop);
        let pose = scene.objects[0].workspace_from_object;
        assert!((pose.translation.truncate() - Vec3::splat(0.15).truncate()).length() < 0.14, "{extents:?}: {pose:?}");
        assert!(pose.translation.z < 0.05 + 0.5 * Vec3::from_array(extents).length(), "{extents:?}: {pose:?}");
    }
}

#[test]
fn the_same_attempt_ends_the_same_to_the_bit() {
    let run =
        || attempt(object(ShapeKind::Cylinder, [0.04, 0.04, 0.06], 0.1, 1.0), from_above(0.08), &Procedure::PAPER);
    assert_eq!(run(), run());
}

#[test]
fn what_lies_on_top_of_the_target_and_rides_along_is_hit_other() {
    let below = object(ShapeKind::Cuboid, [0.04, 0.04, 0.06], 0.2, 1.0);
    // A plate on top, wide across x, narrow across y so that the fingers pass.
    let solid = Solid::new(ShapeKind::Cuboid, Vec3::new(0.04, 0.03, 0.01)).unwrap();
    let scene = Scene {
        table_z_m: 0.05,
        fixtures: Vec::new(),
        objects: vec![
            SceneObject {
                body: below.body,
                mass_kg: below.mass_kg,
                friction: 1.0,
                workspace_from_object: Pose::from_parts(Vec3::new(0.15, 0.15, 0.08), axis_angle(Vec3::Z, 0.0)),
            },
            SceneObject {
                body: solid.into(),
                mass_kg: 0.03,
                friction: 1.0,
                workspace_from_object: Pose::from_parts(Vec3::new(0.15, 0.15, 0.115), axis_angle(Vec3::Z, 0.0)),
            },
        ],
    };
    let end = both(&scene, &from_above(0.085), &Procedure::PAPER);
    assert_eq!(end.outcome, Outcome::HitOther, "{end:?}");
    assert_eq!(end.hit.unwrap().object_id, Some(1));
}

/// A plank on two posts above a block, which is grasped from the side and lifted straight up into the plank.
#[test]
fn what_lies_ahead_of_the_lift_is_not_skipped() {
    let resting = |extents: [f32; 3], mass_kg: f32, at: [f32; 3]| SceneObject {
        body: Solid::new(ShapeKind::Cuboid, Vec3::from_array(extents)).unwrap().into(),
        mass_kg,
        friction: 1.0,
        workspace_from_object: Pose::from_parts(Vec3::from_array(at), axis_angle(Vec3::Z, 0.0)),
    };
    let block = resting([0.04, 0.04, 0.04], 0.1, [0.15, 0.15, 0.07]);
    let posts = [0.05, 0.25].map(|x| resting([0.03, 0.03, 0.10], 0.2, [x, 0.15, 0.10]));
    let plank = |z_m: f32| resting([0.24, 0.03, 0.01], 0.1, [0.15, 0.15, z_m]);
    // Forward along y, closing along x, the gripper's x upwards.
    let sideways = axis_angle(Vec3::ONE.normalize(), -2.0 * PI / 3.0);
    let grasp = Pose::from_parts(Vec3::new(0.15, 0.16, 0.072), sideways);
    let [left, right] = posts;
    let under =
        Scene { table_z_m: 0.05, fixtures: Vec::new(), objects: vec![block.clone(), left, right, plank(0.155)] };
    let end = both(&under, &grasp, &Procedure::PAPER);
    assert_eq!((end.outcome, end.hit.unwrap().object_id), (Outcome::HitOther, Some(3)), "{end:?}");
    let free = Scene { table_z_m: 0.05, fixtures: Vec::new(), objects: vec![block] };
    assert_eq!(both(&free, &grasp, &Procedure::PAPER).outcome, Outcome::Held);
}
