//! Bodies of several convex parts: rendered, touched, grasped and lifted as one object, with their hollows.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

use std::sync::Arc;

use schema::{
    Camera, Engine, Grid, Gripper, Intrinsics, Outcome, Polyhedron, Pose, Procedure, Purpose, Quat, ShapeKind, Solid,
    Stream, TriangleMesh, Vec3, axis_angle,
};
use simulator::{
    AttemptWorld, Body, Execution, Gate, Part, PartShape, Physics, Scene, SceneObject, SceneRays, SettleParams,
    convex_hull, few_cornered_hull, settle, settle_again,
};

const PI: f32 = core::f32::consts::PI;
const TABLE_Z_M: f32 = 0.05;
fn gripper() -> Gripper {
    Gripper::from_toml(include_str!("../../configs/grippers/parallel_jaw_80.toml")).unwrap()
}

fn cuboid(extents_m: Vec3) -> Solid {
    Solid::new(ShapeKind::Cuboid, extents_m).unwrap()
}

fn part(shape: PartShape, at_m: Vec3) -> Part {
    Part { shape, object_from_part: Pose::from_translation(at_m) }
}

fn boxes(parts: &[(Vec3, Vec3)]) -> Body {
    let parts = parts.iter().map(|(extents_m, at_m)| part(PartShape::Solid(cuboid(*extents_m)), *at_m));
    Body::of_parts("boxes", parts.collect()).unwrap()
}

const BOX_M: Vec3 = Vec3::new(0.04, 0.05, 0.07);

/// A cuboid, whole and cut across y, and the hull of its corners.
fn alike() -> [Body; 3] {
    let [third, rest] = [1.0, 2.0].map(|thirds: f32| Vec3::new(BOX_M.x, BOX_M.y * thirds / 3.0, BOX_M.z));
    let cut = boxes(&[(third, Vec3::ZERO), (rest, Vec3::Y * (0.5 * BOX_M.y))]);
    let hull = convex_hull(&cuboid(BOX_M).vertices_m()).unwrap();
    let hull = Body::of_parts("hull", vec![part(PartShape::Hull(hull), Vec3::ZERO)]).unwrap();
    [cuboid(BOX_M).into(), cut, hull]
}

/// A ring of twelve hulls with its axis along z; the centre of a flat side is on x.
fn ring(inner_m: f32, outer_m: f32, height_m: f32) -> Body {
    let sector = |number: usize| {
        let corner = |radius_m: f32, turn: f32, z_m: f32| {
            let (sin, cos) = libm::sincosf(PI / 6.0 * (number as f32 + turn));
            Vec3::new(radius_m * cos, radius_m * sin, z_m)
        };
        let corners: Vec<Vec3> = [-0.5, 0.5]
            .into_iter()
            .flat_map(|turn| [inner_m, outer_m].map(|radius_m| (radius_m, turn)))
            .flat_map(|(radius_m, turn)| [-0.5, 0.5].map(|side| corner(radius_m, turn, side * height_m)))
            .collect();
        part(PartShape::Hull(convex_hull(&corners).unwrap()), Vec3::ZERO)
    };
    Body::of_parts("ring", (0..12).map(sector).collect()).unwrap()
}

/// A post with a foot along +x; the post's centre is 30 mm from the centre of the body.
fn l_shape() -> Body {
    boxes(&[(Vec3::new(0.02, 0.03, 0.08), Vec3::ZERO), (Vec3::new(0.06, 0.03, 0.02), Vec3::new(0.04, 0.0, -0.03))])
}

/// The same body without hollows: the hull of all its corners.
fn filled(body: &Body) -> Body {
    let hull = convex_hull(&body.vertices_m()).unwrap();
    Body::of_parts("filled", vec![part(PartShape::Hull(hull), Vec3::ZERO)]).unwrap()
}

fn object(body: Body, mass_kg: f32, workspace_from_object: Pose) -> SceneObject {
    SceneObject { body, mass_kg, friction: 1.0, workspace_from_object }
}

/// Upright on the table, in the middle.
fn standing(body: Body, mass_kg: f32) -> SceneObject {
    let at = Vec3::new(0.15, 0.15, TABLE_Z_M + 0.5 * body.extents_m().z);
    object(body, mass_kg, Pose::from_translation(at))
}

