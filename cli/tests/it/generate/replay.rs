//! `replay`: stored attempts are shown as executed, and wrong rows are found.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};

use base64::Engine as _;
use generator::{AttemptId, Config};
use report::view::{Body, Class, EventKind, View};
use schema::{Approach, Axis, ObjectRecord, Outcome, Pose, Rule, SceneRows, ShapeKind, Solid, Vec3, axis_angle};
use shards::Dataset;
use simulator::{AttemptWorld, Scene};

use super::commands::{lying_dataset, program};
use super::{check_ok, run, small, small_config, workshop};

/// As [`small_config`], with more scenes and more objects in each.
fn crowded_config() -> String {
    small_config().replace("attempts = 70", "attempts = 480").replace("counts = [1, 2] ", "counts = [2, 6] ")
}

fn id(scene_id: u64, attempt_id: u32) -> AttemptId {
    AttemptId { scene_id, attempt_id }
}

fn check_view(view: &View, outcome: Outcome) {
    let frames = view.frames.len();
    assert!(view.frames.windows(2).all(|pair| pair[0].time_s < pair[1].time_s), "{}: time increases", view.title);
    assert!(view.events.iter().all(|event| event.frame < frames), "{}", view.title);
    assert!(view.events.is_sorted_by_key(|event| event.frame), "{}", view.title);
    for body in &view.bodies {
        assert!(body.poses.len() == 1 || body.poses.len() == frames, "{}: {}", view.title, body.label);
    }
    for points in &view.points {
        assert!(points.frames.is_none_or(|[first, last]| first <= last && last < frames), "{}", points.label);
    }
    let decided: Vec<_> =
        view.events.iter().filter(|e| matches!(e.kind, EventKind::Held | EventKind::Failed)).collect();
    assert_eq!(decided.len(), 1, "{}", view.title);
    assert_eq!(decided[0].kind == EventKind::Held, outcome == Outcome::Held);
    assert!(decided[0].text.starts_with(outcome.name()), "{}", decided[0].text);
    let bodies = |class| view.bodies.iter().filter(|body| body.class == class).count();
    assert_eq!((bodies(Class::Gripper), bodies(Class::Target), bodies(Class::Table)), (3, 1, 1));
    let is_stopped = matches!(outcome, Outcome::PregraspCollision | Outcome::ApproachCollision);
    let is_told = view.events.iter().any(|event| event.text.contains("within its clearance of"));
    assert_eq!(is_told, is_stopped, "{}", view.title);
}

#[test]
fn every_kind_of_end_is_reproduced_and_shown() {
    let dir = workshop(&crowded_config());
    check_ok(&run(&dir, "ds", &[]));
    let dataset = Dataset::open(&dir.path().join("ds")).unwrap();
    let mut seen: BTreeMap<Outcome, u32> = BTreeMap::new();
    for shard in 0..dataset.shard_count() {
        for row in dataset.attempts_by_scene(shard).unwrap().flat_map(Result::unwrap) {
            let count = seen.entry(row.outcome).or_default();
            *count += 1;
            if *count > 6 {
                continue;
            }
            let (replayed, view) = inspect::replayed(&dataset, id(row.scene_id, row.attempt_id)).unwrap();
            assert!(replayed.is_reproduced(), "{:?} instead of {row:?}", replayed.now);
            assert_eq!(replayed.stored, row);
            check_view(&view, row.outcome);
            assert!(replayed.describe().ends_with(&format!(
                "as stored: {}\n",
                view.facts.iter().find(|fact| fact.key == "now").unwrap().value
            )));
        }
    }
    // Objects raised with the target are rare in random scenes; a test below has one.
    assert_eq!(seen.len(), Outcome::ALL.len() - 1, "not every outcome occurs: {seen:?}");
    assert!(!seen.contains_key(&Outcome::HitOther), "{seen:?}");
}

