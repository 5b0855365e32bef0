//! Grasps of what one wants come first: scenes with a robot's arm, a tote and a bent table, as one camera sees them.

use planner::plan::{Plan, RankedGrasp};
use planner::{Config, Doubt, Observation, PlanOptions, Planner, View};
use schema::{Camera, DepthImage, Intrinsics, Mat3, Quat, Vec2, Vec3, pose_from_parts};

const TABLE_M: f32 = 0.05;
const LENS: Intrinsics =
    Intrinsics { width_px: 320, height_px: 240, fx_px: 300.0, fy_px: 300.0, cx_px: 159.5, cy_px: 119.5 };
/// Two things: the middle of each, half of its sides, and its height above the table.
const THINGS: [([f32; 2], [f32; 2], f32); 2] =
    [([0.10, 0.17], [0.015, 0.03], 0.04), ([0.21, 0.19], [0.025, 0.012], 0.035)];

/// The depths of a surface that has a height over each place of the table, or is not seen there.
fn seen(eye_m: Vec3, height_m: impl Fn(Vec2) -> Option<f32>) -> View {
    let forward = (Vec3::new(0.15, 0.15, TABLE_M) - eye_m).normalize();
    let right = forward.cross(Vec3::Z).normalize();
    let rotation = Quat::from_mat3(&Mat3::from_cols(right, forward.cross(right), forward)).normalize();
    let depth_m = |pixel: usize| {
        let ray = rotation * LENS.ray([pixel % LENS.width_px, pixel / LENS.width_px]);
        let is_below = |depth_m: f32| {
            let at_m = eye_m + ray * depth_m;
            height_m(at_m.truncate()).is_some_and(|height_m| at_m.z <= height_m)
        };
        let reached = (0..400).map(|step| 0.45 + 0.002 * step as f32).find(|depth_m| is_below(*depth_m));
        reached.map_or(0.0, |mut far_m| {
            let mut near_m = far_m - 0.002;
            for _ in 0..8 {
                let middle_m = 0.5 * (near_m + far_m);
                if is_below(middle_m) { far_m = middle_m } else { near_m = middle_m }
            }
            far_m
        })
    };
    let [width_px, height_px] = [LENS.width_px, LENS.height_px];
    let image = DepthImage { width_px, height_px, depth_m: (0..width_px * height_px).map(depth_m).collect() };
    View::new(image, Camera { intrinsics: LENS, workspace_from_camera: pose_from_parts(rotation, eye_m) })
}

/// The height of the thing at a place.
fn thing_m(at: Vec2) -> Option<f32> {
    let is_here =
        |middle: [f32; 2], half: [f32; 2]| (at - Vec2::from_array(middle)).abs().cmple(Vec2::from_array(half)).all();
    THINGS.iter().find(|(middle, half, _)| is_here(*middle, *half)).map(|(_, _, high_m)| TABLE_M + high_m)
}

fn plan(view: View) -> Plan {
    let planner = Planner::built_in(Config::load(None).unwrap()).unwrap();
    planner.plan(&Observation::Views(vec![view]), &PlanOptions::default()).unwrap()
}

fn is_of_thing(grasp: &RankedGrasp) -> bool {
    let tips_m = grasp.workspace_from_grasp.translation.truncate();
    THINGS.iter().any(|(middle, _, _)| (tips_m - Vec2::from_array(*middle)).length() < 0.05)
}

#[test]
fn an_arm_from_the_border_is_held_only_if_there_is_nothing_else() {
    let eye_m = Vec3::new(0.15, -0.15, 0.65);
    let is_arm = |at: Vec2| (at.x - 0.15).abs() < 0.025 && at.y < 0.04;
    let with_arm = |at: Vec2| if is_arm(at) { 0.10 } else { TABLE_M };
    let both = plan(seen(eye_m, |at| Some(thing_m(at).unwrap_or_else(|| with_arm(at)))));
    assert!(!both.grasps.is_empty(), "{:?}", both.reason);
    assert!(both.grasps.iter().all(|grasp| is_of_thing(grasp) && grasp.doubt.is_none()), "{:?}", both.grasps);
    assert!(both.warnings.iter().any(|warning| warning.contains("come last")), "{:?}", both.warnings);
    let alone = plan(seen(eye_m, |at| Some(with_arm(at))));
    assert!(!alone.grasps.is_empty(), "{:?}", alone.reason);
    assert!(alone.grasps.iter().all(|grasp| grasp.doubt == Some(Doubt::Cut)), "{:?}", alone.grasps);
    // Away from the border it is a thing as others.
    let inside = plan(seen(eye_m, |at| Some(if at.y > -0.04 { with_arm(at) } else { TABLE_M })));
    assert!(
        !inside.grasps.is_empty() && inside.grasps.iter().all(|grasp| grasp.doubt.is_none()),
        "{:?}",
        inside.reason
    );
}

#[test]
fn walls_that_curve_are_not_held_but_what_is_inside() {
    let inside = plan(seen(Vec3::new(0.15, 0.13, 0.75), |at| {
        let off = at - 0.15;
        let angle = libm::atan2f(off.y, off.x);
        let [across, along] = [libm::cosf(angle) / 0.2, libm::sinf(angle) / 0.16];
        let rim_m = 1.0 / (across * across + along * along).sqrt();
        let up = (off.length() - rim_m + 0.07) / 0.07;
        let wall_m = TABLE_M + 0.06 * up.max(0.0) * up.max(0.0);
        thing_m(at).or((up <= 1.0).then_some(wall_m))
    }));
    assert_eq!(inside.walls.len(), 1);
    assert!(inside.walls[0].iter().all(|at_m| (at_m[2] - TABLE_M - 0.055).abs() < 0.015), "{:?}", inside.walls);
    assert!(!inside.grasps.is_empty() && inside.grasps.iter().all(is_of_thing), "{:?}", inside.reason);
}

#[test]
fn the_end_of_a_table_that_is_bent_up_is_not_held() {
    let eye_m = Vec3::new(0.15, 0.0, 0.75);
    let table = |at: Vec2| {
        let rise_m = 0.6 * ((at - Vec2::new(0.36, 0.30)).element_sum() / 2.0_f32.sqrt() + 0.09);
        at.cmple(Vec2::new(0.36, 0.30)).all().then_some(TABLE_M + rise_m.max(0.0))
    };
    let both = plan(seen(eye_m, |at| thing_m(at).or(table(at))));
    assert!(!both.grasps.is_empty() && both.grasps.iter().all(is_of_thing), "{:?}", both.reason);
    let alone = plan(seen(eye_m, table));
    assert!(alone.grasps.iter().all(|grasp| grasp.doubt == Some(Doubt::BentTable)), "{:?}", alone.grasps);
}
