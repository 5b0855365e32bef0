//! A run that is stopped keeps its complete shards: the next run does not make them again, and the bytes are those of a
//! run without a stop.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use generator::{Config, Event, Overrides, Report, generate};
use settings::Document;
use tempfile::TempDir;

use super::{check_ok, files, run, signalled, small_config, workshop};

const THREADS: usize = 2;

/// So many scenes of twelve attempts.
fn config(shards: u32, scenes: u64, seed: u64) -> Config {
    let text = small_config()
        .replace("shards = 3", &format!("shards = {shards}"))
        .replace("attempts = 70", &format!("attempts = {}", 12 * scenes));
    let overrides = Overrides { seed: Some(seed), ..Overrides::default() };
    Config::read(Document::parse(&text, Path::new("small.toml")).unwrap(), overrides).unwrap()
}

/// Runs until so many scenes are built, or to the end; the report, and the scenes that it built.
fn run_until(config: &Config, dir: &Path, scenes: u64) -> (Report, u64) {
    let (stop, built) = (AtomicBool::new(false), AtomicU64::new(0));
    let on_event = |event| {
        if matches!(event, Event::Scene { .. }) && built.fetch_add(1, Ordering::Relaxed) + 1 >= scenes {
            stop.store(true, Ordering::Relaxed);
        }
    };
    let shards: Vec<u32> = (0..config.shards).collect();
    let pool = program::thread_pool(THREADS).unwrap();
    let report = pool.install(|| generate(config, dir, &shards, 1.0, &stop, &on_event)).unwrap();
    (report, built.into_inner())
}

fn whole(config: &Config) -> TempDir {
    let dir = TempDir::new().unwrap();
    run_until(config, dir.path(), u64::MAX);
    dir
}

/// Stops runs again and again. What was committed is not built again, and nothing is left of what was not.
fn check_stops(config: &Config, scenes: u64, stops: &[u64]) {
    let (whole, dir) = (whole(config), TempDir::new().unwrap());
    let mut committed = 0;
    for after in stops {
        let (report, built) = run_until(config, dir.path(), *after);
        let finished = report.stopped.expect("it was stopped");
        assert!(built >= *after, "{built} built");
        assert_eq!(report.made.scenes + finished, built, "all finished scenes are counted");
        committed += report.made.scenes;
        let left = files(dir.path()).into_iter().filter(|(path, _)| path.to_string_lossy().ends_with(".tmp")).count();
        assert_eq!(left, 0);
    }
    let (report, built) = run_until(config, dir.path(), u64::MAX);
    assert_eq!((report.stopped, committed + built), (None, scenes));
    assert!(files(whole.path()) == files(dir.path()), "the bytes differ, or something is left");
}

#[test]
fn shards_that_were_committed_are_not_made_again() {
    check_stops(&config(6, 102, 1), 102, &[40, 1, 20, 30]);
}

#[test]
fn long_shards_are_made_again() {
    check_stops(&config(2, 600, 1), 600, &[1, 140, 320]);
}

#[test]
fn two_runs_at_once_may_stop_and_go_on() {
    let config = config(6, 102, 1);
    let (whole, dir) = (whole(&config), TempDir::new().unwrap());
    for scenes in [30, 20, u64::MAX] {
        std::thread::scope(|scope| {
            let other = scope.spawn(|| run_until(&config, dir.path(), scenes));
            run_until(&config, dir.path(), scenes / 2);
            other.join().unwrap();
        });
    }
    run_until(&config, dir.path(), u64::MAX);
    assert!(files(whole.path()) == files(dir.path()), "the bytes differ, or something is left");
}

#[test]
#[cfg(unix)]
fn an_interrupted_program_says_what_it_loses_and_goes_on() {
    let text = small_config().replace("attempts = 70", "attempts = 18_000").replace("shards = 3", "shards = 6");
    let dir = workshop(&text.replace("attempts_per_scene = 12", "attempts_per_scene = 60"));
    check_ok(&run(&dir, "whole", &["--threads", "2"]));
    for number in 0..10 {
        let out = format!("stopped-{number}");
        let (ended, took) = signalled(&dir, &out, "2", "-INT", Duration::from_millis(20) * number);
        let text = String::from_utf8_lossy(&ended.stdout).into_owned();
        assert!(matches!(ended.status.code(), Some(0 | 75)), "{text}");
        assert!(took < Duration::from_secs(5), "it took {took:?} to stop");
        // A machine may be so busy that the run ends first.
        if ended.status.success() || !text.contains(" finished scenes of incomplete shards are lost") {
            continue;
        }
        // The table counts what is kept: so many shards of 3,000 attempts.
        let shards: u64 = text.split("stopped: ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!(text.contains(&format!("stopped: {shards} of 6 shards are kept, ")), "{text}");
        assert!(shards == 0 || text.starts_with(&format!("attempts            {},000 in ", 3 * shards)), "{text}");
        check_ok(&run(&dir, &out, &[]));
        assert!(files(&dir.path().join("whole")) == files(&dir.path().join(&out)), "the bytes differ");
        return;
    }
    panic!("no run was stopped half-way");
}
