//! Complete plans: on the demo, and on observations without grasps.

use planner::plan::{Plan, PointLabel, RejectReason};
use planner::rank::rho_m;
use planner::{BuiltIn, Observation, PlanOptions, Planner, Policy, demo, input};
use schema::{Grid, Purpose, Quat, Stream, Vec3, VoxelGrid, pose_from_parts};

const GRID: Grid = Grid::PAPER;

/// The paper's settings, without the check of collisions.
fn planner() -> Planner {
    let mut config = BuiltIn::Paper.config().unwrap();
    config.collision.check = false;
    Planner::built_in(config).unwrap()
}

/// Settings with a threshold that the shipped network's qualities often reach.
fn generous() -> Planner {
    let mut config = planner().config;
    config.detection.quality_min = 0.5;
    Planner::built_in(config).unwrap()
}

fn seen() -> Observation {
    input::assemble(&demo::request().unwrap(), None, GRID).unwrap().observation
}

fn plan_with(planner: &Planner, observation: &Observation, options: &PlanOptions) -> Plan {
    planner.plan(observation, options).unwrap()
}

/// The paper's own network, whose grasps have their origin in the voxel that answers.
fn plain() -> Planner {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/paper-200k.safetensors");
    Planner::new(file.as_ref(), planner().config).unwrap()
}

/// A TSDF of a shape given by its signed distance (metres, positive outside).
fn field(distance_m: impl Fn(Vec3) -> f32) -> Observation {
    let index = |flat: usize| [flat / 1600, flat / 40 % 40, flat % 40];
    let stored = |flat: usize| {
        let tsdf = distance_m(GRID.centre_m(index(flat))) / 0.03;
        if tsdf.abs() < 0.98 { (tsdf + 1.0) * 0.5 } else { 0.0 }
    };
    Observation::Tsdf(VoxelGrid::new(GRID, (0..GRID.len()).map(stored).collect()).unwrap())
}

#[test]
fn the_demo_has_ranked_grasps_that_obey_the_rules() {
    for (planner, is_exact) in [(planner(), false), (generous(), false), (plain(), true)] {
        let params = planner.config.detection;
        let plan = plan_with(&planner, &seen(), &PlanOptions::default());
        assert!(!plan.grasps.is_empty() && plan.reason.is_none());
        assert_eq!(plan.funnel.count("ranked"), Some(plan.grasps.len()));
        assert_eq!(plan.funnel.count("detections"), plan.funnel.count("collision_free"));
        for ranked in &plan.grasps {
            let pose = ranked.workspace_from_grasp;
            assert!(ranked.quality >= params.quality_min);
            // The head says where the tips are, about where the voxel has them.
            let off_m = pose * Vec3::new(0.0, 0.0, -0.05) - GRID.centre_m(ranked.voxel.unwrap());
            let voxels_max = if is_exact { 0.5 } else { 2.5 };
            assert!(off_m.abs().max_element() < (voxels_max + 1e-3) * GRID.voxel_size_m(), "{off_m}");
            let voxels = ranked.width_m.unwrap() / GRID.voxel_size_m();
            assert!((params.width_voxels_min - 1e-4..=params.width_voxels_max + 1e-4).contains(&voxels));
            // Of the two orientations the one nearer to the default wrist.
            let down = Quat::from_xyzw(1.0, 0.0, 0.0, 0.0);
            let other = pose.rotation * Quat::from_xyzw(0.0, 0.0, 1.0, 0.0);
            assert!(down.dot(pose.rotation).abs() >= down.dot(other).abs());
            let Some(object) = ranked.object else { continue };
            let expected = rho_m(pose.translation, plan.objects[object].centroid_m, ranked.quality, [0.45, 0.45, 0.1]);
            assert_eq!(ranked.rho_m, Some(expected));
        }
        // From the top, and by ρ within an object; grasps without an object last, by quality.
        let keys: Vec<(usize, f32)> = plan
            .grasps
            .iter()
            .map(|ranked| (ranked.object.unwrap_or(usize::MAX), ranked.rho_m.unwrap_or(-ranked.quality)))
            .collect();
        assert!(keys.is_sorted_by(|a, b| a.0 < b.0 || (a.0 == b.0 && a.1 <= b.1)), "{keys:?}");
        assert!(plan.objects.is_sorted_by(|a, b| a.centroid_m.z >= b.centroid_m.z));
    }
}

#[test]
fn threads_change_no_bit() {
    let plan_on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut plan =
            pool.install(|| plan_with(&generous(), &seen(), &PlanOptions { explain: true, ..PlanOptions::default() }));
        plan.timings_ms.clear();
        plan
    };
    assert!(plan_on(1) == plan_on(3));
}