/// Every scene becomes a block with a plate on it, every attempt one that takes the block from above.
fn stack(config: &Config, rows: &mut SceneRows) {
    let (solid, id) =
        (|size: [f32; 3]| Solid::new(ShapeKind::Cuboid, Vec3::from_array(size)).unwrap(), rows.scene.scene_id);
    let object = |object_id: u32, size: [f32; 3], z_m: f32, mass_kg: f32| ObjectRecord {
        scene_id: id,
        object_id,
        shape: solid(size).into(),
        mass_kg,
        friction: 1.0,
        workspace_from_object: Pose::from_translation(Vec3::new(0.15, 0.15, z_m)),
    };
    rows.objects = vec![object(0, [0.04, 0.04, 0.06], 0.08, 0.2), object(1, [0.04, 0.03, 0.01], 0.115, 0.03)];
    (rows.scene.object_count, rows.scene.dropped_count) = (2, 2);
    let scene = Scene::from_records(config.grid.table_z_m, rows.scene.fixtures(&config.grid), &rows.objects, &[]);
    let world = AttemptWorld::new(&config.physics, config.gripper.of_scene(0), &config.procedure, &scene);
    let above = Pose::from_parts(Vec3::new(0.15, 0.15, 0.085), axis_angle(Vec3::X, core::f32::consts::PI));
    let ended = world.execute(&above, 0);
    for attempt in &mut rows.attempts {
        (attempt.object_id, attempt.workspace_from_grasp) = (0, above);
        attempt.rule = Rule { shape: ShapeKind::Cuboid.into(), approach: Approach::Axis(Axis::Z) };
        attempt.closing = Some(Axis::Y);
        (attempt.outcome, attempt.width_m) = (ended.outcome, ended.width_m);
        attempt.hit = ended.hit.map(|hit| hit.kind);
        attempt.hit_object_id = ended.hit.and_then(|hit| hit.object_id).map(|id| id as u32);
    }
}

#[test]
fn what_is_raised_with_the_target_is_reproduced_and_shown() {
    let dir = workshop(&small_config());
    let config = small();
    lying_dataset(&config, &dir.path().join("stacks"), |rows| stack(&config, rows));
    let dataset = Dataset::open(&dir.path().join("stacks")).unwrap();
    let (replayed, view) = inspect::replayed(&dataset, id(2, 5)).unwrap();
    assert_eq!((replayed.now.outcome, replayed.stored.hit_object_id), (Outcome::HitOther, Some(1)));
    assert!(replayed.is_reproduced(), "{:?} instead of {:?}", replayed.now, replayed.stored);
    check_view(&view, Outcome::HitOther);
    let plate = view.bodies.iter().find(|body| body.class == Class::Hit).unwrap();
    assert!(plate.label.starts_with("object 1: cuboid"), "{}", plate.label);
    let raised_m = plate.poses.last().unwrap()[2] - plate.poses[0][2];
    assert!((raised_m - 0.1).abs() < 0.005, "the plate goes up by the retreat, by {raised_m} m");
    assert!(replayed.describe().contains("object 1 was moved by "), "{}", replayed.describe());
}

fn replayed(dir: &Path, dataset: &str, flags: &[&str]) -> Output {
    program(&[&["replay", dataset], flags].concat(), dir)
}

fn assert_fails(output: &Output, code: i32, part: &str) {
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{message}");
    assert!(message.contains(part), "{part:?} is not in:\n{message}");
}

#[test]
fn a_page_or_json_is_written_and_what_is_not_there_is_told() {
    let dir = workshop(&small_config());
    check_ok(&run(&dir, "ds", &[]));
    let text = check_ok(&replayed(dir.path(), "ds", &["--attempt", "1/3", "--out", "a.html"]));
    assert!(text.contains("approach") && text.contains("\nas stored: "), "{text}");
    let page = std::fs::read_to_string(dir.path().join("a.html")).unwrap();
    assert!(page.starts_with("<!DOCTYPE html>") && page.contains("1/3: "), "{}", &page[..200]);

    let json = check_ok(&replayed(dir.path(), "ds", &["--attempt", "1/3", "--json"]));
    let view: View = serde_json::from_str(&json).unwrap();
    assert!(page.contains(&json.trim_end().replace('<', "\\u003c")), "the page shows what the JSON says");
    assert!(view.title.starts_with("1/3: "), "{}", view.title);
    check_ok(&replayed(dir.path(), "ds", &["--attempt", "1/3", "--json", "--out", "a.json"]));
    assert_eq!(std::fs::read_to_string(dir.path().join("a.json")).unwrap(), json);

    assert_fails(&replayed(dir.path(), "ds", &["--attempt", "1/12"]), 78, "attempt must be below 12, got 12");
    assert_fails(&replayed(dir.path(), "ds", &["--attempt", "6/0"]), 78, "scene must be below 6, got 6");
    assert_fails(&replayed(dir.path(), "ds", &["--attempt", "6"]), 2, "must be SCENE/ATTEMPT");
    assert_fails(&replayed(dir.path(), "nowhere", &["--attempt", "0/0"]), 78, "no dataset here");
    let nowhere = replayed(dir.path(), "ds", &["--attempt", "1/3", "--out", "no/a.html"]);
    assert_fails(&nowhere, 78, "failed to write");
}

