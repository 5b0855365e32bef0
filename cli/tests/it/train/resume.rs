//! Stopped at any batch and resumed, on one thread or two: the same bits.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use super::fixture::{fit, trainer, write_config, write_dataset};
use network::Architecture;
use trainer::config::{Config, Method};
use trainer::events::Event;
use trainer::fit::Ending;

/// The metrics without the time that they took.
pub(crate) fn metrics(run: &Path) -> Vec<serde_json::Value> {
    let text = fs::read_to_string(run.join("metrics.jsonl")).unwrap();
    text.lines()
        .map(|line| {
            let mut value: serde_json::Value = serde_json::from_str(line).unwrap();
            value.as_object_mut().unwrap().remove("seconds");
            value
        })
        .collect()
}

pub(crate) fn check_same_run(a: &Path, b: &Path) {
    assert_eq!(metrics(a), metrics(b));
    for file in ["last.safetensors", "best.safetensors", "config.toml"] {
        assert!(fs::read(a.join(file)).unwrap() == fs::read(b.join(file)).unwrap(), "{file} differs");
    }
}

/// A judge is trained with Adam's moments on one thread, or stopped after every step and resumed on two.
#[test]
fn a_judge_is_the_same_after_every_stop_and_with_any_threads() {
    check_judge(4096);
}

/// The same where three of ten scenes are in memory.
#[test]
fn so_is_one_that_does_not_fit_into_memory() {
    check_judge(3);
}

fn check_judge(shuffle_scenes: usize) {
    let dir = tempfile::tempdir().unwrap();
    let (data, whole, cut) = (dir.path().join("data"), dir.path().join("whole"), dir.path().join("cut"));
    write_dataset(&data, 5, 2, 10, 12);
    let mut config = Config::load(Some(&write_config(dir.path(), 2, 24))).unwrap();
    config.method = Method::Judge;
    config.training.shuffle_scenes = shuffle_scenes;
    let on = |threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let ending = on(1).install(|| fit(&data, &config, &whole, false, &AtomicBool::new(false), &|_| {}));
    assert_eq!(ending.unwrap(), Ending::Done);
    let mut stops = 0;
    loop {
        let stop = AtomicBool::new(false);
        let see = |event: Event<'_>| {
            if matches!(event, Event::Step { .. }) {
                stop.store(true, Ordering::Relaxed);
            }
        };
        match on(2).install(|| fit(&data, &config, &cut, true, &stop, &see)).unwrap() {
            Ending::Done => break,
            Ending::Stopped => stops += 1,
        }
        assert!(stops < 100);
    }
    assert!(stops >= 2, "{stops}");
    check_same_run(&whole, &cut);
    let architecture = network::checkpoint::read(&whole.join("best.safetensors")).unwrap().architecture;
    let Architecture::Judge(scope) = architecture else { panic!("{architecture:?}") };
    assert_eq!(scope.gripper.name, "synthetic_80");
}

