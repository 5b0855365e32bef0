//! Bins and shelves: objects stay in them, grippers and rays meet them, and both engines agree.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

use core::f32::consts::{FRAC_PI_2, PI};

use schema::{
    Camera, Container, ContainerKind, Engine, Grid, Gripper, HitKind, Intrinsics, Outcome, Polyhedron, Pose, Procedure,
    Purpose, Quat, ShapeKind, Solid, Stream, Vec3, axis_angle,
};
use simulator::{AttemptWorld, Execution, Physics, Scene, SceneObject, SceneRays, SettleParams, settle, settle_again};

const GRID: Grid = Grid::PAPER;
const BIN: Container =
    Container { kind: ContainerKind::Bin, inner_m: [0.2, 0.2], height_m: 0.08, thickness_m: 0.004, slope_rad: 0.0 };
const SHELF: Container = Container { kind: ContainerKind::Shelf, height_m: 0.18, ..BIN };

fn gripper() -> Gripper {
    Gripper::from_toml(include_str!("../../configs/grippers/parallel_jaw_80.toml")).unwrap()
}

fn solid(kind: ShapeKind, extents_m: [f32; 3], at_m: [f32; 3], rotation: Quat) -> SceneObject {
    SceneObject {
        body: Solid::new(kind, Vec3::from_array(extents_m)).unwrap().into(),
        mass_kg: 0.1,
        friction: 1.0,
        workspace_from_object: Pose::from_parts(Vec3::from_array(at_m), rotation),
    }
}

fn block(extents_m: [f32; 3], at_m: [f32; 3]) -> SceneObject {
    solid(ShapeKind::Cuboid, extents_m, at_m, Quat::IDENTITY)
}

fn scene(container: Container, objects: Vec<SceneObject>) -> Scene {
    Scene { table_z_m: GRID.table_z_m, fixtures: container.parts(&GRID), objects }
}

/// A grasp from above with its tips at a point, closing along y when `yaw_rad` is 0.
fn from_above(tips_m: [f32; 3], yaw_rad: f32) -> Pose {
    Pose::from_parts(Vec3::from_array(tips_m), axis_angle(Vec3::Z, yaw_rad) * axis_angle(Vec3::X, PI))
}

/// The attempt on the first object by either engine, in full and with shortcuts.
fn executed(scene: &Scene, grasp: &Pose) -> [Execution; 4] {
    let gripper = gripper();
    let settings = Engine::ALL
        .into_iter()
        .flat_map(|engine| [Physics::STANDARD, Physics::FAITHFUL].map(|physics| Physics { engine, ..physics }));
    let run = |physics: Physics| AttemptWorld::new(&physics, &gripper, &Procedure::PAPER, scene).execute(grasp, 0);
    settings.map(run).collect::<Vec<_>>().try_into().unwrap()
}

/// How all of them end.
fn ended(scene: &Scene, grasp: &Pose) -> (Outcome, Option<HitKind>) {
    let all = executed(scene, grasp).map(|it| (it.outcome, it.hit.map(|hit| hit.kind)));
    assert!(all.iter().all(|it| *it == all[0]), "{all:?}");
    all[0]
}

/// How deep any corner of an object is in a part, in metres; only the faces of the part count.
fn depth_in_m(part: &Polyhedron, object: &SceneObject) -> f32 {
    let depth = |corner: Vec3| {
        part.planes().map(|plane| plane.offset_m - plane.normal.dot(corner)).fold(f32::INFINITY, f32::min)
    };
    let corners = object.body.vertices_m().into_iter();
    corners.map(|corner| depth(object.workspace_from_object.transform_point(corner))).fold(0.0, f32::max)
}

fn drops(stream: &mut Stream, count: usize) -> Vec<SceneObject> {
    (0..count)
        .map(|number| {
            let kind = ShapeKind::ALL[number % 4];
            let extents_m = match kind {
                ShapeKind::Cylinder => [0.04, 0.04, 0.06],
                ShapeKind::HalfCylinder => [0.05, 0.06, 0.03],
                _ => [0.03, 0.05, 0.06],
            };
            // Over the floor, up to the walls.
            let at = stream.point(Vec3::new(0.1, 0.1, 0.25), Vec3::new(0.2, 0.2, 0.2501));
            solid(kind, extents_m, at.to_array(), stream.rotation())
        })
        .collect()
}