fn scene_of(object: SceneObject) -> Scene {
    Scene { table_z_m: TABLE_Z_M, fixtures: Vec::new(), objects: vec![object] }
}

/// A grasp from above, closing along x, its tips at `tip_z_m`.
fn from_above(x_m: f32, tip_z_m: f32) -> Pose {
    Pose::from_parts(Vec3::new(x_m, 0.15, tip_z_m), axis_angle(Vec3::Z, PI / 2.0) * axis_angle(Vec3::X, PI))
}

/// An attempt by either engine, with everything simulated and with shortcuts: all must end the same.
fn both(scene: &Scene, grasp: &Pose) -> Execution {
    let gripper = gripper();
    let ends = Engine::ALL.into_iter().flat_map(|engine| {
        [Physics::FAITHFUL, Physics::STANDARD].map(|physics| {
            let physics = Physics { engine, ..physics };
            AttemptWorld::new(&physics, &gripper, &Procedure::PAPER, scene).execute(grasp, 0)
        })
    });
    let ends: Vec<Execution> = ends.collect();
    assert!(ends.iter().all(|end| (end.outcome, end.hit) == (ends[0].outcome, ends[0].hit)), "{ends:?}");
    ends[1]
}

fn looking(from_m: Vec3, at_m: Vec3) -> Camera {
    let rotation = Quat::from_rotation_arc(Vec3::Z, (at_m - from_m).normalize());
    let intrinsics = Intrinsics { width_px: 80, height_px: 60, fx_px: 120.0, fy_px: 120.0, cx_px: 40.0, cy_px: 30.0 };
    Camera { intrinsics, workspace_from_camera: Pose::from_parts(from_m, rotation) }
}

/// Difference of two poses, in metres and as rotation (0 for equal, 1 for a half turn).
fn apart(a: &Pose, b: &Pose) -> (f32, f32) {
    ((a.translation - b.translation).length(), 1.0 - a.rotation.dot(b.rotation).abs())
}

#[test]
fn what_is_cut_or_wrapped_measures_the_same() {
    for body in alike() {
        let name = body.name().to_owned();
        assert!((body.volume_m3() / (BOX_M.x * BOX_M.y * BOX_M.z) - 1.0).abs() < 1e-5, "{name}");
        assert!((body.extents_m() - BOX_M).length() < 1e-7, "{name}");
        assert!((body.bounding_radius_m() - 0.5 * BOX_M.length()).abs() < 1e-7, "{name}");
        for (point, outside_m) in [(Vec3::X, 1.0 - 0.02), (Vec3::ZERO, -0.02), (Vec3::Y * 0.03, 0.005)] {
            let found = body.distance_outside_m(point);
            // Inside, the cut is a surface, too.
            let is_less_deep = name == "boxes" && outside_m < found && found <= 0.0;
            assert!(is_less_deep || (found - outside_m).abs() < 1e-6, "{name}: {found} at {point}");
        }
    }
}

#[test]
fn what_is_cut_or_wrapped_looks_the_same() {
    let mut stream = Stream::new(21, 0, Purpose::Views, 0);
    for _ in 0..20 {
        let pose = Pose::from_parts(Vec3::new(0.15, 0.15, 0.12), stream.rotation());
        let camera = looking(stream.point(Vec3::new(-0.2, -0.2, 0.2), Vec3::new(0.5, 0.5, 0.5)), pose.translation);
        let [plain, others @ ..] =
            alike().map(|body| SceneRays::new(&scene_of(object(body, 0.1, pose))).render(&camera).depth_m);
        let bare = SceneRays::new(&Scene { table_z_m: TABLE_Z_M, fixtures: Vec::new(), objects: Vec::new() })
            .render(&camera)
            .depth_m;
        let seen = plain.iter().zip(&bare).filter(|(a, b)| a != b).count();
        assert!(seen > 100, "the object fills {seen} pixels");
        for other in others {
            // A ray along a silhouette may hit one and miss the other.
            let differ = plain.iter().zip(&other).filter(|(a, b)| (**a - **b).abs() > 2e-6).count();
            assert!(differ <= 1, "{differ} pixels differ");
        }
    }
}

