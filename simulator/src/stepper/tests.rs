//! The stepper against closed forms, and its contacts against a slow search over all axes.

use parry3d::shape::SharedShape;
use schema::{Gripper, Physics, Pose, Procedure, Purpose, Quat, ShapeKind, Solid, Stream, Vec3, axis_angle};
use wide::f32x4;

use super::patch::{Frame, PREDICTION_M, Scratch, between, on_box, on_plane};
use super::shape::{Part, Thing, Things};
use super::{Body, Jaws, Stepper};
use crate::bodies::Bodies;
use crate::engine::UNITS_PER_M;
use crate::gate::tests::{V, points, widest_gap};
use crate::mass_scaling::LeastInertia;
use crate::{AttemptWorld, Scene, SceneObject};

const GRAVITY_M_S2: f32 = 9.81;
/// The table's top.
const TABLE_Z_M: f32 = 0.05;
/// As in the shipped configs.
const PHYSICS: Physics = Physics { engine: schema::Engine::Stepper, ..Physics::STANDARD };

fn gripper() -> Gripper {
    Gripper::from_toml(include_str!("../../../configs/grippers/parallel_jaw_80.toml")).unwrap()
}

fn thing(kind: ShapeKind, extents_m: Vec3, mass_kg: f32, friction: f32, pose: Pose) -> Thing {
    let body = Solid::new(kind, extents_m).unwrap().into();
    Thing::of(&SceneObject { body, mass_kg, friction, workspace_from_object: pose }, LeastInertia::NONE)
}

fn alone(moving: Vec<Thing>) -> Things {
    Things { moving, fixtures: Vec::new() }
}

/// Things on the table, each with a velocity and an angular velocity, and a gripper far above them. The axes are the
/// workspace's.
fn stepper<'a>(physics: &Physics, things: &'a Things, motions: &[[Vec3; 2]]) -> Stepper<'a> {
    let above = Pose::from_translation(Vec3::new(0.0, 0.0, 10.0));
    let mut stepper = Stepper::new(physics, Jaws::new(&gripper(), 0.0, [0.04; 2]), things, TABLE_Z_M, &above, true);
    for (body, [velocity_m_s, spin_rad_s]) in stepper.bodies.iter_mut().zip(motions) {
        (body.velocity_m_s, body.spin_rad_s) = (*velocity_m_s, *spin_rad_s);
    }
    stepper
}

fn upright(x_m: f32, height_m: f32) -> Pose {
    Pose::from_translation(Vec3::new(x_m, 0.0, TABLE_Z_M + 0.5 * height_m))
}

#[test]
fn a_block_slides_as_far_as_coulomb_says() {
    for (friction, speed_m_s) in [(0.2, 0.3), (0.5, 0.5), (0.5, 1.0), (1.0, 1.0)] {
        let things =
            alone(vec![thing(ShapeKind::Cuboid, Vec3::new(0.06, 0.06, 0.02), 0.3, friction, upright(0.0, 0.02))]);
        let mut stepper = stepper(&PHYSICS, &things, &[[Vec3::X * speed_m_s, Vec3::ZERO]]);
        let from = stepper.pose(0).translation;
        for _ in 0..480 {
            stepper.step();
        }
        let way_m = stepper.pose(0).translation - from;
        let expected_m = speed_m_s * speed_m_s / (2.0 * friction * GRAVITY_M_S2);
        // The first step's contact force is unknown, and a step is 1/240 s.
        assert!((way_m.x - expected_m).abs() < 0.003 * speed_m_s + 0.01 * expected_m, "{way_m}, not {expected_m}");
        assert!(way_m.y.abs() < 1e-4 && stepper.velocities(0)[0].length() < 1e-4, "{way_m}");
    }
}

