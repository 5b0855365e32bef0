//! The program, run as people run it.

use std::path::Path;
use std::process::{Command, Output};

use crate::sample;

fn shards(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_shards")).args(args).output().unwrap()
}

/// A dataset of 600 attempts at full variety on a coarse grid.
fn dataset() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    sample::write(dir.path(), &sample::sized(42, 3, 600, 20));
    dir
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn report_reads_well() {
    let dir = dataset();
    let output = shards(&["report", text(dir.path())]);
    assert!(output.status.success());
    insta::assert_snapshot!("report", String::from_utf8(output.stdout).unwrap());
    let output = shards(&["report", text(dir.path()), "--json"]);
    insta::assert_snapshot!("report_json", String::from_utf8(output.stdout).unwrap());
}

#[test]
fn inspect_reads_well() {
    let dir = dataset();
    let output = shards(&["inspect", text(dir.path()), "--scene", "3"]);
    assert!(output.status.success());
    insta::assert_snapshot!("inspect", String::from_utf8(output.stdout).unwrap());
    let output = shards(&["inspect", text(dir.path()), "--scene", "30"]);
    assert_eq!(output.status.code(), Some(78));
    assert_eq!(String::from_utf8(output.stderr).unwrap(), "error: scene must be below 30, got 30\n");
}

#[test]
fn the_card_reads_well() {
    let dir = dataset();
    let card = std::fs::read_to_string(dir.path().join("README.md")).unwrap();
    insta::assert_snapshot!("card", card);
}

#[test]
fn verify_says_ok_or_what_is_wrong() {
    let dir = dataset();
    let output = shards(&["verify", text(dir.path())]);
    assert_eq!(output.status.code(), Some(0));
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(told.ends_with("bytes read and checked\nok\n"), "{told}");

    let file = dir.path().join("objects/shard-00001-of-00003.parquet");
    let mut bytes = std::fs::read(&file).unwrap();
    bytes[100] ^= 1;
    std::fs::write(&file, bytes).unwrap();
    let output = shards(&["verify", text(dir.path())]);
    assert_eq!(output.status.code(), Some(65));
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(told.starts_with("shard 1: sha256 must be ") && told.ends_with("NOT ok: 1 problems\n"), "{told}");
    let output = shards(&["report", text(dir.path())]);
    assert_eq!(output.status.code(), Some(0), "objects are not read for the report");
}

#[test]
fn every_way_to_fail_has_its_code() {
    let dir = tempfile::tempdir().unwrap();
    let empty = dir.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    assert_eq!(shards(&["verify", text(&empty)]).status.code(), Some(78));
    assert_eq!(shards(&["verify"]).status.code(), Some(2));
    assert_eq!(shards(&["frobnicate"]).status.code(), Some(2));
    let begun = dir.path().join("begun");
    shards::Draft::begin(&begun, &sample::info(1)).unwrap();
    let output = shards(&["verify", text(&begun)]);
    assert_eq!(output.status.code(), Some(69));
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(told.starts_with("error: the dataset is not complete, there is no meta/manifest.json"), "{told}");
}

#[test]
fn export_says_how_much_and_refuses_what_is_taken() {
    let dir = dataset();
    let out = tempfile::tempdir().unwrap();
    let to = out.path().join("tars");
    let output = shards(&["export", text(dir.path()), "--format", "webdataset", "--out", text(&to)]);
    assert_eq!(output.status.code(), Some(0));
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(told.starts_with("600 grasps (") && told.contains("in 30 scenes: "), "{told}");
    assert_eq!(String::from_utf8(output.stderr).unwrap(), "", "no bar without a terminal");
    let output = shards(&["export", text(dir.path()), "--format", "webdataset", "--out", text(dir.path())]);
    assert_eq!(output.status.code(), Some(78));
    let output = shards(&["export", text(dir.path()), "--format", "vgn", "--out", text(&to)]);
    assert_eq!(output.status.code(), Some(78), "8^3 voxels");
    let output = shards(&["export", text(dir.path()), "--format", "hdf5", "--out", text(&to)]);
    assert_eq!(output.status.code(), Some(2));
    let help = String::from_utf8(shards(&["export", "--help"]).stdout).unwrap();
    assert!(help.contains("Examples:") && help.contains("webdataset") && help.contains("GIGA"), "{help}");
}

#[test]
fn help_shows_examples_and_exit_codes() {
    let help = String::from_utf8(shards(&["--help"]).stdout).unwrap();
    for part in ["Examples:", "shards inspect data/demo --scene 17", "Exit codes:", "65  data damaged"] {
        assert!(help.contains(part), "{help}");
    }
}
