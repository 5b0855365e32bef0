//! Several processes: the bits of one, or all end with a message.

use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::fixture::{check_fails, trainer, write_config, write_dataset};
use crate::resume::{check_same_run, metrics};

struct Place {
    dir: tempfile::TempDir,
    data: PathBuf,
    config: PathBuf,
    master: String,
}

impl Place {
    fn new(epochs: u32) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let data = dir.path().join("data");
        write_dataset(&data, 5, 2, 10, 12);
        let config = write_config(dir.path(), epochs, 24);
        let text = fs::read_to_string(&config).unwrap();
        // All that could differ between ranks; batches of 5 to 7 scenes.
        let more = "schedule = \"cosine\"\npositive_weight = 2.0\n[augmentation]\nquarter_turns = true\n[split]";
        fs::write(&config, text.replace("[split]", more).replace("_per_scene = 6", "_per_scene = 4")).unwrap();
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        Self { dir, data, config, master: format!("127.0.0.1:{port}") }
    }

    fn run(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn args(&self, run: &Path, more: &[&str]) -> Vec<String> {
        let [data, config, run] = [&self.data, &self.config, run].map(|path| path.to_str().unwrap());
        let args = [&["fit", "--resume", "--data", data, "--config", config, "--run", run][..], more].concat();
        args.into_iter().map(str::to_owned).collect()
    }

    /// A rank by torchrun's variables.
    fn rank(&self, run: &Path, rank: usize, ranks: usize, more: &[&str]) -> Child {
        let (host, port) = self.master.split_once(':').unwrap();
        Command::new(env!("CARGO_BIN_EXE_trainer"))
            .args(self.args(run, &[&["--ranks", "auto", "--threads", "1"], more].concat()))
            .envs([("RANK", rank.to_string()), ("WORLD_SIZE", ranks.to_string())])
            .envs([("MASTER_ADDR", host), ("MASTER_PORT", port)])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    }

    fn alone(&self, run: &Path) {
        let args = self.args(run, &[]);
        let output = trainer(&args.iter().map(String::as_str).collect::<Vec<_>>());
        assert!(output.status.success(), "{}", stderr(&output));
    }
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn ended(child: Child) -> (Option<i32>, String) {
    let output = child.wait_with_output().unwrap();
    (output.status.code(), stderr(&output))
}

#[test]
fn two_and_three_processes_make_the_bits_of_one() {
    let place = Place::new(2);
    let whole = place.run("whole");
    place.alone(&whole);
    for ranks in [2, 3] {
        let run = place.run(&ranks.to_string());
        let children: Vec<Child> = (0..ranks).map(|rank| place.rank(&run, rank, ranks, &[])).collect();
        for child in children {
            let output = child.wait_with_output().unwrap();
            assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        }
        check_same_run(&whole, &run);
    }
}

#[test]
fn a_signal_to_one_stops_all_and_a_lost_rank_ends_all_and_the_run_goes_on() {
    let place = Place::new(16);
    let (whole, run) = (place.run("whole"), place.run("run"));
    for (signal, codes) in [("-TERM", [75, 75]), ("-KILL", [75, -1])] {
        let before = if run.join("metrics.jsonl").exists() { metrics(&run).len() } else { 0 };
        let children = [0, 1].map(|rank| place.rank(&run, rank, 2, &["--ranks-timeout-s", "60"]));
        let began = Instant::now();
        let lines = || fs::read_to_string(run.join("metrics.jsonl")).map_or(0, |text| text.lines().count());
        while lines() <= before && began.elapsed() < Duration::from_secs(120) {
            std::thread::sleep(Duration::from_millis(5));
        }
        Command::new("kill").args([signal, &children[1].id().to_string()]).status().unwrap();
        let [first, second] = children.map(ended);
        assert_eq!([first.0, Some(second.0.unwrap_or(-1))], codes.map(Some), "{signal}: {} {}", first.1, second.1);
        let told = first.1.contains("lost rank 1: it closed the connection");
        assert_eq!(told, signal == "-KILL", "{}", first.1);
    }
    place.alone(&run);
    place.alone(&whole);
    check_same_run(&whole, &run);
}

#[test]
fn ranks_that_are_unlike_or_absent_are_told() {
    let place = Place::new(1);
    let args = place.args(&place.run("absent"), &["--ranks", "2", "--rank", "0", "--ranks-timeout-s", "1"]);
    let args: Vec<&str> =
        [&args.iter().map(String::as_str).collect::<Vec<_>>()[..], &["--master", &place.master]].concat();
    check_fails(&args, 75, &["1 of 2 ranks did not join within 1 s", &place.master]);

    let run = place.run("stopped");
    let waiting = place.rank(&run, 0, 2, &[]);
    let began = Instant::now();
    while !run.join("config.toml").exists() && began.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(5));
    }
    Command::new("kill").args(["-TERM", &waiting.id().to_string()]).status().unwrap();
    assert_eq!(ended(waiting).0, Some(75));
    assert!(began.elapsed() < Duration::from_secs(100), "it does not wait for others any more");

    let run = place.run("unlike");
    let first = place.rank(&run, 0, 2, &[]);
    let second = place.rank(&run, 1, 2, &["--epochs", "2"]);
    for (code, text) in [first, second].map(ended) {
        assert_eq!(code, Some(78), "{text}");
        assert!(text.contains("rank 1 cannot take part: its version, configuration or dataset is another"), "{text}");
    }
    let args = place.args(&run, &["--ranks", "2"]);
    check_fails(&args.iter().map(String::as_str).collect::<Vec<_>>(), 78, &["--ranks 2 needs --rank"]);
}
