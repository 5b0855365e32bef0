//! A shard is a pure function of code, config, seed and shard id: not of threads, order, interruption or restart.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use super::{check_ok, files, run, signalled, small_config, workshop};

fn assert_same(a: &Path, b: &Path) {
    let (a, b) = (files(a), files(b));
    let names = |files: &[(std::path::PathBuf, Vec<u8>)]| files.iter().map(|f| f.0.clone()).collect::<Vec<_>>();
    assert_eq!(names(&a), names(&b));
    for ((name, left), (_, right)) in a.iter().zip(&b) {
        assert!(left == right, "{} differs", name.display());
    }
}

#[test]
fn one_thread_two_threads_and_shards_in_any_order_give_the_same_bytes() {
    let dir = workshop(&small_config());
    check_ok(&run(&dir, "one", &["--threads", "1"]));
    check_ok(&run(&dir, "two", &["--threads", "2"]));
    for index in ["2", "0-1"] {
        check_ok(&run(&dir, "apart", &["--shard-index", index]));
    }
    assert!(files(&dir.path().join("one")).len() >= 9 + 3 + 3, "three tables, markers, info, manifest, card");
    assert_same(&dir.path().join("one"), &dir.path().join("two"));
    assert_same(&dir.path().join("one"), &dir.path().join("apart"));
}

/// Kills the generator by `signal` once its first shard is there, and runs it again.
fn killed_and_resumed(signal: &str) {
    let dir = workshop(&small_config().replace("attempts = 70", "attempts = 6_000"));
    check_ok(&run(&dir, "whole", &[]));
    let (ended, _) = signalled(&dir, "killed", "1", signal, Duration::ZERO);
    if signal == "-TERM" {
        assert_eq!(ended.status.code(), Some(75), "a stopped run says: run again");
    }
    assert!(!dir.path().join("killed/meta/manifest.json").exists(), "the run was killed too late to show anything");
    check_ok(&run(&dir, "killed", &[]));
    assert_same(&dir.path().join("whole"), &dir.path().join("killed"));
}

#[test]
fn a_killed_run_continues_to_the_same_bytes() {
    killed_and_resumed("-KILL");
}

#[test]
fn a_stopped_run_continues_to_the_same_bytes() {
    killed_and_resumed("-TERM");
}

#[test]
fn a_complete_dataset_is_left_alone() {
    let dir = workshop(&small_config());
    check_ok(&run(&dir, "ds", &[]));
    let before = files(&dir.path().join("ds"));
    assert!(check_ok(&run(&dir, "ds", &[])).contains("complete already"));
    assert!(before == files(&dir.path().join("ds")));
}

/// Digests of the small dataset's attempts by either engine. They change when scenes, rules, physics or the format do:
/// then say so in CHANGELOG.md and raise the version, since old and new shards must not be mixed.
const GOLDEN: [(&str, &str, &str); 2] = [
    ("stepper", "solver_iterations = 4\n", "b926bb53ba136436cd51155d491e495cf5dc636c50857a24649d5642f7ef5071"),
    ("rapier", "solver_iterations = 8\n", "8f6a181280bea284e3f1aa5c96f669c786d6a39bda396bbbd96bfce45f654010"),
];

#[test]
#[cfg(target_arch = "x86_64")]
fn the_small_dataset_has_its_golden_digest() {
    for (engine, settling, golden) in GOLDEN {
        let config = small_config().replace("engine = \"stepper\"", &format!("engine = {engine:?}"));
        let dir = workshop(&config.replace("solver_iterations = 4\n", settling));
        check_ok(&run(&dir, "ds", &[]));
        let digest =
            Command::new("sha256sum").arg(dir.path().join("ds/attempts/shard-00001-of-00003.parquet")).output();
        let digest = String::from_utf8(digest.unwrap().stdout).unwrap();
        assert_eq!(digest.split_whitespace().next(), Some(golden), "{engine}");
    }
}
