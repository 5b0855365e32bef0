//! What a grip holds by statics it holds at any mass: a light object is not thrown out of a strong gripper, afloat or
//! on a table.
//!
//! Closed form: two plates with friction μ that press with F hold 2 μ F, thousands of times the weight of a few grams.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

use schema::{Engine, Gripper, Outcome, Physics, Polyhedron, Pose, Procedure, ShapeKind, Solid, Vec3, axis_angle};
use simulator::{AttemptWorld, Body, FloatingWorld, Hold, Load, Part, PartShape, Scene, SceneObject, Shake};

const PI: f32 = core::f32::consts::PI;

/// The built-in Franka Hand, closing with another force.
fn franka_hand(finger_force_n: f32) -> Gripper {
    let gripper = Gripper::from_toml(include_str!("../../configs/grippers/franka_hand.toml")).unwrap();
    Gripper { finger_force_n, ..gripper }
}

fn solid(kind: ShapeKind, extents_m: [f32; 3]) -> Body {
    Solid::new(kind, Vec3::from_array(extents_m)).unwrap().into()
}

fn hull(corners_m: &[Vec3]) -> PartShape {
    PartShape::Hull(Polyhedron::hull_of(corners_m).unwrap())
}

/// A ball of 20 mm, as a polyhedron.
fn ball() -> Body {
    let corners: Vec<Vec3> = (0..60)
        .map(|i| {
            let (z, turn) = (1.0 - (2 * i + 1) as f32 / 60.0, 2.399_963 * i as f32);
            let radius = (1.0 - z * z).sqrt();
            0.01 * Vec3::new(radius * libm::cosf(turn), radius * libm::sinf(turn), z)
        })
        .collect();
    Body::of_parts("ball", vec![Part { object_from_part: Pose::IDENTITY, shape: hull(&corners) }]).unwrap()
}

/// A ring of 20 mm, its wall 2 mm thick and high, of 16 pieces, its axis along z.
fn ring() -> Body {
    let at = |radius_m: f32, corner: i32, z_m: f32| {
        let turn = 2.0 * PI * corner as f32 / 16.0;
        Vec3::new(radius_m * libm::cosf(turn), radius_m * libm::sinf(turn), z_m)
    };
    let piece = |i: i32| {
        let corners: Vec<Vec3> = [0.008, 0.01]
            .into_iter()
            .flat_map(|radius_m| {
                [i, i + 1].into_iter().flat_map(move |c| [-0.001, 0.001].map(|z_m| at(radius_m, c, z_m)))
            })
            .collect();
        Part { object_from_part: Pose::IDENTITY, shape: hull(&corners) }
    };
    Body::of_parts("ring", (0..16).map(piece).collect()).unwrap()
}

/// The test of `graspmill objects annotate`, gently: to and fro, then turning.
const SHAKE: Load = Load::Shake(Shake {
    way_m: Vec3::new(0.0, 0.0, 0.02),
    turn_rad: Vec3::new(0.2, 0.0, 0.0),
    pivot_m: Vec3::ZERO,
    rate_hz: 3.0,
    cycles: 2.0,
});

/// The width of the grip, if it holds.
fn holds(body: &Body, mass_kg: f32, gripper: &Gripper, grasp: &Pose) -> Option<f32> {
    let procedure = Procedure { empty_width_m: 0.0005, ..Procedure::PAPER };
    let world = FloatingWorld::new(&Physics::STANDARD, gripper, &procedure, body, mass_kg, 1.0);
    let grip = world.close(grasp).ok()?;
    // A ball turns between two plates.
    let hold = Hold { moved_m_max: 0.005, turned_rad_max: PI };
    grip.bear(&SHAKE, &hold, 1.0).is_held.then(|| grip.width_m())
}

const MASSES_KG: [f32; 6] = [0.001, 0.002, 0.005, 0.02, 0.05, 0.2];
const FORCES_N: [f32; 4] = [2.0, 10.0, 30.0, 60.0];

/// 2 μ F against m g: what friction cannot bear is lost at every mass, though it comes into motion slowly.
#[test]
fn what_friction_does_not_bear_is_lost_at_any_mass() {
    let (procedure, cube) = (Procedure::PAPER, solid(ShapeKind::Cuboid, [0.03; 3]));
    for finger_force_n in FORCES_N {
        let gripper = franka_hand(finger_force_n);
        for mass_kg in MASSES_KG {
            for (share, is_held) in [(0.6, false), (1.6, true)] {
                let friction = share * mass_kg * 9.81 / (2.0 * finger_force_n * gripper.friction);
                let world = FloatingWorld::new(&Physics::STANDARD, &gripper, &procedure, &cube, mass_kg, friction);
                let grip = world.close(&Pose::from_translation(Vec3::new(0.0, 0.0, 0.01))).ok().unwrap();
                let pull = Load::Pull { acceleration_m_s2: Vec3::Z * 9.81, time_s: 0.25 };
                let got = grip.bear(&pull, &Hold { moved_m_max: 0.05, turned_rad_max: PI }, 1.0);
                assert_eq!(got.is_held, is_held, "{mass_kg} kg, {finger_force_n} N, {share} of friction: {got:?}");
            }
        }
    }
}