#[test]
fn a_leaning_block_falls_to_the_side_of_its_weight() {
    let extents_m = Vec3::new(0.04, 0.06, 0.12);
    let balance_rad = libm::atanf(extents_m.x / extents_m.z);
    for (lean_rad, falls) in [(0.8, false), (0.95, false), (1.05, true), (1.2, true)].map(|(x, f)| (x * balance_rad, f))
    {
        let rotation = axis_angle(Vec3::Y, lean_rad);
        // It stands on the edge that it leans over.
        let edge = rotation * Vec3::new(0.5 * extents_m.x, 0.0, -0.5 * extents_m.z);
        let pose = Pose::from_parts(Vec3::new(0.0, 0.0, TABLE_Z_M - edge.z), rotation);
        let things = alone(vec![thing(ShapeKind::Cuboid, extents_m, 0.2, 1.0, pose)]);
        let mut stepper = stepper(&PHYSICS, &things, &[[Vec3::ZERO; 2]]);
        for _ in 0..720 {
            stepper.step();
        }
        let upright = (stepper.pose(0).rotation * Vec3::Z).z;
        assert_eq!(upright < 0.1, falls, "{lean_rad} of {balance_rad} rad: {upright}");
        assert!(falls || upright > 0.999, "{lean_rad} of {balance_rad} rad: {upright}");
    }
}

#[test]
fn what_meets_head_on_goes_on_together() {
    let still = Physics { gravity_m_s2: 0.0, ..PHYSICS };
    let at = |x_m: f32| Pose::from_translation(Vec3::new(x_m, 0.0, 1.0));
    let cube = |mass_kg: f32, x_m: f32| thing(ShapeKind::Cuboid, Vec3::splat(0.05), mass_kg, 1.0, at(x_m));
    let things = alone(vec![cube(0.1, -0.06), cube(0.3, 0.0)]);
    let mut stepper = stepper(&still, &things, &[[Vec3::X, Vec3::ZERO], [Vec3::ZERO; 2]]);
    for _ in 0..24 {
        stepper.step();
    }
    for id in 0..2 {
        let [velocity_m_s, spin_rad_s] = stepper.velocities(id);
        assert!((velocity_m_s - Vec3::X * 0.25).length() < 1e-3, "{velocity_m_s}");
        assert!(spin_rad_s.length() < 1e-2, "{spin_rad_s}");
    }
}

/// Energy of motion and height, in joules.
fn energy_j(stepper: &Stepper<'_>, things: &Things) -> f32 {
    let of = |(body, thing): (&Body, &Thing)| {
        let turn: f32 = (0..3)
            .map(|i| {
                let along = body.answer.principal[i].dot(body.spin_rad_s) / thing.root_inverse_inertia[i];
                along * along
            })
            .sum();
        let motion = 0.5 * (thing.mass_kg * body.velocity_m_s.length_squared() + turn);
        motion + thing.mass_kg * GRAVITY_M_S2 * (body.answer.centre_m.z - stepper.planes[0].offset_m)
    };
    stepper.bodies.iter().zip(&things.moving).map(of).sum()
}

#[test]
fn energy_never_grows() {
    let mut stream = Stream::new(11, 0, Purpose::Candidates, 0);
    for case in 0..24 {
        let extents = |kind: ShapeKind| match kind {
            ShapeKind::Cylinder => Vec3::new(0.04, 0.04, 0.06),
            ShapeKind::HalfCylinder => Vec3::new(0.05, 0.06, 0.03),
            _ => Vec3::new(0.04, 0.05, 0.07),
        };
        let moving: Vec<Thing> = (0..3)
            .map(|i| {
                let kind = ShapeKind::ALL[(case + i) % 4];
                let at = Vec3::new(0.0, 0.03 * i as f32, TABLE_Z_M + 0.06 + 0.1 * i as f32);
                thing(kind, extents(kind), 0.1, 0.6, Pose::from_parts(at, stream.rotation()))
            })
            .collect();
        let things = alone(moving);
        let motions: Vec<[Vec3; 2]> = (0..3)
            .map(|_| {
                let spin = stream.point(Vec3::splat(-5.0), Vec3::splat(5.0));
                [stream.point(Vec3::splat(-0.3), Vec3::splat(0.3)), spin]
            })
            .collect();
        let mut stepper = stepper(&PHYSICS, &things, &motions);
        let begun_j = energy_j(&stepper, &things);
        let (mut last_j, mut gained_j) = (begun_j, 0.0_f32);
        for _ in 0..480 {
            stepper.step();
            let now_j = energy_j(&stepper, &things);
            gained_j = gained_j.max(now_j - last_j);
            last_j = now_j;
        }
        // What overlaps is pushed apart by at most 0.3 m/s, so that 0.1 kg is raised by 1.25 mm in a step.
        assert!(gained_j < 1.3e-3, "case {case}: gained {gained_j} of {begun_j} J in a step");
        assert!(last_j < begun_j, "case {case}");
    }
}