/// A mesh is what is seen, and the parts are what is touched, also after a dataset stored both.
#[test]
fn a_mesh_is_seen_in_place_of_the_parts_and_does_nothing_else() {
    let smaller = cuboid(0.5 * BOX_M);
    let skin = Polyhedron::from(&smaller);
    let triangles = skin.faces().iter().flat_map(|face| face.triangles().map(|t| t.map(|corner| corner as u32)));
    let mesh = TriangleMesh::new(skin.corners_m(), triangles.collect()).unwrap();
    let bare = boxes(&[(BOX_M, Vec3::ZERO)]);
    let clad = bare.clone().with_mesh(Some(Arc::new(mesh)));
    let again = Body::of_model(&clad.to_model(0.1, 1.0).unwrap()).unwrap();
    assert_eq!(again.mesh(), clad.mesh());
    let pose = Pose::from_parts(Vec3::new(0.15, 0.15, 0.12), axis_angle(Vec3::ONE.normalize(), 0.7));
    let camera = looking(Vec3::new(0.3, -0.1, 0.4), pose.translation);
    let image = |bodies: &[&Body]| {
        let objects = bodies.iter().map(|body| object((*body).clone(), 0.1, pose)).collect();
        SceneRays::new(&Scene { table_z_m: TABLE_Z_M, fixtures: Vec::new(), objects }).render(&camera).depth_m
    };
    let differ = |a: &[f32], b: &[f32]| a.iter().zip(b).filter(|(a, b)| (**a - **b).abs() > 2e-6).count();
    let (seen, expected) = (image(&[&clad]), image(&[&smaller.into()]));
    assert!(differ(&seen, &expected) <= 1 && differ(&seen, &image(&[])) > 30, "it is seen");
    assert_eq!(image(&[&again]), seen);
    // Whatever is nearer is seen, whether it has a mesh or not.
    assert!(differ(&image(&[&clad, &bare]), &image(&[&bare])) == 0 && differ(&seen, &image(&[&bare])) > 50);
    let [with, without] =
        [again, bare].map(|body| Gate::new(&scene_of(object(body, 0.1, pose)), &gripper(), &Procedure::PAPER));
    let mut stream = Stream::new(24, 0, Purpose::Candidates, 0);
    for _ in 0..200 {
        let at = stream.point(Vec3::new(0.08, 0.08, 0.10), Vec3::new(0.22, 0.22, 0.20));
        let grasp = Pose::from_parts(at, axis_angle(Vec3::X, PI + stream.uniform(-0.8, 0.8)));
        assert_eq!(with.blocked(&grasp, 0), without.blocked(&grasp, 0));
    }
}

#[test]
fn what_is_cut_or_wrapped_is_touched_at_the_same_grasps() {
    let gripper = gripper();
    let pose = Pose::from_parts(Vec3::new(0.15, 0.15, 0.12), axis_angle(Vec3::ONE.normalize(), 0.7));
    let gates = alike().map(|body| Gate::new(&scene_of(object(body, 0.1, pose)), &gripper, &Procedure::PAPER));
    let mut stream = Stream::new(22, 0, Purpose::Candidates, 0);
    let (mut on_object, mut free) = (0, 0);
    for case in 0..600 {
        let at = stream.point(Vec3::new(0.08, 0.08, 0.10), Vec3::new(0.22, 0.22, 0.20));
        let down = axis_angle(Vec3::X, PI + stream.uniform(-0.8, 0.8));
        let grasp = Pose::from_parts(at, axis_angle(Vec3::Z, stream.uniform(0.0, 2.0 * PI)) * down);
        let [plain, cut, hull] = gates.each_ref().map(|gate| gate.blocked(&grasp, 0));
        assert_eq!((plain, plain), (cut, hull), "case {case}");
        on_object += u32::from(plain.is_some_and(|(_, hit)| hit.object_id == Some(0)));
        free += u32::from(plain.is_none());
    }
    assert!(on_object > 100 && free > 100, "{on_object} touch, {free} are free");
}

