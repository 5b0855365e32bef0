//! Plans of a judge: grasps that it expects to hold, on the demo and on an empty table.

use std::path::{Path, PathBuf};

use planner::gripper_volume::WRIST_DOWN;
use planner::plan::{Plan, RejectReason};
use planner::{BuiltIn, Cone, Config, FindTable, Limits, Observation, PlanOptions, Planner, Target, demo, input};
use program::ExitCode;
use schema::{Grid, Gripper, Outcome, Pose, Vec3, VoxelGrid};

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name)
}

fn config() -> Config {
    Config::load(None).unwrap()
}

fn judge(config: Config) -> Planner {
    Planner::built_in(config).unwrap()
}

fn demo(planner: &Planner, threads: usize) -> Plan {
    let observation = input::assemble(&demo::request().unwrap(), None, Grid::PAPER).unwrap().observation;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let options = PlanOptions { explain: true, ..PlanOptions::default() };
    Plan { timings_ms: Vec::new(), ..pool.install(|| planner.plan(&observation, &options)).unwrap() }
}

#[test]
fn a_judge_gives_grasps_that_it_expects_to_hold_and_says_what_it_expects_of_others() {
    let config = config();
    let (epsilon, apart_m, proposals) = (config.detection.quality_min, config.judge.apart_m, config.judge.proposals);
    let asked = config.judge.asked.unwrap();
    let gripper = config.gripper.clone();
    let planner = judge(config);
    let plan = demo(&planner, 1);
    assert_eq!(plan, demo(&planner, 2));
    assert!(plan.grasps.len() > 5, "{:?}", plan.reason);
    for (place, ranked) in plan.grasps.iter().enumerate() {
        assert!(ranked.quality >= epsilon && ranked.width_m <= Some(gripper.opening_m_max));
        let approach = ranked.workspace_from_grasp.rotation * Vec3::Z;
        assert!(approach.z < 0.06, "never from below: {approach}");
        assert!(gripper.open_gripper().iter().all(|part| part.lowest_z_m(&ranked.workspace_from_grasp) >= 0.05));
        for other in &plan.grasps[..place] {
            let apart = other.workspace_from_grasp.translation - ranked.workspace_from_grasp.translation;
            assert!(apart.length() >= apart_m);
        }
    }
    assert_eq!(plan.funnel.count("ranked"), Some(plan.grasps.len()));
    // A quarter is kept back for things without a sure grasp, for which as many again may be proposed and asked about.
    let [proposed, judged] = ["proposed", "judged"].map(|stage| plan.funnel.count(stage).unwrap());
    assert!((proposals..=2 * proposals).contains(&proposed), "{proposed}");
    assert!((asked - asked / 4..=2 * asked - asked / 4).contains(&judged), "{judged}");
    assert_eq!(plan.funnel.count("voxels"), None, "a judge is not asked about voxels");
    assert!(plan.grasps.iter().all(|ranked| ranked.voxel.is_none()));
    assert_eq!(plan.grasps.len() + plan.dropped.len(), judged);
    // About grasps all over the scene, not about the likeliest object alone.
    assert!(plan.objects.len() > 2 && plan.grasps.iter().any(|ranked| ranked.object != plan.grasps[0].object));
    let failed = |dropped: &&planner::plan::DroppedCandidate| matches!(dropped.reason, RejectReason::Quality { likeliest: Some((outcome, _)) } if outcome != Outcome::Held);
    let failed = plan.dropped.iter().find(failed).unwrap();
    assert!(failed.quality < epsilon && failed.why == "quality", "{failed:?}");
}

#[test]
fn many_images_give_as_many_grasps_as_few() {
    let planner = judge(config());
    let observation = input::assemble(&demo::request().unwrap(), None, Grid::PAPER).unwrap().observation;
    let Observation::Views(views) = observation else { panic!("the demo has images") };
    let grasps_of = |times: usize| {
        let views: Vec<_> = (0..times).flat_map(|_| views.clone()).collect();
        planner.plan(&Observation::Views(views), &PlanOptions::default()).unwrap().grasps.len()
    };
    let (few, many) = (grasps_of(1), grasps_of(10));
    assert!(few > 5 && 3 * many >= 2 * few, "{few} and {many}");
}

