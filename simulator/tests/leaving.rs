//! The scene after an attempt, and how it comes to rest again.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

use schema::{Engine, Grid, Gripper, Outcome, Pose, Procedure, ShapeKind, Solid, Vec3, axis_angle};
use simulator::{AttemptWorld, Physics, Scene, SceneObject, SettleParams, Unsettled, settle_again};

fn gripper() -> Gripper {
    Gripper::from_toml(include_str!("../../configs/grippers/parallel_jaw_80.toml")).unwrap()
}

/// A block, turned about z.
fn block(extents: [f32; 3], at: [f32; 3], yaw_rad: f32, friction: f32) -> SceneObject {
    SceneObject {
        body: Solid::new(ShapeKind::Cuboid, Vec3::from_array(extents)).unwrap().into(),
        mass_kg: 0.1,
        friction,
        workspace_from_object: Pose::from_parts(Vec3::from_array(at), axis_angle(Vec3::Z, yaw_rad)),
    }
}

/// A rotated target off the centre, and a bystander out of reach.
fn scene(friction: f32) -> Scene {
    let target = block([0.04, 0.04, 0.05], [0.11, 0.19, 0.075], 0.6, friction);
    let bystander = block([0.03, 0.05, 0.04], [0.23, 0.08, 0.07], -0.4, 1.0);
    Scene { table_z_m: 0.05, fixtures: Vec::new(), objects: vec![target, bystander] }
}

/// A grasp of the target from above, leaning by `lean_rad`, its tips at `tip_z_m`.
fn grasp(lean_rad: f32, tip_z_m: f32) -> Pose {
    let down = axis_angle(Vec3::Z, 0.6) * axis_angle(Vec3::X, core::f32::consts::PI);
    Pose::from_parts(Vec3::new(0.11, 0.19, tip_z_m), down * axis_angle(Vec3::Y, lean_rad))
}

fn distance_m(a: &Pose, b: &Pose) -> f32 {
    (a.translation - b.translation).length()
}

fn turn(a: &Pose, b: &Pose) -> f32 {
    1.0 - a.rotation.dot(b.rotation).abs()
}

/// The outcome and the poses by the stepper; rapier's must be near.
fn leave(physics: &Physics, scene: &Scene, grasp: &Pose) -> (Outcome, Vec<Pose>) {
    let [ours, rapiers] = Engine::ALL.map(|engine| leave_by(&Physics { engine, ..*physics }, scene, grasp));
    assert_eq!(ours.0, rapiers.0);
    for (a, b) in ours.1.iter().zip(&rapiers.1) {
        assert!(distance_m(a, b) < 0.005 && turn(a, b) < 0.001, "{a:?} {b:?}");
    }
    ours
}

fn leave_by(physics: &Physics, scene: &Scene, grasp: &Pose) -> (Outcome, Vec<Pose>) {
    let gripper = gripper();
    let world = AttemptWorld::new(physics, &gripper, &Procedure::PAPER, scene);
    let (execution, poses) = world.execute_leaving(grasp, 0);
    assert_eq!(execution.outcome, world.execute(grasp, 0).outcome);
    if !physics.shortcuts {
        assert_eq!(execution, world.execute(grasp, 0), "without shortcuts the two are the same attempt");
    }
    (execution.outcome, poses)
}

#[test]
fn a_gripper_that_the_gate_stops_leaves_the_scene_as_it_was() {
    let scene = scene(1.0);
    let (outcome, poses) = leave(&Physics::FAITHFUL, &scene, &grasp(0.0, 0.045));
    assert_eq!(outcome, Outcome::ApproachCollision);
    let before: Vec<Pose> = scene.objects.iter().map(|o| o.workspace_from_object).collect();
    assert_eq!(poses, before);
}

/// The table is touched at the clearance, 1 mm; a gripper that leans comes as far along its own way.
#[test]
fn a_gripper_that_halts_at_the_first_touch_closes_there() {
    let (scene, gripper) = (scene(1.0), gripper());
    let world = AttemptWorld::new(&Physics::FAITHFUL, &gripper, &Procedure::PAPER, &scene);
    let halted = world.halted(&grasp(0.0, 0.045)).unwrap();
    assert!(distance_m(&halted, &grasp(0.0, 0.051)) < 1e-4, "{halted:?}");
    let (execution, poses) = world.close_and_lift(&halted, 0);
    assert_eq!(execution.outcome, Outcome::Held);
    assert!(poses[0].translation.z > 0.15);

    for lean_rad in [0.0, 0.3] {
        let free = grasp(lean_rad, 0.075);
        assert!(distance_m(&world.halted(&free).unwrap(), &free) < 1e-6, "nothing is in the way");
        assert_eq!(world.halted(&grasp(lean_rad, -0.02)), None, "the pre-grasp is in the table");
    }
}