#[test]
fn what_is_cut_or_wrapped_comes_to_rest_alike() {
    let mut stream = Stream::new(23, 0, Purpose::Drops, 0);
    let (mut same, mut count) = ([0, 0], 0);
    for _ in 0..15 {
        let at = Pose::from_parts(Vec3::new(0.15, 0.15, 0.18), stream.rotation());
        let [plain, others @ ..] = alike().map(|body| {
            let drop = SceneObject { body, mass_kg: 0.1, friction: 1.0, workspace_from_object: at };
            settle(&Physics::FAITHFUL, &SettleParams::STANDARD, &Grid::PAPER, &[], &[drop]).unwrap().scene.objects[0]
                .workspace_from_object
        });
        count += 1;
        for (same, other) in same.iter_mut().zip(others) {
            // On one of its three pairs of faces, and on the same.
            let heights = [BOX_M.x, BOX_M.y, BOX_M.z].map(|e| TABLE_Z_M + 0.5 * e);
            let z_m = other.translation.z;
            assert!(heights.iter().any(|h| (z_m - h).abs() < 0.001), "it rests at {z_m} m");
            let (off_m, turned) = apart(&plain, &other);
            *same += usize::from(off_m < 0.01 && turned < 0.01);
        }
    }
    assert!(same.iter().all(|same| 5 * same >= 4 * count), "{same:?} of {count} rest where the cuboid does");
}

#[test]
fn what_is_cut_or_wrapped_is_held_or_not_alike() {
    let mut stream = Stream::new(24, 0, Purpose::Candidates, 0);
    let scenes = alike().map(|body| scene_of(standing(body, 0.3)));
    let gripper = gripper();
    let physics = Physics::STANDARD;
    let worlds = scenes.each_ref().map(|scene| AttemptWorld::new(&physics, &gripper, &Procedure::PAPER, scene));
    let (mut held, mut failed, mut differ) = (0, 0, [0, 0]);
    for _ in 0..150 {
        let at = Vec3::new(0.15 + stream.uniform(-0.03, 0.03), 0.15 + stream.uniform(-0.03, 0.03), 0.11);
        let turn = axis_angle(Vec3::Z, stream.uniform(0.0, PI)) * axis_angle(Vec3::X, PI + stream.uniform(-0.3, 0.3));
        let [plain, others @ ..] = worlds.each_ref().map(|world| world.execute(&Pose::from_parts(at, turn), 0).outcome);
        if plain == Outcome::ApproachCollision || plain == Outcome::PregraspCollision {
            continue;
        }
        held += u32::from(plain == Outcome::Held);
        failed += u32::from(plain != Outcome::Held);
        for (differ, other) in differ.iter_mut().zip(others) {
            *differ += u32::from(other != plain);
        }
    }
    assert!(held > 20 && failed > 5, "{held} held, {failed} failed");
    assert!(differ.iter().all(|differ| 20 * differ <= held + failed), "{differ:?} of {} differ", held + failed);
}

#[test]
fn one_solid_alone_is_that_solid_to_the_bit() {
    for (kind, extents) in [
        (ShapeKind::Cuboid, BOX_M),
        (ShapeKind::Cylinder, Vec3::new(0.05, 0.05, 0.07)),
        (ShapeKind::TriPrism, Vec3::new(0.06, 0.06, 0.05)),
        (ShapeKind::HalfCylinder, Vec3::new(0.06, 0.06, 0.03)),
    ] {
        let solid = Solid::new(kind, extents).unwrap();
        let alone = Body::of_parts("alone", vec![part(PartShape::Solid(solid), Vec3::ZERO)]).unwrap();
        let [plain, alone] = [Body::from(solid), alone].map(|body| {
            let at = Pose::from_parts(Vec3::new(0.15, 0.15, 0.15), axis_angle(Vec3::X, 0.4));
            let drop = SceneObject { body, mass_kg: 0.1, friction: 1.0, workspace_from_object: at };
            let settled = settle(&Physics::FAITHFUL, &SettleParams::STANDARD, &Grid::PAPER, &[], &[drop]).unwrap();
            let pose = settled.scene.objects[0].workspace_from_object;
            let end = both(&settled.scene, &from_above(pose.translation.x, pose.translation.z));
            (settled.settle_time_s, pose, end)
        });
        assert_eq!(plain, alone, "{kind:?}");
    }
}