/// Asks for every mass and force, at some grasps.
fn assert_held(name: &str, body: &Body, width_m: f32, grasps: &[Pose]) {
    let mut lost = Vec::new();
    for finger_force_n in FORCES_N {
        let gripper = franka_hand(finger_force_n);
        for mass_kg in MASSES_KG {
            for (number, grasp) in grasps.iter().enumerate() {
                // By statics: a grip beside the centre of mass may turn, but 2 N bear a moment of 0.2 kg at 5 mm.
                match holds(body, mass_kg, &gripper, grasp) {
                    Some(got_m) if (got_m - width_m).abs() < 8e-4 => {}
                    got => lost.push(format!("{name}: {mass_kg} kg, {finger_force_n} N, grasp {number}: {got:?}")),
                }
            }
        }
    }
    assert!(lost.is_empty(), "{} lost\n{}", lost.len(), lost.join("\n"));
}

/// Grasps whose tips are `beyond_m` beyond the origin, beside it along x.
fn beside(beyond_m: f32, along_x_m: &[f32]) -> Vec<Pose> {
    along_x_m.iter().map(|x_m| Pose::from_translation(Vec3::new(*x_m, 0.0, beyond_m))).collect()
}

#[test]
fn a_plate_gripped_flat_is_held_at_any_mass() {
    let grasps = beside(0.012, &[-0.004, 0.0, 0.003]);
    for thickness_m in [0.0015, 0.003] {
        let plate = solid(ShapeKind::Cuboid, [0.1, thickness_m, 0.03]);
        assert_held(&format!("plate {thickness_m}"), &plate, thickness_m, &grasps);
    }
}

#[test]
fn a_rod_is_held_at_any_mass() {
    let rod = solid(ShapeKind::Cylinder, [0.004, 0.004, 0.1]);
    let turned = Pose::from_parts(Vec3::new(0.0, 0.0, 0.006), axis_angle(Vec3::Y, PI / 2.0));
    let grasps = [turned];
    assert_held("rod", &rod, 0.004, &grasps);
}

#[test]
fn a_small_cube_and_a_ball_are_held_at_any_mass() {
    assert_held("cube", &solid(ShapeKind::Cuboid, [0.01; 3]), 0.01, &beside(0.006, &[0.0, 0.002]));
    assert_held("ball", &ball(), 0.02, &beside(0.006, &[0.0]));
}

#[test]
fn a_ring_is_held_at_any_mass() {
    // Across, and by its wall.
    assert_held("ring", &ring(), 0.02, &beside(0.006, &[0.0]));
}

/// What comes of a grasp from above of a body that stands on a table, in the middle of the workspace.
fn on_table(physics: &Physics, body: &Body, mass_kg: f32, friction: f32, beside_m: f32, force_n: f32) -> Outcome {
    let (table_z_m, half_m) = (0.05, 0.5 * body.extents_m());
    let at_m = Vec3::new(0.15, 0.15, table_z_m + half_m.z);
    let workspace_from_object = Pose::from_translation(at_m);
    let objects = vec![SceneObject { body: body.clone(), mass_kg, friction, workspace_from_object }];
    let scene = Scene { table_z_m, fixtures: Vec::new(), objects };
    // The tips are 15 mm below the upper edge.
    let tips_m = at_m + Vec3::new(beside_m, 0.0, half_m.z - 0.015);
    let grasp = Pose::from_parts(tips_m, axis_angle(Vec3::X, PI));
    let (gripper, procedure) = (franka_hand(force_n), Procedure { empty_width_m: 0.0005, ..Procedure::PAPER });
    AttemptWorld::new(physics, &gripper, &procedure, &scene).execute(&grasp, 0).outcome
}

/// By either engine, with shortcuts and without.
fn all_physics() -> impl Iterator<Item = Physics> {
    let physics = [Physics::STANDARD, Physics::FAITHFUL];
    Engine::ALL.into_iter().flat_map(move |engine| physics.map(|physics| Physics { engine, ..physics }))
}

#[test]
fn a_plate_on_edge_is_lifted_at_any_mass() {
    let mut lost = Vec::new();
    for thickness_m in [0.0015, 0.003] {
        let plate = solid(ShapeKind::Cuboid, [0.1, thickness_m, 0.06]);
        for (physics, mass_kg) in all_physics().flat_map(|p| MASSES_KG.map(|mass_kg| (p, mass_kg))) {
            for force_n in [10.0, 30.0, 60.0] {
                for beside_m in [-0.004, 0.0, 0.003] {
                    let got = on_table(&physics, &plate, mass_kg, 1.0, beside_m, force_n);
                    if got != Outcome::Held {
                        lost.push(format!(
                            "{thickness_m} m, {mass_kg} kg, {force_n} N, {beside_m}: {got:?} {physics:?}"
                        ));
                    }
                }
            }
        }
    }
    assert!(lost.is_empty(), "{} lost\n{}", lost.len(), lost.join("\n"));
}

/// 2 μ F against m g, on a table as afloat. A grip that hardly bears the weight may lose what it lifts: what has more
/// inertia than its own takes more to come along, so nobody asks for less than the friction of greased steel.
#[test]
fn on_a_table_friction_lifts_what_it_bears() {
    let cube = solid(ShapeKind::Cuboid, [0.03; 3]);
    for physics in all_physics() {
        for (force_n, mass_kg) in FORCES_N.into_iter().flat_map(|f| MASSES_KG.map(|mass_kg| (f, mass_kg))) {
            let borne = mass_kg * 9.81 / (2.0 * force_n * franka_hand(force_n).friction);
            for (friction, expected) in [(0.6 * borne, Outcome::Slipped), ((1.6 * borne).max(0.1), Outcome::Held)] {
                let got = on_table(&physics, &cube, mass_kg, friction, 0.0, force_n);
                assert_eq!(got, expected, "{mass_kg} kg, {force_n} N, friction {friction}: {physics:?}");
            }
        }
    }
}
