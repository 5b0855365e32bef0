//! On data with something to learn, the network learns it, and `evaluate` agrees with `fit`.

use std::fs;

use super::fixture::{trainer, write_config, write_dataset};

#[test]
fn test_accuracy_clearly_beats_the_baseline() {
    let dir = tempfile::tempdir().unwrap();
    let (data, run) = (dir.path().join("data"), dir.path().join("run"));
    write_dataset(&data, 8, 2, 80, 30);
    let config = write_config(dir.path(), 4, 48);
    let [data, run, config] = [&data, &run, &config].map(|path| path.to_str().unwrap().to_owned());
    let output = trainer(&["fit", "--data", &data, "--config", &config, "--run", &run]);
    let stdout = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{stdout} {}", String::from_utf8_lossy(&output.stderr));
    println!("{stdout}");

    let metrics = fs::read_to_string(format!("{run}/metrics.jsonl")).unwrap();
    let lines: Vec<serde_json::Value> = metrics.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let last = lines.last().unwrap();
    assert!(last["train"]["loss"].as_f64().unwrap() < lines[0]["train"]["loss"].as_f64().unwrap());
    for set in ["test_attempts", "test_scenes"] {
        let number = |key: &str| last[set][key].as_f64().unwrap();
        let (accuracy, baseline) = (number("accuracy"), number("baseline_accuracy"));
        assert!(accuracy > baseline + 0.1, "{set}: {accuracy} against {baseline}");
        let sum = number("loss_quality") + number("loss_rotation") + 0.01 * number("loss_width");
        assert!((number("loss") - sum).abs() < 1e-5, "{set}: Eq. 5");
    }

    let last_one = format!("{run}/last.safetensors");
    let output = trainer(&["evaluate", "--model", &last_one, "--data", &data, "--split", "test-scenes", "--json"]);
    let evaluation: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(evaluation["all"]["accuracy"], last["test_scenes"]["accuracy"]);
    assert_eq!(evaluation["all"]["confusion"], last["test_scenes"]["confusion"]);
    let by_shape: u64 =
        evaluation["by_shape"].as_object().unwrap().values().map(|s| s["samples"].as_u64().unwrap()).sum();
    assert_eq!(by_shape, last["test_scenes"]["samples"].as_u64().unwrap());

    let text = trainer(&["evaluate", "--run", &run, "--data", &data]);
    let text = String::from_utf8_lossy(&text.stdout).into_owned();
    for part in ["accuracy", "always \"failure\"", "predicted held", "cuboid"] {
        assert!(text.contains(part), "{part} is not in\n{text}");
    }
}
