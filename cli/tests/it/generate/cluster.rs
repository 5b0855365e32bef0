//! A dataset by many processes: which shards each makes, what is missing, completing.

use std::path::Path;
use std::process::{Command, Output};

use tempfile::TempDir;

use super::{check_ok, files, generator, run, small_config, without_index, workshop};

fn program(dir: &TempDir, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_generator"));
    without_index(&mut command);
    command.current_dir(dir.path()).args(arguments).output().unwrap()
}

fn missing(dir: &TempDir, more: &[&str]) -> String {
    check_ok(&program(dir, &[&["missing", "ds"], more].concat()))
}

fn says(output: &Output, code: i32, part: &str) {
    let told = [&output.stdout[..], &output.stderr[..]].concat();
    let told = String::from_utf8_lossy(&told);
    assert!(output.status.code() == Some(code) && told.contains(part), "{:?}: {told}", output.status);
}

fn assert_same(dir: &Path, one: &str, other: &str) {
    assert!(files(&dir.join(one)) == files(&dir.join(other)), "{one} and {other} differ");
}

#[test]
fn tasks_of_a_scheduler_make_the_dataset_that_one_process_makes() {
    let dir = workshop(&small_config());
    check_ok(&run(&dir, "whole", &[]));
    for (variable, index) in [("SLURM_ARRAY_TASK_ID", "2"), ("JOB_COMPLETION_INDEX", "0"), ("SHARD_INDEX", "0")] {
        let output = generator(&dir, "ds", &[]).env(variable, index).output().unwrap();
        check_ok(&output);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(told.contains(&format!("shard {index} of 3, as {variable} says")), "{told}");
    }
    assert_eq!((missing(&dir, &[]).as_str(), missing(&dir, &["--tasks", "2"]).as_str()), ("1\n", "1\n"));
    says(&program(&dir, &["finalize", "ds"]), 69, "1 shard is missing: 1");
    let output = generator(&dir, "ds", &["--task", "1/2"]).env("AWS_BATCH_JOB_ARRAY_INDEX", "0").output().unwrap();
    assert!(check_ok(&output).contains("complete: ds"), "the last one completes it");
    assert_eq!(missing(&dir, &[]), "");
    says(&program(&dir, &["finalize", "ds"]), 0, "complete: ds");
    assert_same(dir.path(), "whole", "ds");
}

#[test]
fn an_environment_that_cannot_be_is_78_and_makes_nothing() {
    let dir = workshop(&small_config());
    let with = |name: &str, value: &str| generator(&dir, "ds", &[]).env(name, value).output().unwrap();
    says(&with("SLURM_ARRAY_TASK_ID", "3"), 78, "below the number of shards, 3, got 3 from SLURM_ARRAY_TASK_ID");
    says(&with("AWS_BATCH_JOB_ARRAY_INDEX", ""), 78, "AWS_BATCH_JOB_ARRAY_INDEX must be a shard index");
    says(&run(&dir, "ds", &["--task", "2/2"]), 2, "must be below the number of tasks, 2, got 2");
    says(&run(&dir, "ds", &["--task", "0/2", "--shard-index", "1"]), 2, "cannot be used with");
    assert!(!dir.path().join("ds").exists());
    for command in ["missing", "finalize"] {
        says(&program(&dir, &[command, "ds"]), 78, "no dataset here");
    }
}

#[test]
fn a_task_without_shards_has_nothing_to_do() {
    let dir = workshop(&small_config());
    says(&run(&dir, "ds", &["--task", "7/8"]), 0, "3 shards are missing: 0-2");
}

#[test]
fn what_killed_writers_left_is_removed_when_all_is_there() {
    let dir = workshop(&small_config());
    check_ok(&run(&dir, "ds", &["--shard-index", "0"]));
    let left = dir.path().join("ds/scenes/.x#abc.tmp");
    for half in ["half a file", "of a writer that was killed as it completed the dataset"] {
        std::fs::write(&left, half).unwrap();
        check_ok(&run(&dir, "ds", &[]));
        assert!(!left.exists(), "a staging file of a complete dataset must be removed");
    }
}

/// A file-size limit fails a write instead of killing the program; nothing half-written is left.
#[test]
fn a_file_size_limit_is_75_and_without_it_the_run_goes_on() {
    let dir = workshop(&small_config());
    check_ok(&run(&dir, "whole", &[]));
    let limited = Command::new("sh")
        .current_dir(dir.path())
        .args(["-c", "ulimit -f 16; exec \"$0\" --config config.toml --out ds", env!("CARGO_BIN_EXE_generator")])
        .output()
        .unwrap();
    says(&limited, 75, "failed to write a file: ");
    check_ok(&run(&dir, "ds", &[]));
    assert_same(dir.path(), "whole", "ds");
}
