//! The `generator` binary, run as a user runs it: the same bytes however it runs, and one clear message for bad input.

mod annotate;
mod bad_input;
mod cluster;
mod commands;
mod determinism;
mod heaps;
mod labels;
mod objects;
mod replay;
mod stopping;

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use generator::{Config, Overrides};
use settings::Document;
use shards::layout;
use tempfile::TempDir;

use crate::sample::files;

/// The paper's config at a size for tests: six scenes of twelve attempts on a coarse grid, in three shards; with the
/// objects and closings of 0.3.0, whose bytes it keeps.
fn small_config() -> String {
    include_str!("../../../configs/generate/paper.toml")
        .replace("shards = 64", "shards = 3")
        .replace("attempts = 200_000", "attempts = 70")
        .replace("attempts_per_scene = 60", "attempts_per_scene = 12")
        .replace("resolution = 40 ", "resolution = 16 ")
        .replace("counts = [1, 6] ", "counts = [1, 2] ")
        .replace("rule_closing = \"narrowest\"", "rule_closing = \"drawn\"")
        .replace("spanned_share = 1.0", "spanned_share = 0.0")
        .replace("count_weights = [5.0, 3.0, 2.0, 1.0, 1.0]", "count_weights = [1.0, 1.0, 1.3, 1.3, 1.3]")
        .replace("size_m = [0.03, 0.13]", "size_m = [0.03, 0.08]")
}

/// [`small_config`], read.
fn small() -> Config {
    let document = Document::parse(&small_config(), Path::new("small.toml")).unwrap();
    Config::read(document, Overrides::default()).unwrap()
}

/// A folder with `config.toml`, and room for datasets.
fn workshop(config: &str) -> TempDir {
    let dir = TempDir::new().unwrap();
    std::fs::write(dir.path().join("config.toml"), config).unwrap();
    dir
}

fn generator(dir: &TempDir, out: &str, flags: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_generator"));
    command.current_dir(dir.path()).args(["--config", "config.toml", "--out", out]).args(flags);
    without_index(&mut command);
    command
}

/// These tests may run as a task of a scheduler.
fn without_index(command: &mut Command) {
    for name in ["SHARD_INDEX", "SLURM_ARRAY_TASK_ID", "JOB_COMPLETION_INDEX", "AWS_BATCH_JOB_ARRAY_INDEX"] {
        command.env_remove(name);
    }
}

fn run(dir: &TempDir, out: &str, flags: &[&str]) -> Output {
    generator(dir, out, flags).output().unwrap()
}

/// Runs the generator, and signals it this long after the first of its shards is committed. Its output, and how long it
/// took to end.
fn signalled(dir: &TempDir, out: &str, threads: &str, signal: &str, after: Duration) -> (Output, Duration) {
    let child = generator(dir, out, &["--threads", threads]).stdout(Stdio::piped()).spawn().unwrap();
    let committed = |shard| dir.path().join(out).join(layout::marker(shard)).exists();
    let began = Instant::now();
    while !(0..6).any(committed) {
        assert!(began.elapsed() < Duration::from_secs(120), "no shard came");
        std::thread::sleep(Duration::from_millis(5));
    }
    std::thread::sleep(after);
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    let began = Instant::now();
    (child.wait_with_output().unwrap(), began.elapsed())
}

/// The program ends with a code and a message that has all these parts.
fn check_fails(output: &Output, code: i32, expected: &[&str]) {
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{message}");
    for part in expected {
        assert!(message.contains(part), "{part:?} is not in:\n{message}");
    }
    assert!(!message.contains("panicked"), "{message}");
}

fn check_ok(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}
