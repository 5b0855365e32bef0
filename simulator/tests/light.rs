//! What a gripper holds by statics it holds at any mass: a light object that floats is not thrown out of a strong
//! gripper.
//!
//! Closed form: two plates with friction μ that press with F hold 2 μ F, thousands of times the weight of a few grams.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

use schema::{Gripper, Physics, Polyhedron, Pose, Procedure, ShapeKind, Solid, Vec3, axis_angle};
use simulator::{Body, FloatingWorld, Hold, Load, Part, PartShape, Shake};

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