#[test]
fn what_falls_into_a_bin_rests_in_it_and_stays() {
    let leaning = Container { slope_rad: 0.15, inner_m: [0.22, 0.22], ..BIN };
    for (number, container) in [BIN, leaning].into_iter().enumerate() {
        let fixtures = container.parts(&GRID);
        for engine in Engine::ALL {
            let physics = Physics { engine, ..Physics::STANDARD };
            // Cylinders that roll on are drawn anew, as in datasets.
            let tried = |tries: u32| {
                let drops = drops(&mut Stream::new(2, number as u64, Purpose::Drops, tries), 8);
                settle(&physics, &SettleParams::STANDARD, &GRID, &fixtures, &drops).ok()
            };
            let settled = (0..20).find_map(tried).unwrap();
            let objects = &settled.scene.objects;
            assert_eq!((objects.len(), &settled.scene.fixtures), (8, &fixtures));
            for object in objects {
                let at = object.workspace_from_object.translation;
                assert!((at - 0.15).truncate().abs().max_element() < 0.11, "{engine:?}: {at} is not in the bin");
                let depth_m = fixtures.iter().map(|part| depth_in_m(part, object)).fold(0.0, f32::max);
                assert!(depth_m < 0.0015, "{engine:?}: {depth_m} m in a wall");
            }
            let again = settle_again(&physics, &SettleParams::STANDARD, &GRID, &fixtures, objects).unwrap();
            for (now, before) in again.scene.objects.iter().zip(objects) {
                let moved = now.workspace_from_object.translation - before.workspace_from_object.translation;
                assert!(moved.length() < 0.002, "{engine:?}: {moved}");
            }
        }
    }
}

/// A cube on a slope of 30 degrees slides from rest by g (sin − µ cos) t² / 2, or stays where friction holds it.
#[test]
fn a_block_slides_down_a_leaning_fixture_as_coulomb_says() {
    let lean_rad = PI / 6.0;
    let (normal, down) = (
        Vec3::new(libm::sinf(lean_rad), 0.0, libm::cosf(lean_rad)),
        Vec3::new(libm::cosf(lean_rad), 0.0, -libm::sinf(lean_rad)),
    );
    let turn = axis_angle(Vec3::Y, lean_rad);
    let ramp = Solid::new(ShapeKind::Cuboid, Vec3::new(0.6, 0.2, 0.02)).unwrap();
    let at = Vec3::new(0.3, 0.15, 0.3);
    let ramp = Polyhedron::from(&ramp).moved(&Pose::from_parts(at, turn));
    for (friction, slides) in [(0.2_f32, true), (0.8, false)] {
        let mut cube = block([0.03, 0.03, 0.03], (at + normal * 0.02501 - down * 0.2).to_array());
        (cube.friction, cube.workspace_from_object.rotation) = (friction, turn);
        for engine in Engine::ALL {
            let physics = Physics { engine, ..Physics::FAITHFUL };
            // It is watched for half a second: what still moves then is not at rest.
            let params = SettleParams {
                damping_1_s: 0.0,
                rest_time_s: 0.4,
                time_s_max: 0.4,
                linear_speed_m_s_max: 10.0,
                angular_speed_rad_s_max: 10.0,
                solver_iterations: 8,
                ..SettleParams::STANDARD
            };
            let grid = Grid { size_m: 0.6, ..GRID };
            let fixtures = core::slice::from_ref(&ramp);
            let scene = settle_again(&physics, &params, &grid, fixtures, core::slice::from_ref(&cube)).unwrap().scene;
            let way = scene.objects[0].workspace_from_object.translation - cube.workspace_from_object.translation;
            let pull = 9.81 * (libm::sinf(lean_rad) - friction * libm::cosf(lean_rad));
            let expected_m = if slides { 0.5 * pull * 0.4 * 0.4 } else { 0.0 };
            assert!(
                (way.dot(down) - expected_m).abs() < 0.002 + 0.04 * expected_m,
                "{engine:?} {friction}: {way}, not {expected_m}"
            );
        }
    }
}