#[test]
fn a_notch_is_empty() {
    let [hollow, full] = [l_shape(), filled(&l_shape())].map(|body| scene_of(standing(body, 0.1)));
    // Along y, through the notch above the foot.
    let through = Vec3::new(0.16, 0.15, 0.09);
    let camera = looking(through - Vec3::Y * 0.3, through);
    let depth_m = |scene: &Scene| SceneRays::new(scene).seen_from(&camera).depth_at([40, 30]);
    assert_eq!(depth_m(&hollow), None);
    let met_m = depth_m(&full).unwrap();
    assert!((met_m - 0.285).abs() < 1e-4, "the filled one is met after {met_m} m");
    // Closing on the post, one finger over the foot.
    let grasp = from_above(0.12, 0.085);
    assert_eq!(both(&full, &grasp).outcome, Outcome::ApproachCollision);
    let end = both(&hollow, &grasp);
    assert_eq!(end.outcome, Outcome::Held);
    assert!((end.width_m.unwrap() - 0.02).abs() < 0.001, "{end:?}");
    // Lower, the finger stands on the foot.
    assert_eq!(both(&hollow, &from_above(0.12, 0.069)).outcome, Outcome::ApproachCollision);
}

#[test]
fn a_ring_is_held_with_a_finger_through_its_hole() {
    let ring = ring(0.03, 0.045, 0.025);
    // One of twelve segments of two regular polygons between these radii: the corners lie on them.
    let area_m2 = 6.0 * (0.045_f32.powi(2) - 0.03_f32.powi(2)) * libm::sinf(PI / 6.0);
    assert!((ring.volume_m3() / (area_m2 * 0.025) - 1.0).abs() < 1e-4);
    let inner_side_m = 0.03 * libm::cosf(PI / 12.0);
    assert!((ring.distance_outside_m(Vec3::ZERO) - inner_side_m).abs() < 1e-6, "the middle is a hole");
    let scene = scene_of(standing(ring.clone(), 0.05));
    let grasp = from_above(0.15 + 0.5 * (0.03 + 0.045) * libm::cosf(PI / 12.0), 0.06);
    let end = both(&scene, &grasp);
    assert_eq!(end.outcome, Outcome::Held, "{end:?}");
    // The finger in the hole is 20 mm wide, a side of the hole 15.5 mm: the finger's edges rest on the neighbouring
    // sides.
    let beyond_side_m = 0.01 - 0.03 * libm::sinf(PI / 12.0);
    let wall_m = 0.015 * libm::cosf(PI / 12.0) + beyond_side_m * libm::tanf(PI / 6.0);
    assert!((end.width_m.unwrap() - wall_m).abs() < 2e-4, "{end:?} on a wall of {wall_m} m");
    let plugged = scene_of(standing(filled(&ring), 0.05));
    assert_eq!(both(&plugged, &grasp).outcome, Outcome::ApproachCollision);
}

/// The last is a prism with sixteen sides, on an end: described by the first four of its corners it would topple.
#[test]
fn what_stands_goes_on_standing() {
    let corner = |i: usize| libm::sincosf(PI / 8.0 * i as f32);
    let corners =
        (0..16).map(corner).flat_map(|(sin, cos)| [-0.04, 0.04].map(|z| Vec3::new(0.02 * cos, 0.02 * sin, z)));
    let prism = convex_hull(&corners.collect::<Vec<Vec3>>()).unwrap();
    let prism = Body::of_parts("prism", vec![part(PartShape::Hull(prism), Vec3::ZERO)]).unwrap();
    let [_, cut, hull] = alike();
    let patient = SettleParams { rest_time_s: 3.0, time_s_max: 4.0, ..SettleParams::STANDARD };
    for body in [ring(0.03, 0.045, 0.025), l_shape(), cut, hull, prism] {
        let before = standing(body, 0.1);
        let after =
            settle_again(&Physics::FAITHFUL, &patient, &Grid::PAPER, &[], core::slice::from_ref(&before)).unwrap();
        let (off_m, turned) = apart(&after.scene.objects[0].workspace_from_object, &before.workspace_from_object);
        assert!(off_m < 5e-4 && turned < 1e-5, "{}: {off_m} m, {turned}", before.body.name());
    }
}

