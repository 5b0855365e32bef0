//! The program as a user runs it.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_experiments")).args(arguments).output().unwrap()
}

fn config(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/experiment").join(name)
}

/// The journal's lines after the first, sorted, without what a clock says.
fn rounds(folder: &Path) -> Vec<String> {
    let text = fs::read_to_string(folder.join("journal.jsonl")).unwrap();
    let mut rounds: Vec<serde_json::Value> =
        text.lines().skip(1).map(|line| serde_json::from_str(line).unwrap()).collect();
    for trial in rounds.iter_mut().flat_map(|round| round["trials"].as_array_mut().unwrap()) {
        let trial = trial.as_object_mut().unwrap();
        trial.remove("plan_ms");
        trial.remove("observe_ms");
    }
    let mut lines: Vec<String> = rounds.iter().map(ToString::to_string).collect();
    lines.sort();
    lines
}

/// Settings that let the shipped network grasp.
fn generous(folder: &Path, name: &str) -> PathBuf {
    let plan = planner::config::PAPER.replace("quality_min = 0.9", "quality_min = 0.5");
    fs::write(folder.join("plan.toml"), plan).unwrap();
    let text = fs::read_to_string(config(name)).unwrap().replace("plan = \"paper\"", "plan = \"plan.toml\"");
    let path = folder.join(name);
    fs::write(&path, text).unwrap();
    path
}

#[test]
fn an_experiment_is_the_same_in_one_go_or_cut_short_and_on_any_number_of_threads() {
    for name in ["pile.toml", "packed.toml"] {
        let folder = tempfile::tempdir().unwrap();
        let config = generous(folder.path(), name);
        let at = |out: &str, more: &[&str]| {
            let out = folder.path().join(out);
            let output =
                run(&[&["run", config.to_str().unwrap(), "--out", out.to_str().unwrap(), "--rounds", "4"], more]
                    .concat());
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            assert!(String::from_utf8(output.stdout).unwrap().contains("5 objects, 6 views"));
            out
        };
        let whole = at("whole", &["--threads", "1"]);
        assert_eq!(rounds(&whole).len(), 4);
        for file in ["rounds.parquet", "attempts.parquet", "report.md", "report.json", "report.svg"] {
            assert!(whole.join(file).metadata().unwrap().len() > 100, "{file}");
        }
        // A run that was killed in the middle of a line.
        let cut = folder.path().join("cut");
        fs::create_dir(&cut).unwrap();
        let journal = fs::read_to_string(whole.join("journal.jsonl")).unwrap();
        let second = journal.match_indices('\n').nth(1).unwrap().0;
        fs::write(cut.join("journal.jsonl"), &journal[..second + 40]).unwrap();
        assert_eq!(rounds(&at("cut", &["--threads", "3"])), rounds(&whole));
    }
}

#[test]
fn another_experiment_is_not_mixed_in() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let arguments = |seed| {
        let pile = config("pile.toml");
        run(&["run", pile.to_str().unwrap(), "--out", out.to_str().unwrap(), "--rounds", "1", "--seed", seed])
    };
    assert!(arguments("1").status.success());
    let other = arguments("2");
    assert_eq!(other.status.code(), Some(78));
    assert!(String::from_utf8(other.stderr).unwrap().contains("another experiment"));
}

#[test]
fn a_bad_config_is_told_whole() {
    let folder = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(config("pile.toml")).unwrap();
    let bad = text.replace("kind = \"pile\"", "kind = \"heap\"").replace("rounds = 100", "rounds = 0");
    let path = folder.path().join("bad.toml");
    fs::write(&path, bad).unwrap();
    let output = run(&["run", path.to_str().unwrap(), "--out", folder.path().to_str().unwrap()]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(78), "{said}");
    assert!(said.contains("objects.kind must be one of pile, packed, things, got heap"), "{said}");
    assert!(said.contains("rounds must be between 1 and 1000000, got 0"), "{said}");
}