#[test]
fn a_grasp_is_given_in_the_base_frame_and_towards_the_wrist() {
    let mut stream = Stream::new(5, 0, Purpose::Candidates, 0);
    let base_from_workspace = pose_from_parts(stream.rotation(), Vec3::new(0.4, -0.1, 0.2));
    let plan = |wrist: Option<Quat>| {
        let options = PlanOptions {
            base_from_workspace: Some(base_from_workspace),
            workspace_from_wrist: wrist,
            ..PlanOptions::default()
        };
        plan_with(&generous(), &seen(), &options)
    };
    let (forwards, backwards) = (plan(None), plan(Some(Quat::from_xyzw(0.0, 1.0, 0.0, 0.0))));
    let mut turned = 0;
    assert_eq!(forwards.grasps.len(), backwards.grasps.len());
    for (a, b) in forwards.grasps.iter().zip(&backwards.grasps) {
        let (pose, other) = (a.workspace_from_grasp, b.workspace_from_grasp);
        let base = a.base_from_grasp.unwrap();
        for tip in [Vec3::ZERO, Vec3::Y * 0.03, Vec3::Z * 0.1] {
            assert!((base * tip - base_from_workspace * (pose * tip)).length() < 1e-6);
        }
        assert_eq!(a.voxel, b.voxel);
        assert!((pose.rotation * Vec3::Z - other.rotation * Vec3::Z).length() < 1e-5);
        turned += usize::from((pose.rotation * Vec3::X + other.rotation * Vec3::X).length() < 1e-5);
    }
    // The two wrists are half a turn apart, so each grasp is nearer to one of them.
    assert_eq!(turned, forwards.grasps.len());
}

#[test]
fn every_candidate_that_is_dropped_has_its_reason() {
    // VGN's network leaves several grasps of the demo.
    let mut config = BuiltIn::Vgn.config().unwrap();
    config.detection.quality_min = 0.3;
    config.collision.points_max = 0;
    config.gripper.opening_m_max = 0.06;
    let planner = Planner::built_in(config).unwrap();
    let options =
        PlanOptions { explain: true, check_collisions: Some(true), grasps_max: Some(2), ..PlanOptions::default() };
    let plan = plan_with(&planner, &seen(), &options);
    let silent = plan_with(&planner, &seen(), &PlanOptions { explain: false, ..options.clone() });
    assert_eq!(plan.grasps, silent.grasps);
    assert!(silent.dropped.is_empty());
    let count = |is: fn(&RejectReason) -> bool| plan.dropped.iter().filter(|dropped| is(&dropped.reason)).count();
    let colliding = count(|drop| matches!(drop, RejectReason::Collision { .. }));
    let [reached, detections, free] =
        ["quality_reached", "detections", "collision_free"].map(|stage| plan.funnel.count(stage).unwrap());
    assert_eq!(colliding, detections - free);
    assert_eq!(count(|drop| *drop == RejectReason::BeyondLimit), free - plan.grasps.len());
    assert_eq!(count(|drop| *drop == RejectReason::Suppressed), reached - detections);
    assert!(colliding > 0 && plan.grasps.len() == 2);
    // Independent of the sweep: no point of the cloud may be deep inside the fingers of the remaining grasps.
    let fingers = planner.config.gripper.fingers(planner.config.gripper.opening_m_max);
    for ranked in &plan.grasps {
        let grasp_from_workspace = ranked.workspace_from_grasp.inverse();
        let deep = plan.cloud.points_m.iter().filter(|point| {
            let local = grasp_from_workspace * **point;
            fingers.iter().any(|f| (local - f.centre_m).abs().cmplt(f.half_m).all())
        });
        assert_eq!(deep.count(), 0);
    }
}

#[test]
fn policies_give_the_same_grasps_in_their_own_orders() {
    let of = |policy| {
        let options = PlanOptions { policy: Some(policy), ..PlanOptions::default() };
        plan_with(&generous(), &seen(), &options).grasps
    };
    let sorted = |mut grasps: Vec<planner::plan::RankedGrasp>| {
        grasps.sort_by_key(|ranked| ranked.voxel);
        grasps.iter_mut().for_each(|ranked| ranked.rank = 0);
        grasps
    };
    let [paper, random, best] = [Policy::Paper, Policy::VgnRandom, Policy::VgnBest].map(of);
    assert!(paper.len() > 3 && paper != random && random != best);
    assert!(best.is_sorted_by(|a, b| a.quality >= b.quality));
    assert_eq!(sorted(paper.clone()), sorted(random));
    assert_eq!(sorted(paper), sorted(best));
}

