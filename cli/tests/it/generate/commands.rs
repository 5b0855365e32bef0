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
fn a_bench_tells_runs_stages_outcomes_and_agreement() {
    let dir = workshop(&small_config());
    let flags = ["--attempts", "120", "--repeat", "60", "--threads", "2", "--json", "bench.json", "--markdown", "b.md"];
    let text = check_ok(&program(&[&["bench", "--config", "config.toml"], &flags[..]].concat(), dir.path()));
    for part in ["## Whole runs", "settle", "depth and TSDF", "Parquet", "pregrasp_collision", "everything simulated"] {
        assert!(text.contains(part), "{part:?} is not in:\n{text}");
    }
    assert_eq!(std::fs::read_to_string(dir.path().join("b.md")).unwrap(), text);
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(dir.path().join("bench.json")).unwrap()).unwrap();
    let sum = |list: &str, key: &str| -> f64 {
        json[list].as_array().unwrap().iter().map(|x| x[key].as_f64().unwrap()).sum()
    };
    assert_eq!(sum("outcomes", "count"), 120.0);
    assert!(
        (sum("outcomes", "total_s")
            - json["stages"][3]["total_s"].as_f64().unwrap()
            - json["stages"][4]["total_s"].as_f64().unwrap())
        .abs()
            < 1e-9
    );
    assert_eq!(json["agreements"][0]["attempts"], 60);
    assert!(json["agreements"][0]["same_label"].as_u64().unwrap() >= 57, "{}", json["agreements"]);
    assert!(json["bytes"].as_u64().unwrap() > 10_000 && json["step_s"].as_f64().unwrap() > 0.0);
}

#[test]
fn a_report_of_a_bench_on_a_full_disk_is_75() {
    let dir = workshop(&small_config());
    let flags = ["--attempts", "60", "--repeat", "0", "--threads", "1", "--markdown", "/dev/full"];
    let output = program(&[&["bench", "--config", "config.toml"], &flags[..]].concat(), dir.path());
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(75), "{stderr}");
    assert!(stderr.starts_with("error: failed to write /dev/full: "), "{stderr}");
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