#[test]
fn answers_that_are_not_numbers_are_no_grasps() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("overflowing.safetensors");
    let mut checkpoint = network::checkpoint::read(&file("models/judge.safetensors")).unwrap();
    checkpoint.vector.iter_mut().for_each(|weight| *weight *= 1e20);
    network::checkpoint::save(&checkpoint, &path).unwrap();
    let plan = demo(&Planner::new(&path, config()).unwrap(), 2);
    assert!(plan.grasps.is_empty() && plan.funnel.count("quality_reached") == Some(0), "{:?}", plan.funnel);
    assert!(plan.dropped.iter().any(|dropped| dropped.why == "not_a_number"));
    assert!(plan.reason.unwrap().contains("not numbers"));
}

#[test]
fn grasps_that_failed_are_not_offered_again() {
    let planner = judge(config());
    let observation = input::assemble(&demo::request().unwrap(), None, Grid::PAPER).unwrap().observation;
    let plan = |avoid: &[Pose]| {
        let options = PlanOptions { avoid: avoid.to_vec(), explain: true, ..PlanOptions::default() };
        planner.plan(&observation, &options).unwrap()
    };
    let mut failed: Vec<Pose> = Vec::new();
    // Every grasp of the demo fails, until none is left.
    let last = loop {
        let answer = plan(&failed);
        let Some(best) = answer.grasps.first() else { break answer };
        let again = |avoided: &Pose| {
            let turned = best.workspace_from_grasp.rotation.angle_between(avoided.rotation);
            (best.workspace_from_grasp.translation - avoided.translation).length() < 0.01 && turned < 0.5
        };
        assert!(!failed.iter().any(again), "{:?} after {failed:?}", best.workspace_from_grasp);
        failed.push(best.workspace_from_grasp);
    };
    assert!(failed.len() > plan(&[]).grasps.len(), "avoided grasps suppress none: {}", failed.len());
    assert!(last.reason.is_some() && last.funnel.count("found") == Some(0));
    assert!(last.dropped.iter().any(|dropped| dropped.reason == RejectReason::Avoided && dropped.why == "avoided"));
    assert!(last.objects.iter().all(|object| object.grasp_count == 0 && object.reason.is_some()));
    assert!(last.objects.iter().any(|object| object.reason.as_deref() == Some("like a grasp that failed")));
}

#[test]
fn each_object_is_told_its_grasps_and_its_best_one_comes_first() {
    let planner = judge(config());
    let observation = input::assemble(&demo::request().unwrap(), None, Grid::PAPER).unwrap().observation;
    let base_from_workspace = Pose::from_parts(Vec3::new(0.4, -0.1, 0.2), WRIST_DOWN);
    for each in [false, true] {
        let options = PlanOptions { each, base_from_workspace: Some(base_from_workspace), ..PlanOptions::default() };
        let plan = planner.plan(&observation, &options).unwrap();
        for (number, object) in plan.objects.iter().enumerate() {
            let own = plan.grasps.iter().filter(|ranked| ranked.object == Some(number));
            let qualities: Vec<f32> = own.map(|ranked| ranked.quality).collect();
            assert_eq!(object.grasp_count, qualities.len());
            assert_eq!(object.quality_best, qualities.iter().copied().reduce(f32::max));
            assert_eq!(object.reason.is_some(), qualities.is_empty(), "{object:?}");
            assert_eq!(object.base_centroid_m, Some(base_from_workspace * object.centroid_m));
        }
        let held = plan.objects.iter().filter(|object| object.grasp_count > 0).count();
        let firsts: std::collections::BTreeSet<_> =
            plan.grasps.iter().take(held).filter_map(|ranked| ranked.object).collect();
        assert!(held > 1 && plan.grasps.len() > held, "{:?}", plan.objects);
        assert!(!each || firsts.len() == held, "{firsts:?} of {held}");
        assert_eq!(
            plan.grasps.iter().map(|ranked| ranked.rank).collect::<Vec<_>>(),
            (1..=plan.grasps.len()).collect::<Vec<_>>()
        );
    }
}

#[test]
fn a_previous_grasp_that_is_as_good_as_the_best_comes_first() {
    let planner = judge(config());
    let observation = input::assemble(&demo::request().unwrap(), None, Grid::PAPER).unwrap().observation;
    let plan = |previous: Option<Pose>| {
        let options = PlanOptions { previous, ..PlanOptions::default() };
        planner.plan(&observation, &options).unwrap().grasps
    };
    let first = plan(None);
    let (best, far_m) = (&first[0], |one: &planner::plan::RankedGrasp| {
        (one.workspace_from_grasp.translation - first[0].workspace_from_grasp.translation).length()
    });
    let another = first.iter().rfind(|one| one.quality > best.quality - 0.01 && far_m(one) > 0.02).unwrap();
    let again = &plan(Some(another.workspace_from_grasp))[0];
    assert!(schema::are_alike(&again.workspace_from_grasp, &another.workspace_from_grasp, 0.01, 0.26), "{again:?}");
    // The best stays the best, and a place where nothing is changes little.
    let again = &plan(Some(best.workspace_from_grasp))[0];
    assert!(schema::are_alike(&again.workspace_from_grasp, &best.workspace_from_grasp, 0.01, 0.26), "{again:?}");
    let nowhere = Pose::from_parts(Vec3::new(0.15, 0.15, 0.4), WRIST_DOWN);
    assert!(plan(Some(nowhere))[0].quality > best.quality - 0.06);
}