#[test]
fn what_lies_in_a_shelf_is_below_its_board() {
    let fixtures = SHELF.parts(&GRID);
    let drops = drops(&mut Stream::new(2, 5, Purpose::Drops, 0), 6);
    let tower = block([0.03, 0.03, 0.19], [0.15, 0.2, 0.16]);
    let settled = settle(&Physics::STANDARD, &SettleParams::STANDARD, &GRID, &fixtures, &drops).unwrap();
    let board_m = GRID.table_z_m + SHELF.height_m;
    for object in &settled.scene.objects {
        let top = object.body.vertices_m().into_iter().map(|c| object.workspace_from_object.transform_point(c).z);
        assert!(top.fold(0.0, f32::max) < board_m);
    }
    assert!(settled.scene.objects.len() >= 4);
    let none = settle(&Physics::STANDARD, &SettleParams::STANDARD, &GRID, &fixtures, &[tower]);
    assert_eq!(none, Err(simulator::Unsettled::Empty), "it reaches through the board");
}

#[test]
fn a_gripper_in_a_wall_collides_with_the_container() {
    // A low cube beside the wall at +y, whose inner face is at 0.25.
    let cube = block([0.04, 0.04, 0.04], [0.15, 0.225, 0.07]);
    let scene = scene(BIN, vec![cube]);
    // Fingers along y: one of them would stand in the wall.
    let across = from_above([0.15, 0.225, 0.065], 0.0);
    assert_eq!(ended(&scene, &across), (Outcome::ApproachCollision, Some(HitKind::Container)));
    let gripper = gripper();
    let world = AttemptWorld::new(&Physics::STANDARD, &gripper, &Procedure::PAPER, &scene);
    let found = world.obstruction(&across, 0).unwrap();
    assert_eq!(found.hit.kind, HitKind::Container);
    // From the front through the wall, where the gripper stands already at the pre-grasp.
    let front = self::scene(BIN, vec![block([0.04, 0.04, 0.04], [0.15, 0.1, 0.07])]);
    let forward = axis_angle(Vec3::ONE.normalize(), -2.0 * PI / 3.0);
    let sideways = Pose::from_parts(Vec3::new(0.15, 0.1, 0.072), forward);
    assert_eq!(ended(&front, &sideways), (Outcome::PregraspCollision, Some(HitKind::Container)));
    // Along the wall the gripper fits, and the cube is lifted beside it.
    let along = from_above([0.15, 0.225, 0.065], FRAC_PI_2);
    assert_eq!(ended(&scene, &along), (Outcome::Held, None));
    // An object in the way comes first, the table last.
    let low = from_above([0.15, 0.225, 0.045], 0.0);
    assert_eq!(ended(&scene, &low).1, Some(HitKind::Container));
    let wide = self::scene(BIN, vec![block([0.04, 0.09, 0.12], [0.15, 0.2, 0.11])]);
    assert_eq!(ended(&wide, &from_above([0.15, 0.21, 0.1], 0.0)).1, Some(HitKind::Target));
}

/// Fingers that stand astride of a wall and an object press against both and lift nothing; where they close on an
/// object that is thick enough to keep the finger out of the wall, nothing is wrong.
#[test]
fn fingers_do_not_close_through_a_wall() {
    let wall = Container { height_m: 0.05, ..BIN };
    let scene = scene(wall, vec![block([0.04, 0.02, 0.05], [0.15, 0.235, 0.075])]);
    // The wall is between 0.25 and 0.254, the jaws between 0.21 and 0.29.
    let astride = from_above([0.15, 0.25, 0.085], 0.0);
    for end in executed(&scene, &astride) {
        assert!(end.outcome == Outcome::Slipped || end.outcome == Outcome::HitOther, "{end:?}");
        // The block and the wall are between the fingers, and neither gives way.
        assert!(end.width_m.unwrap() > 0.02, "{end:?}");
    }
    // Nothing but the wall between the fingers: the jaws do not meet.
    let mut beside = astride;
    beside.translation.x += 0.06;
    for end in executed(&scene, &beside) {
        assert_ne!(end.outcome, Outcome::Empty, "{end:?}");
        assert!((end.width_m.unwrap() - 0.004).abs() < 0.001, "{end:?}");
    }
}

