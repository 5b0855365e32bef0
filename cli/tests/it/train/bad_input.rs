//! Bad input gets one clear message and its exit code, and nothing is lost.

use std::fs;
use std::path::{Path, PathBuf};

use super::fixture::{check_fails, trainer, write_config, write_dataset};

struct Place {
    _dir: tempfile::TempDir,
    data: PathBuf,
    run: PathBuf,
    config: PathBuf,
}

impl Place {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let (data, run) = (dir.path().join("data"), dir.path().join("run"));
        write_dataset(&data, 1, 2, 4, 6);
        let config = write_config(dir.path(), 1, 24);
        Self { _dir: dir, data, run, config }
    }

    fn fit<'a>(&'a self, more: &[&'a str]) -> Vec<&'a str> {
        let mut args =
            vec!["fit", "--data", text(&self.data), "--config", text(&self.config), "--run", text(&self.run)];
        args.extend(more);
        args
    }

    fn trained() -> Self {
        let place = Self::new();
        let output = trainer(&place.fit(&[]));
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        place
    }
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn replace_in(path: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(path).unwrap();
    assert!(text.contains(from), "{from} is not in {text}");
    fs::write(path, text.replace(from, to)).unwrap();
}

#[test]
fn a_wrong_configuration_is_78_and_all_of_it_is_told() {
    let place = Place::new();
    replace_in(&place.config, "batch = 24", "batch = 0\nspeed = 9");
    replace_in(&place.config, "\"attempt\"", "\"weekday\"");
    check_fails(
        &place.fit(&[]),
        78,
        &["training.batch must be", "training.speed is an unknown key", "split.by must be"],
    );
    check_fails(&["fit", "--data", "x", "--run", "y", "--config", "/none.toml"], 78, &["/none.toml"]);
    assert!(!place.run.exists());
}

#[test]
fn a_wrong_command_line_is_2() {
    check_fails(&["fit", "--run", "x"], 2, &["--data"]);
    check_fails(&["fit", "--run", "x", "--data", "y", "--epochs", "0"], 2, &["--epochs"]);
}

#[test]
fn a_missing_dataset_is_78_and_an_incomplete_one_69() {
    let mut place = Place::new();
    fs::remove_file(place.data.join("meta/manifest.json")).unwrap();
    check_fails(&place.fit(&[]), 69, &["not complete"]);
    place.data = place.data.join("nowhere");
    check_fails(&place.fit(&[]), 78, &["no dataset here", "nowhere"]);
    assert!(!place.run.exists());
}

#[test]
fn a_damaged_shard_is_65_and_named() {
    for (damage, shard) in
        [("cut", "attempts/shard-00001-of-00002.parquet"), ("flip", "scenes/shard-00000-of-00002.parquet")]
    {
        let place = Place::new();
        let path = place.data.join(shard);
        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        if damage == "cut" {
            bytes.truncate(middle);
        } else {
            bytes[middle] ^= 1;
        }
        fs::write(&path, bytes).unwrap();
        check_fails(&place.fit(&[]), 65, &[shard]);
        check_fails(&place.fit(&["--resume"]), 65, &[shard]);
    }
}

#[test]
fn a_dataset_of_an_unknown_version_is_65() {
    let place = Place::new();
    replace_in(&place.data.join("meta/info.json"), "\"format_version\": 1", "\"format_version\": 99");
    check_fails(&place.fit(&[]), 65, &["99", "info.json"]);
}

#[test]
fn an_empty_split_is_78() {
    let mut place = Place::new();
    place.data = place.data.with_file_name("one_scene");
    write_dataset(&place.data, 1, 1, 1, 6);
    check_fails(&place.fit(&[]), 78, &["0 samples to train on", "none may be 0"]);
    // Nothing was written, so a better dataset can be used.
    place.data = place.data.with_file_name("data");
    assert!(trainer(&place.fit(&[])).status.success());
}

#[test]
fn a_grid_that_is_not_the_networks_is_78() {
    let mut place = Place::new();
    place.data = place.data.with_file_name("coarse");
    let mut info = crate::synthetic::info(1, 1, 6, 6);
    info.grid.resolution = 8;
    let draft = shards::Draft::begin(&place.data, &info).unwrap();
    let mut writer = draft.shard(0).unwrap();
    writer.push(&crate::synthetic::scene_rows(0, 1, &info)).unwrap();
    writer.commit().unwrap();
    draft.finalize().unwrap();
    check_fails(&place.fit(&[]), 78, &["grids of 40^3 voxels, the dataset has 8^3"]);
}

#[test]
fn another_run_in_the_folder_is_78_and_left_alone() {
    let mut place = Place::trained();
    let before = fs::read(place.run.join("last.safetensors")).unwrap();
    check_fails(&place.fit(&[]), 78, &["holds a run already", "--resume"]);
    replace_in(&place.config, "learning_rate = 1e-3", "learning_rate = 2e-3");
    check_fails(
        &place.fit(&["--resume"]),
        78,
        &["another configuration", "training.learning_rate (0.001 there, 0.002 asked for)"],
    );
    replace_in(&place.config, "learning_rate = 2e-3", "learning_rate = 1e-3");
    place.data = place.data.with_file_name("other");
    write_dataset(&place.data, 2, 2, 4, 6);
    check_fails(&place.fit(&["--resume"]), 78, &["another dataset"]);
    let [run, data] = [text(&place.run), text(&place.data)];
    check_fails(&["evaluate", "--run", run, "--data", data], 78, &["another dataset", "--split all"]);
    assert!(trainer(&["evaluate", "--run", run, "--data", data, "--split", "all"]).status.success());
    assert_eq!(fs::read(place.run.join("last.safetensors")).unwrap(), before);
}

#[test]
fn a_folder_with_something_else_is_78() {
    let place = Place::new();
    fs::create_dir(&place.run).unwrap();
    fs::write(place.run.join("thesis.tex"), "\\section{Results}").unwrap();
    for more in [&[][..], &["--resume"]] {
        check_fails(&place.fit(more), 78, &["thesis.tex", "no run"]);
    }
}

/// Other programs have a `config.toml` too.
#[test]
fn a_folder_with_someone_elses_config_is_left_alone() {
    let place = Place::new();
    fs::create_dir(&place.run).unwrap();
    let file = place.run.join("config.toml");
    fs::write(&file, "[site]\ntitle = \"mine\"\n").unwrap();
    check_fails(&place.fit(&[]), 78, &["config.toml", "no run"]);
    assert_eq!(fs::read_to_string(&file).unwrap(), "[site]\ntitle = \"mine\"\n");
}

#[test]
fn a_secret_in_a_url_is_not_repeated() {
    let place = Place::new();
    for data in ["https://me:hunter2@host/set", "https://hunter2@host/set", "https://host/set?sig=hunter2"] {
        let output = super::fixture::trainer(&["fit", "--data", data, "--run", text(&place.run)]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("--data") && !said.contains("hunter2"), "{said}");
    }
}

#[test]
fn a_run_inside_a_file_is_78() {
    let mut place = Place::new();
    fs::write(&place.run, "a file").unwrap();
    place.run = place.run.join("inside");
    check_fails(&place.fit(&[]), 78, &["run's folder"]);
}

#[test]
fn a_damaged_checkpoint_is_65_and_a_missing_one_78() {
    let place = Place::trained();
    let last = place.run.join("last.safetensors");
    let bytes = fs::read(&last).unwrap();
    fs::write(&last, &bytes[..bytes.len() / 2]).unwrap();
    check_fails(&place.fit(&["--resume", "--epochs", "2"]), 65, &["damaged checkpoint", "last.safetensors"]);
    let mut flipped = bytes.clone();
    flipped[bytes.len() / 2] ^= 1;
    fs::write(&last, flipped).unwrap();
    check_fails(
        &place.fit(&["--resume", "--epochs", "2"]),
        65,
        &["file_sha256 of its header must be", "last.safetensors"],
    );
    fs::remove_file(place.run.join("best.safetensors")).unwrap();
    check_fails(&["evaluate", "--run", text(&place.run), "--data", text(&place.data)], 78, &["no checkpoint here"]);
}

#[test]
fn a_checkpoint_of_another_architecture_is_78() {
    let place = Place::trained();
    let path = place.run.join("best.safetensors");
    let view = |shape: Vec<usize>, data: &'static [u8]| {
        safetensors::tensor::TensorView::new(safetensors::Dtype::F32, shape, data).unwrap()
    };
    let tensors = [("encoder.conv1.weight", view(vec![1, 1], &[0; 4])), ("mlp.weight", view(vec![2], &[0; 8]))];
    fs::write(&path, safetensors::serialize(tensors, None).unwrap()).unwrap();
    let args = ["evaluate", "--run", text(&place.run), "--data", text(&place.data)];
    check_fails(&args, 78, &["another architecture", "encoder.conv1.weight must be F32 of shape [16, 1, 5, 5, 5]"]);
}

#[test]
fn more_epochs_continue_a_finished_run() {
    let place = Place::trained();
    assert!(trainer(&place.fit(&["--resume", "--epochs", "2"])).status.success());
    assert_eq!(fs::read_to_string(place.run.join("metrics.jsonl")).unwrap().lines().count(), 2);
}