/// Few proposals or many, a limit that none, some or all grasps keep, an object that is or is not there, grasps
/// that failed, ε that none or some reach: the reason is always the first stage that nothing passed.
#[test]
fn the_reason_is_that_of_the_first_stage_that_nothing_passed() {
    let observation = input::assemble(&demo::request().unwrap(), None, Grid::PAPER).unwrap().observation;
    let cone = |z: f32, angle_rad_max: f32| Some(Cone { direction: Vec3::Z * z, angle_rad_max });
    let approaches = [None, cone(-1.0, 0.6), cone(1.0, 0.01)];
    let mut seen = std::collections::BTreeSet::new();
    for (proposals, epsilon) in [(8, None), (256, None), (256, Some(1.0))] {
        let mut config = config();
        config.judge.proposals = proposals;
        config.detection.quality_min = epsilon.unwrap_or(config.detection.quality_min);
        let least = config.detection.quality_min;
        let planner = judge(config);
        let plan = |avoid: &[Pose], limits: &Limits| {
            let options =
                PlanOptions { explain: true, avoid: avoid.to_vec(), limits: limits.clone(), ..Default::default() };
            planner.plan(&observation, &options).unwrap()
        };
        let middle = plan(&[], &Limits::default()).grasps.first().map(|best| best.workspace_from_grasp.translation);
        let targets =
            [None, Some(Target::Point(middle.unwrap_or(Vec3::splat(0.15)))), Some(Target::Point(Vec3::splat(0.29)))];
        for (approach, target) in
            approaches.iter().flat_map(|approach| targets.iter().map(move |target| (approach, target)))
        {
            let limits = Limits { approach: *approach, target: target.clone(), ..Limits::default() };
            let free = plan(&[], &limits);
            let dropped = free.dropped.iter().filter(|one| one.quality >= least).map(|one| one.workspace_from_grasp);
            let all: Vec<Pose> = free.grasps.iter().map(|one| one.workspace_from_grasp).chain(dropped).collect();
            for answer in [plan(&all, &limits), free] {
                let failed = answer.funnel.0.iter().find(|(_, count)| *count == 0).map(|(stage, _)| *stage);
                let reason = answer.reason.unwrap_or_default();
                let expected = match failed {
                    None => "",
                    Some("proposed") if approach.is_some() || target.is_some() => "no grasp candidate keeps the limits",
                    Some("proposed") => "no collision-free grasp candidate",
                    Some("quality_reached") => "no grasp has a quality of",
                    Some("found") => "like grasps that failed",
                    Some(other) => panic!("{other}: {reason}"),
                };
                assert!(reason.contains(expected) && reason.is_empty() == failed.is_none(), "{failed:?}: {reason}");
                seen.insert(failed);
            }
        }
    }
    assert_eq!(seen.into_iter().collect::<Vec<_>>(), [None, Some("found"), Some("proposed"), Some("quality_reached")]);
}

#[test]
fn an_empty_table_has_no_grasps_and_says_so() {
    let grid = Grid::PAPER;
    let value = |flat: usize| {
        let tsdf = (grid.centre_m([flat / 1600, flat / 40 % 40, flat % 40]).z - grid.table_z_m) / 0.03;
        if tsdf.abs() < 0.98 { 0.5 * (tsdf + 1.0) } else { 0.0 }
    };
    let table = VoxelGrid::new(grid, (0..grid.len()).map(value).collect()).unwrap();
    let plan = judge(config()).plan(&Observation::Tsdf(table), &PlanOptions::default()).unwrap();
    assert!(plan.grasps.is_empty());
    assert!(plan.reason.is_some() && plan.funnel.count("proposed") == Some(0), "{:?}", plan.funnel);
}