/// The wording of reasons; other tests read the funnel.
#[test]
fn where_there_is_nothing_the_plan_says_so() {
    let reason = |observation: &Observation| {
        let plan = plan_with(&planner(), observation, &PlanOptions::default());
        assert!(plan.grasps.is_empty());
        plan.reason.unwrap()
    };
    let nothing = Observation::Tsdf(VoxelGrid::new(GRID, vec![0.0; GRID.len()]).unwrap());
    assert_eq!(reason(&nothing), "empty scene: no surface was seen in the workspace");
    assert_eq!(reason(&Observation::Views(Vec::new())), "empty scene: no surface was seen in the workspace");
    let cloudless = Observation::Cloud { points_m: vec![Vec3::splat(5.0); 9], eyes_m: Vec::new() };
    assert_eq!(reason(&cloudless), "empty scene: no surface was seen in the workspace");
    let mut strict = planner();
    strict.config.detection.quality_min = 1.0; // the shipped network gives two places at the table's edge more than 0.9
    let table = plan_with(&strict, &field(|p| p.z - 0.05), &PlanOptions::default()).reason.unwrap();
    assert!(table.starts_with("no grasp has a quality of 1 or more: the best has 0."), "{table}");
}

#[test]
fn none_asked_for_is_a_reason_too() {
    let plan = plan_with(&generous(), &seen(), &PlanOptions { grasps_max: Some(0), ..PlanOptions::default() });
    assert_eq!(plan.reason.as_deref(), Some("no grasps were asked for"));
}

#[test]
fn no_plane_and_no_cluster_are_warnings() {
    // An upright board that hangs in the air.
    let board = field(|p| ((p.x - 0.15).abs() - 0.015).max((p.y - 0.15).abs() - 0.04).max((p.z - 0.15).abs() - 0.12));
    let floating = plan_with(&generous(), &board, &PlanOptions::default());
    assert!(floating.cloud.plane.is_none());
    assert!(floating.warnings.len() == 1 && floating.warnings[0].contains("plane"), "{:?}", floating.warnings);
    assert_eq!(floating.objects.len(), 1, "the board is an object all the same");
    let table = plan_with(&planner(), &field(|p| p.z - 0.05), &PlanOptions::default());
    assert!(table.objects.is_empty() && table.warnings.len() == 1, "{:?}", table.warnings);
    assert!(table.warnings[0].contains("cluster"), "{:?}", table.warnings);
    assert!(table.cloud.labels.iter().all(|label| *label == PointLabel::Plane));
}

#[test]
fn a_table_at_another_height_than_the_networks_is_a_warning() {
    let warnings = |z_m: f32| plan_with(&planner(), &field(move |p| p.z - z_m), &PlanOptions::default()).warnings;
    let by_quality = PlanOptions { policy: Some(Policy::VgnBest), ..PlanOptions::default() };
    let ranked_otherwise = plan_with(&planner(), &field(|p| p.z - 0.07), &by_quality).warnings;
    let names_both = |warning: &String| warning.contains("70 mm") && warning.contains("50 mm");
    assert!(names_both(&ranked_otherwise[0]), "whatever ranks: {ranked_otherwise:?}");
    assert!(!warnings(0.052)[0].contains("mm"), "{:?}", warnings(0.052));
    assert!(names_both(&warnings(0.07)[0]), "{:?}", warnings(0.07));
}

#[test]
fn grasps_without_an_object_are_grasps_all_the_same() {
    let mut config = BuiltIn::Paper.config().unwrap();
    config.detection.quality_min = 0.5;
    config.clusters.cluster_points_min = 1_000_000;
    let plan = plan_with(&Planner::built_in(config).unwrap(), &seen(), &PlanOptions::default());
    assert!(!plan.grasps.is_empty() && plan.grasps.iter().all(|ranked| ranked.object.is_none()));
}

/// Points on all walls of the workspace: every way is blocked.
#[test]
fn a_blocked_way_is_a_reason() {
    let planner = generous();
    let workspace = planner::volume::Workspace::cube(GRID);
    let grid = planner::volume::fuse(&seen(), &workspace, planner.config.cloud).unwrap().grid;
    let mut config = planner.config.clone();
    config.gripper.clearance_m = 0.02;
    config.collision.points_max = 0;
    config.gripper.finger_width_m = 0.2;
    config.gripper.opening_m_max = 0.01;
    let tight = Planner::built_in(config).unwrap();
    let options = PlanOptions { check_collisions: Some(true), ..PlanOptions::default() };
    let plan = plan_with(&tight, &Observation::Tsdf(grid), &options);
    assert!(plan.grasps.is_empty());
    assert!(plan.reason.is_some() && plan.funnel.count("collision_free") == Some(0));
}
