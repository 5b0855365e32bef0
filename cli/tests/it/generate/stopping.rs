//! A run that is stopped keeps what it finished: the next run makes nothing twice, and the bytes are those of a run
//! without a stop.

use std::fs;
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

fn names_of_kept(dir: &Path) -> Vec<String> {
    let names = files(dir).into_iter().map(|(path, _)| path.to_string_lossy().into_owned());
    names.filter(|name| name.contains("#kept.")).collect()
}

/// Stops runs again and again. Whatever was finished is never built again.
fn check_stops(config: &Config, scenes: u64, stops: &[u64]) {
    let (whole, dir) = (whole(config), TempDir::new().unwrap());
    let (mut built, mut committed) = (0, 0);
    for after in stops {
        let (report, now) = run_until(config, dir.path(), *after);
        let stopped = report.stopped.expect("it was stopped");
        (built, committed) = (built + now, committed + report.made.scenes);
        assert!(now >= *after && stopped.abandoned <= THREADS as u64, "{now} built, {stopped:?}");
        assert!(stopped.kept.scenes <= built - committed && !names_of_kept(dir.path()).is_empty());
    }
    let (report, now) = run_until(config, dir.path(), u64::MAX);
    assert_eq!(report.stopped, None);
    assert_eq!(built + now, scenes, "each scene is built once");
    assert!(files(whole.path()) == files(dir.path()), "the bytes differ, or something is left");
}

#[test]
fn many_shards_at_once_are_taken_up_where_they_were() {
    check_stops(&config(6, 102, 1), 102, &[40, 1, 20, 30]);
}

#[test]
fn long_shards_are_taken_up_where_they_were() {
    check_stops(&config(2, 600, 1), 600, &[1, 140, 5, 200, 1, 90]);
}

#[test]
fn all_finished_scenes_are_counted() {
    let dir = TempDir::new().unwrap();
    let (report, built) = run_until(&config(6, 102, 1), dir.path(), 51);
    assert_eq!(report.made.scenes + report.stopped.unwrap().kept.scenes, built);
    let (report, _) = run_until(&config(6, 102, 1), dir.path(), u64::MAX);
    assert_eq!(report.taken_up.scenes % 17, built % 17, "whole shards of 17 were committed");
}

/// What is kept of an only shard, changed by `change`, is not taken up, and does no harm.
fn check_useless(change: impl Fn(&Path, &str)) {
    let config = config(1, 30, 1);
    let whole = whole(&config);
    let kept = {
        let dir = TempDir::new().unwrap();
        run_until(&config, dir.path(), 12);
        names_of_kept(dir.path())
    };
    assert_eq!(kept.len(), 4, "three tables and a marker: {kept:?}");
    for table in ["attempts", "objects", "scenes", "meta"] {
        let dir = TempDir::new().unwrap();
        run_until(&config, dir.path(), 12);
        let name = names_of_kept(dir.path()).into_iter().find(|name| name.starts_with(table)).unwrap();
        change(dir.path(), &name);
        let (report, built) = run_until(&config, dir.path(), u64::MAX);
        assert_eq!((report.taken_up.scenes, built), (0, 30), "{name}");
        assert!(files(whole.path()) == files(dir.path()), "{name}");
    }
}

#[test]
fn what_is_damaged_is_made_again() {
    check_useless(|dir, name| {
        let path = dir.join(name);
        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(path, bytes).unwrap();
    });
    check_useless(|dir, name| fs::write(dir.join(name), b"").unwrap());
    check_useless(|dir, name| fs::remove_file(dir.join(name)).unwrap());
}

#[test]
fn what_another_config_kept_is_made_again() {
    let (ours, other) = (config(1, 30, 1), config(1, 30, 2));
    let (whole, dir, elsewhere) = (whole(&ours), TempDir::new().unwrap(), TempDir::new().unwrap());
    run_until(&ours, dir.path(), 5);
    names_of_kept(dir.path()).iter().for_each(|name| fs::remove_file(dir.path().join(name)).unwrap());
    run_until(&other, elsewhere.path(), 12);
    for name in names_of_kept(elsewhere.path()) {
        fs::copy(elsewhere.path().join(&name), dir.path().join(&name)).unwrap();
    }
    let (report, built) = run_until(&ours, dir.path(), u64::MAX);
    assert_eq!((report.taken_up.scenes, built), (0, 30));
    for (path, bytes) in files(whole.path()) {
        assert!(fs::read(dir.path().join(&path)).unwrap() == bytes, "{}", path.display());
    }
    assert!(names_of_kept(dir.path()).is_empty(), "a complete dataset has nothing kept");
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
fn a_sweep_leaves_what_is_kept() {
    let (dir, config) = (TempDir::new().unwrap(), config(1, 30, 1));
    run_until(&config, dir.path(), 12);
    let sweep = |which| shards::Draft::open(dir.path()).unwrap().sweep(which).unwrap();
    let swept = sweep(shards::Sweep::Dead);
    assert_eq!((swept.files, swept.kept), (0, 4));
    assert!(run_until(&config, dir.path(), 1).0.taken_up.scenes >= 12);
    assert_eq!(sweep(shards::Sweep::All).files, 4);
}

/// The number before ` finished scenes` in a line that begins like this.
fn told(text: &str, begins: &str, ends: &str) -> u64 {
    let line = text.lines().find(|line| line.starts_with(begins) && line.contains(ends));
    let line = line.unwrap_or_else(|| panic!("no line {begins:?} … {ends:?} in:\n{text}"));
    let (number, _) = line.split_at(line.find(ends).unwrap());
    number.rsplit(' ').next().unwrap().replace(',', "").parse().unwrap()
}

#[test]
#[cfg(unix)]
fn an_interrupted_program_says_what_it_keeps_and_takes_it_up() {
    let text = small_config().replace("attempts = 70", "attempts = 18_000").replace("shards = 3", "shards = 6");
    let dir = workshop(&text.replace("attempts_per_scene = 12", "attempts_per_scene = 60"));
    check_ok(&run(&dir, "whole", &["--threads", "2"]));
    // The first of six shards is committed: much is left to do, and of the next shards some scenes are finished, or
    // will be a little later.
    for number in 0..10 {
        let out = format!("stopped-{number}");
        let (ended, took) = signalled(&dir, &out, "2", "-INT", Duration::from_millis(20) * number);
        let text = String::from_utf8_lossy(&ended.stdout).into_owned();
        assert!(matches!(ended.status.code(), Some(0 | 75)), "{text}");
        assert!(took < Duration::from_secs(5), "it took {took:?} to stop");
        // A machine may be so busy that the run ends first.
        if ended.status.success() || !text.contains(" finished scenes") {
            continue;
        }
        let kept = told(&text, "stopped: ", " finished scenes of incomplete shards are kept");
        assert!(told(&text, "stopped: ", " under way are not") <= 2, "{text}");
        if kept < 20 {
            continue;
        }
        let text = check_ok(&run(&dir, &out, &[]));
        assert_eq!(told(&text, "taken up", " scenes that a stopped run had finished"), kept, "{text}");
        assert!(files(&dir.path().join("whole")) == files(&dir.path().join(&out)), "the bytes differ");
        return;
    }
    panic!("no run was stopped half-way");
}
