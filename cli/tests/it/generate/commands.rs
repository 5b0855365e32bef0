//! `bench` and `repeat`.

use std::path::Path;
use std::process::Command;

use generator::{Config, make_scene};
use schema::{Outcome, SceneRows};

use super::{check_ok, run, small, small_config, workshop};

pub(crate) fn program(arguments: &[&str], dir: &Path) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_generator")).current_dir(dir).args(arguments).output().unwrap()
}

/// A dataset of which `lie` changes every scene's rows before they are written.
pub(crate) fn lying_dataset(config: &Config, at: &Path, mut lie: impl FnMut(&mut SceneRows)) {
    let info = config.dataset_info();
    let draft = shards::Draft::begin(at, &info).unwrap();
    for shard in 0..info.shard_count {
        let mut writer = draft.shard(shard).unwrap();
        for scene_id in info.scenes_of(shard) {
            let mut rows = make_scene(config, scene_id, info.attempts_of_scene(scene_id)).unwrap();
            lie(&mut rows);
            writer.push(&rows).unwrap();
        }
        writer.commit().unwrap();
    }
    draft.finalize().unwrap();
}

#[test]
fn a_bench_measures_runs_stages_outcomes_and_shortcuts() {
    let dir = workshop(&small_config());
    let flags = ["bench", "--config", "config.toml", "--attempts", "120", "--repeat", "60", "--threads", "2", "--json"];
    let report: serde_json::Value = serde_json::from_str(&check_ok(&program(&flags, dir.path()))).unwrap();
    let sum = |list: &str, key: &str| -> f64 {
        report[list].as_array().unwrap().iter().map(|cost| cost[key].as_f64().unwrap()).sum()
    };
    let stage = |number: usize, key: &str| report["stages"][number][key].as_f64().unwrap();
    assert_eq!((report["runs"][0]["count"].as_u64(), report["runs"][1]["count"].as_u64()), (Some(120), Some(120)));
    assert_eq!((sum("outcomes", "count"), stage(3, "count") + stage(4, "count")), (120.0, 120.0));
    assert_eq!(sum("outcomes", "steps"), stage(4, "steps"));
    assert!((sum("outcomes", "total_s") - stage(3, "total_s") - stage(4, "total_s")).abs() < 1e-9);
    assert_eq!(report["without_shortcuts"]["attempts"], 60);
    assert!(report["without_shortcuts"]["same_label"].as_u64().unwrap() >= 57, "{}", report["without_shortcuts"]);
    assert!(report["bytes"].as_u64().unwrap() > 10_000);

    let flags = ["bench", "--config", "config.toml", "--attempts", "60", "--repeat", "0", "--threads", "1"];
    let text = check_ok(&program(&flags, dir.path()));
    for part in ["| settle ", "| pregrasp_collision "] {
        assert!(text.contains(part), "{part:?} is not in:\n{text}");
    }
}

#[test]
fn attempts_executed_again_end_as_stored_and_a_lie_is_found() {
    let dir = workshop(&small_config());
    check_ok(&run(&dir, "ds", &[]));
    assert!(check_ok(&program(&["repeat", "ds"], dir.path())).starts_with("70 attempts executed again"));
    let by_rapier = check_ok(&program(&["repeat", "ds", "--engine", "rapier"], dir.path()));
    assert!(by_rapier.starts_with("70 attempts executed again"), "{by_rapier}");
    assert!(check_ok(&program(&["repeat", "ds", "--scenes", "2"], dir.path())).starts_with("24 attempts"));
    let missing = program(&["repeat", "nowhere"], dir.path());
    assert_eq!(missing.status.code(), Some(78), "{missing:?}");
    assert!(String::from_utf8_lossy(&missing.stderr).contains("no dataset here"));

    // A dataset in which one held attempt is stored as slipped.
    let config = small();
    let mut has_lied = false;
    lying_dataset(&config, &dir.path().join("lying"), |rows| {
        if let Some(held) = rows.attempts.iter_mut().find(|a| !has_lied && a.outcome == Outcome::Held) {
            held.outcome = Outcome::Slipped;
            has_lied = true;
        }
    });
    let found = program(&["repeat", "lying"], dir.path());
    assert_eq!(found.status.code(), Some(65), "{found:?}");
    let text = String::from_utf8_lossy(&found.stdout);
    assert!(text.contains("1 end otherwise than stored") && text.contains("stored slipped, now held"), "{text}");
}