#[test]
fn what_is_held_hangs_where_the_gripper_went_and_the_rest_stands_where_it_stood() {
    let scene = scene(1.0);
    for physics in [Physics::FAITHFUL, Physics::STANDARD] {
        for lean_rad in [0.0, 0.2] {
            let grasp = grasp(lean_rad, 0.07);
            let (outcome, poses) = leave(&physics, &scene, &grasp);
            assert_eq!(outcome, Outcome::Held, "lean {lean_rad}");
            let [target, bystander] = [0, 1].map(|id| scene.objects[id].workspace_from_object);
            let mut lifted = target;
            lifted.translation += grasp.rotation * Vec3::new(0.0, 0.0, -0.1);
            let [off_m, turned] = [distance_m(&poses[0], &lifted), turn(&poses[0], &lifted)];
            assert!(off_m < 0.003 && turned < 1e-3, "lean {lean_rad}: {off_m} m, {turned}");
            assert!(distance_m(&poses[1], &bystander) < 5e-4 && turn(&poses[1], &bystander) < 1e-5, "{:?}", poses[1]);
        }
    }
}

#[test]
fn what_slips_stays_on_the_table() {
    let scene = scene(0.0);
    let (outcome, poses) = leave(&Physics::FAITHFUL, &scene, &grasp(0.0, 0.07));
    assert_eq!(outcome, Outcome::Slipped);
    assert!(distance_m(&poses[0], &scene.objects[0].workspace_from_object) < 0.02, "{:?}", poses[0]);
}

#[test]
fn a_held_object_that_is_let_go_falls_and_the_others_stay() {
    let scene = scene(1.0);
    let (_, poses) = leave(&Physics::FAITHFUL, &scene, &grasp(0.0, 0.07));
    let left: Vec<SceneObject> = scene
        .objects
        .iter()
        .zip(&poses)
        .map(|(o, pose)| SceneObject { workspace_from_object: *pose, ..o.clone() })
        .collect();
    let settled = settle_again(&Physics::FAITHFUL, &SettleParams::STANDARD, &Grid::PAPER, &[], &left).unwrap();
    // 0.1 m take 0.14 s, and then it rests for a tenth of a second.
    assert!(settled.settle_time_s > 0.24 && settled.settle_time_s < 2.0, "{} s", settled.settle_time_s);
    let [fallen, bystander] = [0, 1].map(|id| settled.scene.objects[id].workspace_from_object);
    assert!(distance_m(&fallen, &scene.objects[0].workspace_from_object) < 0.01, "{fallen:?}");
    assert!(distance_m(&bystander, &scene.objects[1].workspace_from_object) < 5e-4, "{bystander:?}");
}

#[test]
fn what_rests_outside_is_left_out_and_an_empty_scene_is_a_scene() {
    let again = |objects: &[SceneObject]| {
        settle_again(&Physics::FAITHFUL, &SettleParams::STANDARD, &Grid::PAPER, &[], objects).unwrap()
    };
    let inside = block([0.04, 0.04, 0.04], [0.15, 0.15, 0.07], 0.0, 1.0);
    let outside = block([0.04, 0.04, 0.04], [0.35, 0.15, 0.07], 0.0, 1.0);
    let kept = again(&[outside.clone(), inside.clone()]).scene.objects;
    assert_eq!(kept.len(), 1);
    assert!(distance_m(&kept[0].workspace_from_object, &inside.workspace_from_object) < 5e-4, "{kept:?}");
    assert!(again(&[outside]).scene.objects.is_empty());
    let nothing = again(&[]);
    assert!(nothing.scene.objects.is_empty() && nothing.settle_time_s < 1e-6);
}

#[test]
fn what_lay_on_something_that_is_left_out_comes_to_rest_once_more() {
    // The block's centre is 5 mm outside, that of the plate on it 10 mm inside.
    let outside = block([0.06, 0.06, 0.06], [-0.005, 0.15, 0.08], 0.0, 1.0);
    let plate = block([0.04, 0.04, 0.01], [0.01, 0.15, 0.115], 0.0, 1.0);
    let kept = settle_again(&Physics::FAITHFUL, &SettleParams::STANDARD, &Grid::PAPER, &[], &[outside, plate])
        .unwrap()
        .scene
        .objects;
    assert_eq!(kept.len(), 1);
    let z_m = kept[0].workspace_from_object.translation.z;
    assert!((z_m - 0.055).abs() < 0.001, "the plate is at {z_m} m");
}

#[test]
fn a_pose_that_is_none_is_unstable() {
    for at in [[f32::NAN, 0.15, 0.07], [0.15, 0.15, 0.02], [5.0, 0.15, 0.07]] {
        let lost = block([0.04, 0.04, 0.04], at, 0.0, 1.0);
        let end = settle_again(&Physics::FAITHFUL, &SettleParams::STANDARD, &Grid::PAPER, &[], &[lost]);
        assert_eq!(end, Err(Unsettled::Unstable), "{at:?}");
    }
}
