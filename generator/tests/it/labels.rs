//! What is in a generated dataset: the rows say what was executed, and executing them again ends the same.

use generator::make_scene;
use schema::Outcome;
use simulator::{AttemptWorld, Scene};

use crate::{check_ok, run, small, small_config, workshop};

#[test]
fn stored_rows_executed_again_end_the_same() {
    let config = small();
    let rows = make_scene(&config, 3, 60).unwrap();
    let scene = Scene::from_records(config.grid.table_z_m, &rows.objects, &[]);
    let world = AttemptWorld::new(&config.physics, &config.gripper, &config.procedure, &scene);
    for attempt in &rows.attempts {
        let again = world.execute(&attempt.workspace_from_grasp, attempt.object_id as usize);
        assert_eq!((again.outcome, again.width_m), (attempt.outcome, attempt.width_m), "{attempt:?}");
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
    for part in
        ["attempts", "70 in 6 scenes", "positive", "held", "rejected scenes", "attempts/s", "next: shards verify"]
    {
        assert!(text.contains(part), "{part:?} is not in:\n{text}");
    }
}