/// Training goes on from a checkpoint's weights, says which, and takes no other network's.
#[test]
fn a_run_may_begin_with_the_weights_of_another() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    write_dataset(&data, 5, 2, 10, 12);
    let config = write_config(dir.path(), 1, 24);
    let judge = dir.path().join("judge.toml");
    let text = fs::read_to_string(&config).unwrap();
    fs::write(&judge, text.replace("upsampling = \"nearest\"", "kind = \"judge\"")).unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let arguments = |config: &Path, run: &str, from: &[&str]| {
        let fixed =
            ["fit", "--data", data.to_str().unwrap(), "--config", config.to_str().unwrap(), "--run", &path(run)];
        fixed.iter().chain(from).map(|part| (*part).to_owned()).collect::<Vec<_>>()
    };
    let fit = |config: &Path, run: &str, from: &[&str]| {
        let arguments = arguments(config, run, from);
        let output = trainer(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    assert_eq!(fit(&config, "first", &[]).0, Some(0));
    let first = path("first/last.safetensors");
    assert_eq!(fit(&config, "second", &["--from", &first]).0, Some(0));
    let [first_loss, second_loss] =
        ["first", "second"].map(|run| metrics(&dir.path().join(run))[0]["train"]["loss"].as_f64().unwrap());
    assert!(second_loss < first_loss, "{second_loss} {first_loss}");
    let digest = network::checkpoint::read_digested(Path::new(&first)).unwrap().1;
    assert!(fs::read_to_string(path("second/config.toml")).unwrap().contains(&digest));
    let (code, said) = fit(&config, "second", &["--resume"]);
    assert_eq!(code, Some(78));
    assert!(said.contains("network.from (") && said.contains("there, nothing asked for)"), "{said}");
    assert_eq!(fit(&config, "second", &["--resume", "--from", &first]).0, Some(0));
    let (code, said) = fit(&judge, "third", &["--from", &first]);
    assert_eq!(code, Some(78));
    assert!(said.contains("another network's than the recipe's"), "{said}");
}

#[test]
fn stopped_anywhere_and_resumed_is_as_if_never_stopped() {
    let dir = tempfile::tempdir().unwrap();
    let (data, whole, cut) = (dir.path().join("data"), dir.path().join("whole"), dir.path().join("cut"));
    write_dataset(&data, 5, 2, 10, 12);
    let config = Config::load(Some(&write_config(dir.path(), 2, 24))).unwrap();
    let ending = fit(&data, &config, &whole, false, &AtomicBool::new(false), &|_| {}).unwrap();
    assert_eq!(ending, Ending::Done);

    // 96 samples train: 4 steps an epoch. Stop after 1 and 4 (the epoch's last) and 2 more.
    for steps in [1, 3, 2] {
        let (stop, seen) = (AtomicBool::new(false), AtomicUsize::new(0));
        let ending = fit(&data, &config, &cut, true, &stop, &|event| {
            if matches!(event, Event::Step { .. }) && seen.fetch_add(1, Ordering::Relaxed) + 1 == steps {
                stop.store(true, Ordering::Relaxed);
            }
        });
        assert_eq!(ending.unwrap(), Ending::Stopped);
    }
    let ending = fit(&data, &config, &cut, true, &AtomicBool::new(false), &|_| {}).unwrap();
    assert_eq!(ending, Ending::Done);
    check_same_run(&whole, &cut);
}

#[test]
fn one_thread_and_two_make_the_same_weights_and_a_signal_is_obeyed() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    write_dataset(&data, 6, 2, 10, 12);
    let config = write_config(dir.path(), 3, 24);
    let run = |name: &str| dir.path().join(name);
    let args = |run: &str, threads: &str| {
        let path = |p: &Path| p.to_str().unwrap().to_owned();
        let parts =
            ["fit", "--data", &path(&data), "--config", &path(&config), "--run", run, "--threads", threads, "--resume"];
        parts.map(str::to_owned)
    };
    let (one, two) = (run("one"), run("two"));
    let output = Command::new(env!("CARGO_BIN_EXE_trainer")).args(args(one.to_str().unwrap(), "1")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));

    // The second run is stopped by SIGTERM after its first epoch, then resumed.
    let mut child = Command::new(env!("CARGO_BIN_EXE_trainer"))
        .args(args(two.to_str().unwrap(), "2"))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let began = Instant::now();
    while !two.join("metrics.jsonl").exists() && began.elapsed() < Duration::from_secs(120) {
        std::thread::sleep(Duration::from_millis(5));
    }
    Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(75));
    let again = args(two.to_str().unwrap(), "2");
    let output = trainer(&again.each_ref().map(String::as_str));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    check_same_run(&one, &two);
    let left: Vec<_> = fs::read_dir(&two).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert!(left.iter().all(|name| !name.to_string_lossy().ends_with(".tmp")), "{left:?}");
}