/// A replay out of the page of its scene, with the shapes that it leaves to the scene, and poses for differences.
fn unpacked(page: &str, attempt: u32) -> View {
    let element = |start: &str| page.split(start).nth(1).unwrap().split("</script>").next().unwrap();
    let scene: View = serde_json::from_str(element("<script id=\"view\" type=\"application/json\">")).unwrap();
    let packed = element(&format!("<script id=\"replay-{attempt}\" type=\"text/plain\">"));
    let bytes = base64::engine::general_purpose::STANDARD.decode(packed).unwrap();
    let mut replay: View = serde_json::from_reader(flate2::read::ZlibDecoder::new(bytes.as_slice())).unwrap();
    for (at, body) in replay.bodies.iter_mut().enumerate() {
        if body.corners_m.is_empty() {
            let (class, poses) = (body.class, std::mem::take(&mut body.poses));
            *body = Body { class, poses, ..scene.bodies[at].clone() };
        }
        let (mut pose, is_moving) = ([0.0; 7], body.poses.len() > 1);
        for step in body.poses.iter_mut().filter(|_| is_moving) {
            pose = std::array::from_fn(|part| pose[part] + step[part]);
            *step = pose.map(|parts| parts / 1e5);
        }
    }
    replay
}

#[test]
fn the_page_of_a_scene_has_the_replays_of_all_its_attempts() {
    let dir = workshop(&crowded_config());
    check_ok(&run(&dir, "ds", &[]));
    let browsed = Command::new(env!("CARGO_BIN_EXE_graspmill"))
        .current_dir(dir.path())
        .args(["dataset", "browse", "ds", "--out", "pages"])
        .output()
        .unwrap();
    check_ok(&browsed);
    assert!(browsed.stderr.is_empty(), "every attempt ends as stored: {browsed:?}");
    let dataset = Dataset::open(&dir.path().join("ds")).unwrap();
    let page = |scene: u64| std::fs::read_to_string(dir.path().join(format!("pages/scene-{scene}.html"))).unwrap();
    for scene in 0..dataset.info().scene_count {
        let page = page(scene);
        for attempt in 0..dataset.info().attempts_of_scene(scene) {
            assert!(page.contains(&format!("<script id=\"replay-{attempt}\"")), "{scene}/{attempt}");
            assert!(page.contains(&format!("<a href=\"#attempt={attempt}\"")), "{scene}/{attempt}");
        }
        assert!(!page.contains("getContext"), "the folder has the script");
    }
    let files = std::fs::read_dir(dir.path().join("pages")).unwrap().map(|entry| entry.unwrap().metadata().unwrap());
    let bytes: u64 = files.map(|file| file.len()).sum();
    let per_hundred = bytes * 100 / dataset.info().attempt_count;
    assert!(per_hundred <= 1_000_000, "{per_hundred} bytes for 100 attempts");

    let short = unpacked(&page(4), 3);
    let single = check_ok(&replayed(dir.path(), "ds", &["--attempt", "4/3", "--json"]));
    let whole: View = serde_json::from_str(&single).unwrap();
    assert_eq!((&short.title, &short.events, short.bodies.len()), (&whole.title, &whole.events, whole.bodies.len()));
    for (short, whole) in short.bodies.iter().zip(&whole.bodies) {
        assert_eq!((&short.label, &short.corners_m, &short.faces), (&whole.label, &whole.corners_m, &whole.faces));
        let pairs = short.poses.as_flattened().iter().zip(whole.poses.as_flattened());
        assert!(pairs.clone().all(|(a, b)| (a - b).abs() <= 6e-6), "{}", whole.label);
    }
    assert_eq!(replayed(dir.path(), "ds", &[]).status.code(), Some(2));
}

#[test]
fn a_row_that_lies_by_a_bit_is_found() {
    let dir = workshop(&small_config());
    let config = small();
    let mut lie_at = None;
    lying_dataset(&config, &dir.path().join("lying"), |rows| {
        let held = rows.attempts.iter_mut().find(|attempt| attempt.outcome == Outcome::Held);
        if let (None, Some(held)) = (lie_at, held) {
            held.width_m = held.width_m.map(|width_m| f32::from_bits(width_m.to_bits() + 1));
            lie_at = Some((held.scene_id, held.attempt_id));
        }
    });
    let (scene, attempt) = lie_at.unwrap();
    let lie = replayed(dir.path(), "lying", &["--attempt", &format!("{scene}/{attempt}"), "--out", "a.html"]);
    assert_eq!(lie.status.code(), Some(65), "{lie:?}");
    let text = String::from_utf8_lossy(&lie.stdout);
    assert!(text.contains("NOT as stored: stored held"), "{text}");
    let page = std::fs::read_to_string(dir.path().join("a.html")).unwrap();
    assert!(page.contains("<dt>reproduced</dt><dd>NO</dd>"), "the page is written and says so");
    let json = replayed(dir.path(), "lying", &["--attempt", &format!("{scene}/{attempt}"), "--json"]);
    assert_fails(&json, 65, "NOT as stored");
    let truth = if attempt == 0 { 1 } else { 0 };
    check_ok(&replayed(dir.path(), "lying", &["--attempt", &format!("{scene}/{truth}")]));
}