/// Two fingers of 20 N with friction µ lift m if m (g + a) < 2 µ F, a = 6 d / T² being the lift's first acceleration,
/// and cannot hold it if m g > 2 µ F.
#[test]
fn the_lift_s_limit_is_coulomb_s() {
    let gripper = gripper();
    let first_m_s2 = 6.0 * 0.1 / (0.5 * 0.5);
    let at = Vec3::new(0.15, 0.15, 0.08);
    let grasp = Pose::from_parts(at, axis_angle(Vec3::X, core::f32::consts::PI));
    for case in 0..44 {
        let friction = 0.1 + 0.09 * (case / 4) as f32;
        let (load_m_s2, share, expected) = [
            (GRAVITY_M_S2 + first_m_s2, 0.8, "held"),
            (GRAVITY_M_S2 + first_m_s2, 0.95, "held"),
            (GRAVITY_M_S2, 1.05, "slipped"),
            (GRAVITY_M_S2, 1.2, "slipped"),
        ][case % 4];
        let mass_kg = share * 2.0 * friction * gripper.finger_force_n / load_m_s2;
        let solid = Solid::new(ShapeKind::Cuboid, Vec3::new(0.04, 0.04, 0.06)).unwrap();
        let workspace_from_object = Pose::from_parts(at, Quat::IDENTITY);
        let block = SceneObject { body: solid.into(), mass_kg, friction, workspace_from_object };
        let scene = Scene { table_z_m: TABLE_Z_M, fixtures: Vec::new(), objects: vec![block] };
        let procedure = Procedure { hold_time_s: 1.0, ..Procedure::PAPER };
        let end = AttemptWorld::new(&PHYSICS, &gripper, &procedure, &scene).execute(&grasp, 0);
        assert_eq!(end.outcome.name(), expected, "{mass_kg} kg, friction {friction}: {end:?}");
    }
}

/// A random solid about as large as the workspace's, and its corners.
fn solid(stream: &mut Stream, case: usize) -> (Part, Vec<Vec3>) {
    let kind = ShapeKind::ALL[case % 4];
    let size = stream.point(Vec3::splat(0.02), Vec3::splat(0.07));
    let extents_m = match kind {
        ShapeKind::Cylinder => Vec3::new(size.x, size.x, size.z),
        ShapeKind::HalfCylinder => Vec3::new(size.x, 2.0 * size.z, size.z),
        _ => size,
    };
    let solid = Solid::new(kind, extents_m).unwrap();
    (Part::new(&(&solid).into(), true), solid.vertices_m())
}

fn frame(pose: &Pose) -> Frame {
    Frame { axes: [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| pose.rotation * axis), origin_m: pose.translation }
}

fn box_corners(centre_m: Vec3, half_m: Vec3) -> Vec<Vec3> {
    let sign = |corner: usize, bit: usize| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
    (0..8).map(|c| centre_m + half_m * Vec3::new(sign(c, 0), sign(c, 1), sign(c, 2))).collect()
}

/// Distance of two convex bodies by parry, which wants them about as large as 1.
fn distance_m(first: &[V], second: &[V]) -> f32 {
    let hull = |points: &[V]| {
        let points: Vec<Vec3> = points.iter().map(|p| Vec3::from_array(p.map(|x| x as f32)) * UNITS_PER_M).collect();
        SharedShape::convex_hull(&points).unwrap()
    };
    let still = parry3d::math::Pose::IDENTITY;
    parry3d::query::distance(&still, &*hull(first).0, &still, &*hull(second).0).unwrap().distance / UNITS_PER_M
}

