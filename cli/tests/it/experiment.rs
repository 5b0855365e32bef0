//! The program as a user runs it.

mod page;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_graspmill")).arg("experiment").args(arguments).output().unwrap()
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

#[test]
fn an_experiment_is_the_same_in_one_go_or_cut_short_and_on_any_number_of_threads() {
    for name in ["pile.toml", "packed.toml"] {
        let folder = tempfile::tempdir().unwrap();
        let config = config(name);
        let at = |out: &str, more: &[&str]| {
            let out = folder.path().join(out);
            let output =
                run(&[&["run", config.to_str().unwrap(), "--out", out.to_str().unwrap(), "--rounds", "4"], more]
                    .concat());
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            let printed = String::from_utf8(output.stdout).unwrap();
            let lines: Vec<&str> = printed.lines().collect();
            assert!(lines.len() <= 10 && lines[0].contains("report.html"), "{printed}");
            assert!(lines[2].contains("5 objects, 6 views") && printed.contains("(GSR)"), "{printed}");
            out
        };
        let whole = at("whole", &["--threads", "1"]);
        assert_eq!(rounds(&whole).len(), 4);
        for file in ["rounds.parquet", "attempts.parquet", "report.json", "report.html"] {
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
fn a_folder_has_one_run_at_a_time_which_removes_what_killed_ones_left() {
    let folder = tempfile::tempdir().unwrap();
    let [left, lock] = [".abc123.tmp", ".lock"].map(|name| folder.path().join(name));
    fs::write(&left, "half a report").unwrap();
    let lock = fs::File::create(lock).unwrap();
    lock.lock().unwrap();
    let pile = config("pile.toml");
    let again =
        || told(&run(&["run", pile.to_str().unwrap(), "--out", folder.path().to_str().unwrap(), "--rounds", "1"]));
    let (code, said) = again();
    assert_eq!(code, Some(75), "{said}");
    assert!(said.contains("another process writes in this folder") && left.exists(), "{said}");
    lock.unlock().unwrap();
    assert_eq!(again().0, Some(0));
    assert!(!left.exists());
}

#[cfg(unix)]
#[test]
fn a_pipe_in_place_of_a_file_is_refused_without_waiting_for_it() {
    let folder = tempfile::tempdir().unwrap();
    let (pile, out) = (config("pile.toml"), folder.path().to_str().unwrap());
    let refused = |name: &str, arguments: &[&str]| {
        let pipe = folder.path().join(name);
        assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let (code, said) = told(&run(arguments));
        assert_eq!(code, Some(78), "{said}");
        assert!(said.contains("it must be a regular file") || said.contains("a pipe that nobody reads"), "{said}");
        assert!(said.contains(if name == ".lock" { out } else { name }), "{said}");
        fs::remove_file(pipe).unwrap();
    };
    for name in [".lock", "journal.jsonl", "run.json"] {
        refused(name, &["run", pile.to_str().unwrap(), "--out", out, "--rounds", "1"]);
    }
    refused("report.json", &["report", out]);
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

fn told(output: &Output) -> (Option<i32>, String) {
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn keys_are_set_from_outside_and_unknown_ones_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let pile = config("pile.toml");
    let with = |set: &[&str]| {
        let sets = set.iter().flat_map(|set| ["--set", set]);
        let start = ["run", pile.to_str().unwrap(), "--out", out.to_str().unwrap(), "--rounds", "1"];
        run(&start.into_iter().chain(sets).collect::<Vec<_>>())
    };
    let quick = ["views.count=1", "views.radius_sizes=2", "protocol=one view", "plan.detection.quality_min=0.95"];
    assert_eq!(told(&with(&quick)).0, Some(0));
    let report = String::from_utf8(run(&["report", out.to_str().unwrap()]).stdout).unwrap();
    for text in
        ["Experiment one view", "count = 1\n", "radius_sizes = 2.0", "quality_min = 0.95", "--set 'protocol=one view'"]
    {
        assert!(report.contains(text), "{text} is not in {report}");
    }
    for (set, text) in [
        ("views.number=3", "there is no key views.number"),
        ("plan.detection.epsilon=0.5", "there is no key detection.epsilon"),
        ("views.count=0", "views.count must be between 1 and 32, got 0"),
        ("seeds=[3, 3]", "seeds must be different ones"),
        ("seeds=[]", "number of seeds must be between 1 and 1000, got 0"),
        ("objects.names=[\"teapot\"]", "objects.names must be there for objects.kind"),
    ] {
        let (code, said) = told(&with(&[set]));
        assert_eq!(code, Some(78), "{set}: {said}");
        assert!(said.contains(text), "{set}: {said}");
    }
}

/// What is not in the experiment's own file decides as well: the planner's settings, the gripper and the procedure,
/// the objects.
#[test]
fn a_run_does_not_go_on_with_other_files() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let scene = fs::read_to_string(root.join("configs/generate/paper.toml")).unwrap();
    let things = fs::read_to_string(root.join("configs/objects/everyday.toml")).unwrap();
    let text = fs::read_to_string(config("table2.toml")).unwrap();
    let text = text
        .replace("scene = \"paper\"", "scene = \"scene.toml\"")
        .replace("plan = \"judge\"", "plan = \"plan.toml\"")
        .replace("catalogue = \"everyday\"", "catalogue = \"things.toml\"");
    fs::write(at("table.toml"), text).unwrap();
    fs::write(at("plan.toml"), planner::BuiltIn::Paper.text()).unwrap();
    fs::write(at("scene.toml"), &scene).unwrap();
    fs::write(at("things.toml"), &things).unwrap();
    let (table, out) = (at("table.toml"), at("out"));
    let again = |rounds: &str| {
        told(&run(&["run", table.to_str().unwrap(), "--out", out.to_str().unwrap(), "--rounds", rounds]))
    };
    assert_eq!(again("1").0, Some(0));
    assert_eq!(again("2").0, Some(0), "more rounds of the same are welcome");
    for (file, text, from, to) in [
        ("scene.toml", scene.as_str(), "hold_time_s = 0.25", "hold_time_s = 0.3"),
        ("plan.toml", planner::BuiltIn::Paper.text(), "quality_min = 0.9", "quality_min = 0.8"),
        ("things.toml", things.as_str(), "mass_kg = 0.21", "mass_kg = 0.22"),
    ] {
        assert!(text.contains(from), "{from}");
        fs::write(at(file), text.replacen(from, to, 1)).unwrap();
        let (code, said) = again("2");
        assert_eq!(code, Some(78), "{file}: {said}");
        assert!(said.contains("another experiment"), "{file}: {said}");
        fs::write(at(file), text).unwrap();
    }
    assert_eq!(again("2").0, Some(0));
}

#[test]
fn seeds_are_told_apart_and_runs_compared() {
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let play = |name: &str, policy: &str| {
        let (set, protocol) = (format!("plan.ranking.policy={policy}"), format!("protocol={name}"));
        let table = config("table3.toml");
        let start = ["run", table.to_str().unwrap(), "--out", &out(name), "--rounds", "2", "--set", "seeds=[5, 6]"];
        let sets =
            ["--set", "plan=paper", "--set", "plan.detection.quality_min=0.4", "--set", &set, "--set", &protocol];
        assert_eq!(told(&run(&[&start[..], &sets[..]].concat())).0, Some(0));
    };
    play("ours", "paper");
    play("theirs", "vgn-best");
    let report = String::from_utf8(run(&["report", &out("ours")]).stdout).unwrap();
    for seed in ["– seed 5         2 ", "– seed 6         2 "] {
        assert!(report.contains(seed), "{seed} is not in {report}");
    }
    for file in ["objects.parquet", "bodies.json", "run.json"] {
        assert!(folder.path().join("ours").join(file).metadata().unwrap().len() > 100, "{file}");
    }
    let compared = run(&["report", &out("ours"), &out("theirs")]);
    let text = String::from_utf8(compared.stdout).unwrap();
    for row in ["ours", "theirs", "– scene_1", "– scene_2"] {
        assert!(text.contains(&format!("\n{row}  ")), "{row} is not in {text}");
    }
    let (code, said) = told(&run(&["report", folder.path().to_str().unwrap()]));
    assert_eq!(code, Some(78), "{said}");
}

#[test]
fn a_round_has_its_container_and_what_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let (config, sure) = (config("bin.toml"), "plan.detection.quality_min=0.999999");
    let output =
        run(&["run", config.to_str().unwrap(), "--out", out.to_str().unwrap(), "--rounds", "3", "--set", sure]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for line in rounds(&out) {
        let round: serde_json::Value = serde_json::from_str(&line).unwrap();
        let (container, left) = (&round["container"], round["left"].as_array().unwrap());
        let inner_m = container["inner_m"].as_array().unwrap().iter().map(|side| side.as_f64().unwrap());
        assert!(inner_m.clone().all(|side| (0.2..=0.28).contains(&side)) && container["kind"] == "bin", "{line}");
        let [count, removed, lost] = ["object_count", "removed_count", "lost_count"].map(|key| round[key].as_u64());
        assert_eq!(count.unwrap() - removed.unwrap() - lost.unwrap(), left.len() as u64, "{line}");
        assert!(round["ending"] == "no_grasp" && !left.is_empty(), "{line}");
        assert!(left.iter().all(|object| object["size_m"].is_array() && object["friction"].as_f64() > Some(0.0)));
    }
}