/// Several hollow objects together: they fall, rest on and in each other, and none is shot away.
#[test]
fn a_pile_of_compounds_comes_to_rest() {
    let mut stream = Stream::new(25, 0, Purpose::Drops, 0);
    let mut drops = Vec::new();
    for body in [ring(0.03, 0.045, 0.025), l_shape(), ring(0.02, 0.035, 0.05), l_shape(), filled(&l_shape())] {
        let at = stream.point(Vec3::new(0.1, 0.1, 0.3), Vec3::new(0.2, 0.2, 0.3));
        let workspace_from_object = Pose::from_parts(at, stream.rotation());
        drops.push(SceneObject { body, mass_kg: 0.1, friction: 0.8, workspace_from_object });
    }
    let scene = settle(&Physics::FAITHFUL, &SettleParams::STANDARD, &Grid::PAPER, &[], &drops).unwrap().scene;
    assert!(scene.objects.len() >= 4, "{} of 5 stayed", scene.objects.len());
    for object in &scene.objects {
        let low = |v: Vec3| object.workspace_from_object.transform_point(v).z;
        let low_m = object.body.vertices_m().into_iter().map(low).fold(f32::INFINITY, f32::min);
        assert!(low_m > TABLE_Z_M - 0.001, "{} lies {low_m} m high", object.body.name());
    }
}

#[test]
fn the_frame_lies_in_the_middle_of_the_bounding_box() {
    let body =
        boxes(&[(Vec3::splat(0.02), Vec3::new(0.5, -0.2, 0.1)), (Vec3::splat(0.04), Vec3::new(0.53, -0.2, 0.1))]);
    let low = body.vertices_m().into_iter().reduce(Vec3::min).unwrap();
    let high = body.vertices_m().into_iter().reduce(Vec3::max).unwrap();
    assert!((low + high).length() < 1e-6, "{low} {high}");
    assert!((body.extents_m() - Vec3::new(0.06, 0.04, 0.04)).length() < 1e-6, "{}", body.extents_m());
    assert!((body.bounding_radius_m() - Vec3::new(0.03, 0.02, 0.02).length()).abs() < 1e-6);
    assert!(body.as_solid().is_none());
}

#[test]
fn what_is_no_compound_is_refused() {
    let good = part(PartShape::Solid(cuboid(BOX_M)), Vec3::ZERO);
    let refused = |name: &str, parts: Vec<Part>| Body::of_parts(name, parts).unwrap_err().to_string();
    assert_eq!(refused("", vec![good.clone()]), "a compound must have a name");
    assert_eq!(refused("nothing", Vec::new()), "a compound must have at least one part");
    for pose in [
        Pose::from_translation(Vec3::new(0.0, f32::NAN, 0.0)),
        Pose::from_parts(Vec3::ZERO, Quat::from_xyzw(0.0, 0.0, 0.0, 2.0)),
    ] {
        let bad = Part { object_from_part: pose, ..good.clone() };
        let expected = "the pose of part 1 must be finite, with a rotation of length 1";
        assert_eq!(refused("bad", vec![good.clone(), bad]), expected);
    }
}

/// A hull of many faces stands on corners of several of them; none may sink in before it is seen.
#[test]
fn what_stands_on_hulls_of_many_faces_comes_to_rest() {
    let mut stream = Stream::new(13, 0, Purpose::Objects, 0);
    for case in 0..200 {
        // Three pebbles in a row that overlap.
        let mut pebble = |at_m: Vec3| {
            let half_m = stream.point(Vec3::splat(0.012), Vec3::splat(0.03));
            let points_m: Vec<Vec3> = (0..24).map(|_| half_m * (stream.rotation() * Vec3::X)).collect();
            part(PartShape::Hull(few_cornered_hull(&points_m, 24).unwrap().0), at_m)
        };
        let parts = [-0.03, 0.0, 0.03].map(|x_m| pebble(Vec3::X * x_m));
        let body = Body::of_parts("pebbles", parts.into()).unwrap();
        let workspace_from_object = Pose::from_parts(Vec3::new(0.15, 0.15, 0.15), stream.rotation());
        let object = SceneObject { body, mass_kg: 0.1, friction: 0.8, workspace_from_object };
        let settled = settle(&Physics::STANDARD, &SettleParams::STANDARD, &Grid::PAPER, &[], &[object]);
        assert!(settled.is_ok(), "case {case}: {settled:?}");
    }
}
