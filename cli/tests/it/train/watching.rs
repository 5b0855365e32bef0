//! What a run and an evaluation leave for people to look at.

use std::fs;
use std::path::Path;

use super::fixture::{check_fails, trainer, write_config, write_dataset};

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn succeed(args: &[&str]) -> (String, String) {
    let output = trainer(args);
    let [stdout, stderr] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    assert!(output.status.success(), "{args:?}: {stderr}");
    (stdout, stderr)
}

#[test]
fn a_run_and_an_evaluation_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (data, fresh, run, report) = (path("data"), path("fresh"), path("run"), path("reports/fresh"));
    write_dataset(Path::new(&data), 11, 2, 10, 12);
    write_dataset(Path::new(&fresh), 12, 2, 6, 12);
    let config = write_config(dir.path(), 2, 24);
    let fit = ["fit", "--data", &data, "--config", config.to_str().unwrap(), "--run", &run];
    let (stdout, _) = succeed(&fit);
    assert!(stdout.contains("run/metrics.jsonl\n"), "{stdout}");
    let files = [".lock", "best.safetensors", "config.toml", "last.safetensors", "metrics.jsonl"];
    assert_eq!(names(Path::new(&run)), files);

    // A model's file is evaluated as the run that it lies in, on a dataset of another seed.
    let model = path("run/best.safetensors");
    let (of_run, _) = succeed(&["evaluate", "--run", &run, "--data", &fresh, "--split", "all", "--json"]);
    let (of_file, _) =
        succeed(&["evaluate", "--model", &model, "--data", &fresh, "--split", "all", "--json", "--report", &report]);
    assert_eq!(of_run, of_file);
    let report = Path::new(&report);
    assert_eq!(fs::read_to_string(report.join("evaluation.json")).unwrap(), of_file);
    assert_eq!(names(report), ["evaluation.html", "evaluation.json"]);
    let page = fs::read_to_string(report.join("evaluation.html")).unwrap();
    for words in ["another</td>", ">average precision<", "scenes drawn", ">By shape<", "cuboid", ">Calibration<"] {
        assert!(page.contains(words), "{words} is not in\n{page}");
    }

    let found: serde_json::Value = serde_json::from_str(&of_file).unwrap();
    let sum = |path: &str, key: &str| {
        let values = found.pointer(path).unwrap();
        let rows: Vec<&serde_json::Value> = match values {
            serde_json::Value::Object(rows) => rows.values().collect(),
            values => values.as_array().unwrap().iter().collect(),
        };
        rows.iter().map(|row| row[key].as_u64().unwrap()).sum::<u64>()
    };
    let samples = found["all"]["samples"].as_u64().unwrap();
    for path in ["/by_shape", "/calibration/bins"] {
        assert_eq!(sum(path, "samples"), samples, "{path}");
    }
    assert_eq!(found["scenes"], 6);

    let (text, _) = succeed(&["evaluate", "--model", &model, "--data", &fresh, "--split", "all"]);
    for words in ["average precision", "area under the ROC curve", "Brier", "0.9 to 1.0"] {
        assert!(text.contains(words), "{words} is not in\n{text}");
    }
}

#[test]
fn what_is_missing_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let nowhere = dir.path().join("nowhere");
    let nowhere = nowhere.to_str().unwrap();
    check_fails(&["evaluate", "--model", nowhere, "--data", nowhere], 78, &["no checkpoint here", nowhere]);
    check_fails(&["evaluate", "--data", nowhere], 2, &["--run"]);
    check_fails(&["evaluate", "--model", "x", "--run", "y", "--data", "z"], 2, &["--model", "--run"]);
}