/// Lifted straight up, a gripper that came from the front would meet the board of a low shelf: it goes back and a
/// little up.
#[test]
fn a_gripper_is_not_lifted_through_a_board() {
    let cube = || vec![block([0.04, 0.04, 0.04], [0.15, 0.14, 0.07])];
    let forward = axis_angle(Vec3::ONE.normalize(), -2.0 * PI / 3.0);
    let grasp = Pose::from_parts(Vec3::new(0.15, 0.15, 0.072), forward);
    assert_eq!(ended(&scene(SHELF, cube()), &grasp), (Outcome::Held, None));
    let low = |height_m: f32| scene(Container { height_m, ..SHELF }, cube());
    assert_eq!(ended(&low(0.09), &grasp), (Outcome::Held, None));
    // Here even a little is too much, for the gripper or for the cube.
    assert!(executed(&low(0.044), &grasp).iter().all(|it| it.outcome != Outcome::Held));
}

#[test]
fn the_depth_of_a_wall_is_that_of_its_plane() {
    let rays = SceneRays::new(&scene(BIN, Vec::new()));
    // From the front, along +y, at the height of the wall's middle: its outer face is at y = 0.05 - 0.004.
    let lens = Intrinsics { width_px: 64, height_px: 48, fx_px: 200.0, fy_px: 200.0, cx_px: 32.0, cy_px: 24.0 };
    let along_y = axis_angle(Vec3::X, -FRAC_PI_2);
    let camera =
        Camera { intrinsics: lens, workspace_from_camera: Pose::from_parts(Vec3::new(0.15, -0.354, 0.09), along_y) };
    let depth_m = rays.render(&camera);
    assert!((depth_m.at([32, 24]).unwrap() - 0.4).abs() < 1e-5);
    assert!((depth_m.at([20, 20]).unwrap() - 0.4).abs() < 1e-5);
    // Above the wall, at z = 0.13, rays see the inner face of the wall at the back, or nothing of either.
    let over = Camera {
        workspace_from_camera: Pose::from_parts(Vec3::new(0.15, 0.15, 0.6), axis_angle(Vec3::X, PI)),
        ..camera
    };
    let image = rays.render(&over);
    // The table in the middle, the rim's upper face 2 mm outside the inner face.
    assert!((image.at([32, 24]).unwrap() - 0.55).abs() < 1e-5);
    let rim_px = 32.0 + 200.0 * 0.102 / 0.47;
    let rim = SceneRays::new(&scene(BIN, Vec::new()))
        .seen_from(&Camera { intrinsics: Intrinsics { width_px: 160, cx_px: 32.0, ..lens }, ..over });
    assert!((rim.depth_at([rim_px as usize, 24]).unwrap() - 0.47).abs() < 1e-4);
}

/// Random grasps from above in piles in bins, by both engines.
#[test]
fn engines_agree_about_attempts_in_bins() {
    let gripper = gripper();
    let fixtures = BIN.parts(&GRID);
    let (mut same, mut all, mut container) = (0, 0, 0);
    for number in 0..5 {
        let mut stream = Stream::new(4, number, Purpose::Drops, 0);
        let drops = drops(&mut stream, 6);
        let scene = settle(&Physics::STANDARD, &SettleParams::STANDARD, &GRID, &fixtures, &drops).unwrap().scene;
        let worlds = Engine::ALL.map(|engine| Physics { engine, ..Physics::STANDARD });
        let worlds = worlds.each_ref().map(|it| AttemptWorld::new(it, &gripper, &Procedure::PAPER, &scene));
        for target in 0..scene.objects.len() {
            for _ in 0..6 {
                let at = scene.objects[target].workspace_from_object.translation;
                let lean = axis_angle(Vec3::Y, stream.uniform(-0.4, 0.4));
                let mut grasp = from_above((at - Vec3::Z * 0.01).to_array(), stream.uniform(0.0, PI));
                grasp.rotation = lean * grasp.rotation;
                let [ours, other] = worlds.each_ref().map(|world| world.execute(&grasp, target));
                (all, same) = (all + 1, same + usize::from(ours.outcome.label() == other.outcome.label()));
                container += usize::from(ours.hit.is_some_and(|hit| hit.kind == HitKind::Container));
            }
        }
    }
    assert!(same * 100 >= all * 96 && all >= 120, "{same} of {all}");
    assert!(container * 20 > all, "{container} of {all} hit the container");
}