/// The deepest point of a contact is as deep as the bodies overlap along the best axis, its normal is such an axis, and
/// bodies out of reach have no contact.
fn check(patch: Option<super::patch::Patch>, first: &[V], second: &[V], what: &str) -> bool {
    let gap_m = widest_gap(first, second) as f32;
    let Some(patch) = patch else {
        // Beside a corner bodies are farther apart than along any of the axes.
        let apart_m = distance_m(first, second);
        assert!(
            gap_m > 0.0 && apart_m > PREDICTION_M - 1e-5,
            "{what}: no contact at {apart_m} m, {gap_m} along an axis"
        );
        return false;
    };
    let along = |points: &[V]| points.iter().map(|p| patch.normal.dot(Vec3::from_array(p.map(|x| x as f32)))).collect();
    let (a, b): (Vec<f32>, Vec<f32>) = (along(first), along(second));
    let normals_gap_m =
        b.iter().copied().fold(f32::INFINITY, f32::min) - a.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let deepest_m = patch.gaps_m[..patch.count].iter().copied().fold(f32::INFINITY, f32::min);
    // Faces are preferred to edges by 0.05 mm, and by 0.15 mm where they touch. Apart, the widest gap may lie along a
    // direction between two corners, and these are not asked.
    let tolerance_m = if gap_m < -2e-4 { 6e-5 } else { 1.6e-4_f32.max(0.1 * gap_m) };
    assert!(
        (normals_gap_m - gap_m).abs() < tolerance_m,
        "{what}: the normal's gap is {normals_gap_m}, the widest {gap_m}"
    );
    // Beside a corner the nearest points may lie farther apart than along any axis.
    assert!(deepest_m > normals_gap_m - 1e-5, "{what}: {deepest_m} m deep, not {normals_gap_m}");
    assert!((patch.normal.length() - 1.0).abs() < 1e-4);
    deepest_m < normals_gap_m + 1e-4
}

#[test]
fn contacts_are_those_of_a_search_over_all_axes() {
    let mut stream = Stream::new(12, 0, Purpose::Candidates, 0);
    let mut scratch = Scratch::default();
    let (mut found, mut as_deep) = (0, 0);
    for case in 0..240 {
        let (part, corners_m) = solid(&mut stream, case);
        let (other, other_corners_m) = solid(&mut stream, case / 4);
        let rotation = stream.rotation();
        let half_m = stream.point(Vec3::splat(0.005), Vec3::splat(0.03));
        let direction = stream.rotation() * Vec3::Z;
        // Move the part until it is a little apart from the box, or in it.
        let wanted_m = stream.point(Vec3::splat(-0.0015), Vec3::splat(0.003)).x;
        let touching = |of: &[V], corners: &[Vec3]| {
            let (mut near, mut far) = (0.0_f32, 0.3);
            for _ in 0..10 {
                let middle = 0.5 * (near + far);
                let pose = Pose::from_parts(direction * middle, rotation);
                if (widest_gap(of, &points(corners, &pose)) as f32) < wanted_m { near = middle } else { far = middle }
            }
            Pose::from_parts(direction * far, rotation)
        };
        let box_corners = points(&box_corners(Vec3::ZERO, half_m), &Pose::IDENTITY);
        let pose = touching(&box_corners, &corners_m);
        let patch = on_box(Vec3::ZERO, half_m, &frame(&pose), &part, &mut scratch);
        found += usize::from(patch.is_some());
        as_deep += usize::from(check(patch, &box_corners, &points(&corners_m, &pose), &format!("box, case {case}")));

        if case % 4 == 0 {
            let other_points = points(&other_corners_m, &Pose::IDENTITY);
            let pose = touching(&other_points, &corners_m);
            let frames = [&frame(&Pose::IDENTITY), &frame(&pose)];
            let patch = between([&other, &part], frames, &mut scratch).ok();
            found += usize::from(patch.is_some());
            as_deep +=
                usize::from(check(patch, &other_points, &points(&corners_m, &pose), &format!("pair, case {case}")));
        }
        let lowest_m = corners_m.iter().map(|c| pose.transform_point(*c).z).fold(f32::INFINITY, f32::min);
        let mut patch = None;
        on_plane(Vec3::Z, lowest_m - wanted_m, &frame(&pose), &part, &mut scratch, |found| patch = Some(*found));
        assert_eq!(patch.is_some(), wanted_m <= PREDICTION_M, "{wanted_m}");
        if let Some(patch) = patch {
            let deepest_m = patch.gaps_m[..patch.count].iter().copied().fold(f32::INFINITY, f32::min);
            assert!((deepest_m - wanted_m).abs() < 1e-6, "{deepest_m} m, not {wanted_m}");
            assert!((patch.normal - Vec3::Z).length() < 1e-5, "{}", patch.normal);
        }
    }
    assert!(found > 160 && as_deep * 10 > found * 9, "{as_deep} of {found}");
}