#[test]
fn a_judge_of_another_gripper_is_refused_and_both_are_named() {
    let mut config = config();
    config.gripper = Gripper::from_toml(Gripper::BUILT_IN[1].1).unwrap();
    let error = Planner::new(&file("models/judge.safetensors"), config).unwrap_err();
    assert_eq!(error.exit_code(), ExitCode::Config);
    let text = error.to_string();
    assert!(text.contains("parallel_jaw_80") && text.contains("robotiq_2f_85"), "{text}");
}

#[test]
fn grippers_without_a_judge_of_their_own_share_one_within_its_ranges() {
    let of = |gripper: Gripper| Planner::built_in(Config { gripper, ..config() });
    let models = Gripper::BUILT_IN.map(|(name, text)| (name, of(Gripper::from_toml(text).unwrap()).unwrap().model_id));
    let (own, shared): (Vec<_>, Vec<_>) =
        models.iter().partition(|(name, _)| ["parallel_jaw_80", "so_101"].contains(name));
    assert!(own.len() == 2 && own[0].1 != own[1].1 && shared.iter().all(|(_, id)| *id == shared[0].1));
    assert!(own.iter().all(|(_, id)| *id != shared[0].1));
    let huge = Gripper { opening_m_max: 0.3, palm_breadth_m: 0.3, name: "huge".to_owned(), ..config().gripper };
    let error = of(huge).unwrap_err().to_string();
    assert!(["huge", "opening_m_max", "0.3"].iter().all(|part| error.contains(part)), "{error}");
}

#[test]
fn a_network_of_voxels_says_that_it_was_trained_for_another_gripper() {
    let observation = input::assemble(&demo::request().unwrap(), None, Grid::PAPER).unwrap().observation;
    let warnings = |gripper: Option<Gripper>| {
        let paper = BuiltIn::Paper.config().unwrap();
        let planner = Planner::built_in(Config { gripper: gripper.unwrap_or(paper.gripper.clone()), ..paper }).unwrap();
        planner.plan(&observation, &PlanOptions::default()).unwrap().warnings
    };
    assert_eq!(warnings(None), Vec::<String>::new());
    let warning = &warnings(Some(Gripper::from_toml(Gripper::BUILT_IN[1].1).unwrap()))[0];
    assert!(["paper", "parallel_jaw_80", "robotiq_2f_85"].iter().all(|part| warning.contains(part)), "{warning}");
}

#[test]
fn weights_of_the_other_kind_are_refused_and_both_are_named() {
    for (named, model) in [(BuiltIn::Judge, "paper-200k"), (BuiltIn::Paper, "judge")] {
        let file = file(&format!("models/{model}.safetensors"));
        let error = Planner::new(&file, named.config().unwrap()).unwrap_err();
        assert_eq!(error.exit_code(), ExitCode::Config);
        let text = error.to_string();
        assert!(text.contains(&format!("\"{}\"", named.name())) && text.contains(model), "{text}");
    }
}

/// The three faces of a box of 40 x 40 x 60 mm, 0.6 m before a camera that looks down at it; no table.
#[test]
fn an_object_alone_is_planned_afloat_and_says_so() {
    let half = core::f32::consts::FRAC_1_SQRT_2;
    let (right, ahead, up) = (Vec3::X, Vec3::new(0.0, -half, half), Vec3::new(0.0, -half, -half));
    let sheet = |corner: Vec3, edges: [Vec3; 2]| {
        (0..400).map(move |n| corner + edges[0] * ((n % 20) as f32 / 20.0) + edges[1] * ((n / 20) as f32 / 20.0))
    };
    let (low, size) = (Vec3::new(-0.01, 0.0, 0.6), [right * 0.04, ahead * 0.04, up * 0.06]);
    let faces = [(low, [size[0], size[2]]), (low, [size[1], size[2]]), (low + size[2], [size[0], size[1]])];
    let points_m: Vec<Vec3> = faces.into_iter().flat_map(|(corner, edges)| sheet(corner, edges)).collect();
    let seen = Observation::Cloud { points_m: points_m.clone(), eyes_m: Vec::new() };
    let options = PlanOptions { find_table: Some(FindTable::default()), ..PlanOptions::default() };
    let plan = judge(config()).plan(&seen, &options).unwrap();
    assert!(plan.warnings[0].contains("one object and no table under it"), "{:?}", plan.warnings);
    assert!(plan.funnel.count("proposed") > Some(0), "{:?}", plan.reason);
    for grasp in &plan.grasps {
        let tips_m = grasp.camera_from_grasp.unwrap().translation;
        assert!(points_m.iter().any(|at_m| at_m.distance(tips_m) < 0.045), "{tips_m}");
    }
}
