//! What is in a generated dataset: the rows say what was executed, and executing them again ends the same.

use std::path::Path;
use std::process::Command;

use generator::{Config, Overrides, make_scene};
use schema::Outcome;
use settings::Document;
use shards::Dataset;
use simulator::{AttemptWorld, Scene};

use super::{check_ok, run, small, small_config, workshop};

#[test]
fn stored_rows_executed_again_end_the_same() {
    let text = small_config().replace("\"parallel_jaw_80\"", "[\"parallel_jaw_80\", \"slim_jaw_50\"]");
    let several = Config::read(Document::parse(&text, Path::new("small.toml")).unwrap(), Overrides::default()).unwrap();
    let grippers = several.gripper.all();
    for (config, scene_id, gripper) in
        [(&small(), 3, &grippers[0]), (&several, 2, &grippers[0]), (&several, 3, &grippers[1])]
    {
        let rows = make_scene(config, scene_id, 60).unwrap();
        let scene = Scene::from_records(config.grid.table_z_m, rows.scene.fixtures(&config.grid), &rows.objects, &[]);
        let world = AttemptWorld::new(&config.physics, gripper, &config.procedure, &scene);
        for attempt in &rows.attempts {
            let again = world.execute(&attempt.workspace_from_grasp, attempt.object_id as usize);
            assert_eq!((again.outcome, again.width_m), (attempt.outcome, attempt.width_m), "{attempt:?}");
        }
    }
}

#[test]
fn a_dataset_of_several_grippers_can_be_executed_again_and_replayed() {
    let text = small_config().replace("\"parallel_jaw_80\"", "[\"parallel_jaw_80\", \"slim_jaw_50\", \"wsg_50\"]");
    let dir = workshop(&text);
    check_ok(&run(&dir, "ds", &[]));
    let program = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_generator"));
        check_ok(&command.current_dir(dir.path()).args(arguments).output().unwrap())
    };
    let again = program(&["repeat", "ds"]);
    assert!(again.contains("70 attempts") && again.contains("0 end otherwise than stored"), "{again}");
    let held = Dataset::open(dir.path().join("ds").as_path()).unwrap().read_scene(4).unwrap();
    let closed = held.attempts.iter().find(|attempt| attempt.width_m.is_some()).unwrap().attempt_id.to_string();
    let told = program(&["replay", "ds", "--attempt", &format!("4/{closed}"), "--out", "replay.html"]);
    assert!(told.contains("as stored") && !told.contains("NOT"), "{told}");
}

/// What the gripper cannot span makes a dataset of which nobody learns, and the table alone does not say so.
#[test]
fn few_positives_are_said_at_the_end_and_are_no_error() {
    let more = small_config().replace("attempts = 70", "attempts = 144");
    let wide = more.replace("size_m = [0.03, 0.08]", "size_m = [0.1, 0.13]");
    let shapes = wide.lines().find(|line| line.starts_with("shapes = ")).unwrap();
    let wide = wide.replace(shapes, "shapes = [\"cuboid\"]");
    for (text, is_few) in [(wide, true), (more, false)] {
        let output = run(&workshop(&text), "ds", &[]);
        check_ok(&output);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(said.contains("of 144 attempts held, "), is_few, "{said}");
        assert_eq!(said.contains("warning: ") && said.contains("household.toml"), is_few, "{said}");
    }
}

#[test]
fn scenes_hold_positives_and_several_kinds_of_failure() {
    let config = small();
    let attempts: Vec<_> = (0..12).flat_map(|id| make_scene(&config, id, 60).unwrap().attempts).collect();
    let share = attempts.iter().filter(|a| a.label() == 1).count() as f64 / attempts.len() as f64;
    assert!((0.1..0.45).contains(&share), "{share} positive");
    for outcome in [Outcome::PregraspCollision, Outcome::ApproachCollision, Outcome::Held] {
        assert!(attempts.iter().any(|a| a.outcome == outcome), "no {outcome:?}");
    }
    for held in attempts.iter().filter(|a| a.outcome == Outcome::Held) {
        assert!(held.width_m.is_some_and(|w| w > 0.002 && w <= 0.0801), "{held:?}");
    }
}

#[test]
fn the_last_table_tells_the_ratio_and_what_to_do_next() {
    let text = check_ok(&run(&workshop(&small_config()), "ds", &[]));
    for part in [
        "attempts",
        "70 in 6 scenes",
        "positive",
        "held",
        "rejected scenes",
        "attempts/s",
        "next: graspmill dataset verify",
    ] {
        assert!(text.contains(part), "{part:?} is not in:\n{text}");
    }
}