#[test]
fn lanes_do_what_numbers_do() {
    // What determinism on other machines rests on: nothing fused, nothing approximate.
    let (a, b, c) = (f32x4::splat(1.000_000_1), f32x4::splat(1.000_000_2), f32x4::splat(-1.000_000_3));
    let plain = 1.000_000_1_f32 * 1.000_000_2_f32 + -1.000_000_3_f32;
    assert_eq!((a * b + c).to_array().map(f32::to_bits), [plain.to_bits(); 4]);
    assert_eq!(f32x4::from([4.0, -0.0, 1e-40, f32::MAX]).abs().to_array(), [4.0, 0.0, 1e-40, f32::MAX]);
}

/// The rim of a cylinder that wobbles rolls on corners that come into contact one after the other; none may sink in
/// before it is seen, or being pushed out again would keep the wobbling up.
#[test]
fn a_wobbling_cylinder_comes_to_rest() {
    let extents_m = Vec3::new(0.042, 0.042, 0.054);
    for lean_rad in [0.05, 0.1, 0.2] {
        let pose = Pose::from_parts(
            Vec3::new(0.0, 0.0, TABLE_Z_M + 0.5 * extents_m.z + 0.021 * lean_rad),
            axis_angle(Vec3::X, lean_rad),
        );
        let things = alone(vec![thing(ShapeKind::Cylinder, extents_m, 0.07, 0.8, pose)]);
        let mut stepper = stepper(&PHYSICS, &things, &[[Vec3::ZERO, Vec3::Y * 3.0]]);
        for _ in 0..480 {
            stepper.step();
        }
        let [velocity_m_s, spin_rad_s] = stepper.velocities(0).map(Vec3::length);
        assert!(velocity_m_s < 0.005 && spin_rad_s < 0.05, "{lean_rad} rad: {velocity_m_s} m/s, {spin_rad_s} rad/s");
    }
}

#[test]
fn every_corner_near_a_plane_bears_once() {
    let mut stream = Stream::new(14, 0, Purpose::Objects, 0);
    let mut scratch = Scratch::default();
    let mut most = 0;
    for case in 0..200 {
        let (solid, corners_m) = solid(&mut stream, case);
        let part = Part { is_solid: false, ..solid };
        // As good as lying on a face, so that many corners are near.
        let normal = part.hull.normals[case % part.hull.normals.len()];
        let tilt = axis_angle(stream.rotation() * Vec3::X, 0.02);
        let pose = Pose::from_parts(Vec3::ZERO, tilt * Quat::from_rotation_arc(normal, -Vec3::Z));
        let lowest_m = corners_m.iter().map(|c| pose.transform_point(*c).z).fold(f32::INFINITY, f32::min);
        let mut gaps_m = Vec::new();
        on_plane(Vec3::Z, lowest_m, &frame(&pose), &part, &mut scratch, |patch| {
            gaps_m.extend_from_slice(&patch.gaps_m[..patch.count]);
        });
        let heights_m = corners_m.iter().map(|c| pose.transform_point(*c).z - lowest_m);
        let mut near_m: Vec<f32> = heights_m.filter(|gap_m| *gap_m < PREDICTION_M).collect();
        gaps_m.sort_by(f32::total_cmp);
        near_m.sort_by(f32::total_cmp);
        assert_eq!(gaps_m.len(), near_m.len(), "case {case}");
        assert!(
            gaps_m.iter().zip(&near_m).all(|(a, b)| (a - b).abs() < 1e-6),
            "case {case}: {gaps_m:?}, not {near_m:?}"
        );
        most = most.max(near_m.len());
    }
    assert!(most > 8, "{most}");
}
