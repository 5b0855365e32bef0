//! Bad input: one clear message, a documented exit code, nothing lost.

use crate::disk::Disk;

use super::{check_fails, check_ok, files, run, small_config, workshop};

#[test]
fn every_problem_of_a_config_is_told_at_once() {
    let config = small_config()
        .replace("resolution = 16", "resolution = 400")
        .replace("\n[settle]", "\ntypo = 1\n[settle]")
        .replace("friction = [0.8, 1.2]", "friction = [1.2, 0.8]");
    let output = run(&workshop(&config), "ds", &[]);
    check_fails(
        &output,
        78,
        &[
            "3 problems",
            "grid.resolution must be between 8 and 128, got 400",
            "objects.typo is an unknown key",
            "objects.friction must be a range [low, high] within [0, 5], got [1.2, 0.8]",
            "config.toml",
        ],
    );
}

#[test]
fn a_config_that_is_missing_or_no_toml_is_named() {
    let dir = workshop("seed = = 1");
    check_fails(&run(&dir, "ds", &[]), 78, &["not TOML", "config.toml"]);
    std::fs::remove_file(dir.path().join("config.toml")).unwrap();
    check_fails(&run(&dir, "ds", &[]), 78, &["failed to read the config", "config.toml"]);
}

#[test]
fn shard_counts_and_indices_out_of_range_are_refused() {
    let dir = workshop(&small_config());
    check_fails(&run(&dir, "ds", &["--shards", "0"]), 78, &["shards must be between 1 and 100000, got 0"]);
    check_fails(&run(&dir, "ds", &["--shards", "7"]), 78, &["at most the number of scenes, 6", "got 7"]);
    check_fails(&run(&dir, "ds", &["--shard-index", "1,3"]), 78, &["below the number of shards, 3, got 3"]);
    check_fails(&run(&dir, "ds", &["--shard-index", "x"]), 2, &["`x` is no shard index"]);
    check_fails(&run(&dir, "ds", &["--threads", "0"]), 2, &["--threads"]);
    assert!(!dir.path().join("ds").exists(), "nothing is made for a refused command");
}

#[test]
fn a_folder_that_holds_something_else_is_left_alone() {
    let dir = workshop(&small_config());
    check_ok(&run(&dir, "ds", &[]));
    let before = files(&dir.path().join("ds"));
    check_fails(&run(&dir, "ds", &["--seed", "2"]), 78, &["seed"]);
    check_fails(&run(&dir, "ds", &["--shards", "2"]), 78, &["shard"]);
    assert!(before == files(&dir.path().join("ds")));

    std::fs::create_dir(dir.path().join("papers")).unwrap();
    std::fs::write(dir.path().join("papers/thesis.txt"), "years of work").unwrap();
    check_fails(&run(&dir, "papers", &[]), 78, &["papers"]);
    assert_eq!(files(&dir.path().join("papers")).len(), 1);
}

#[test]
fn a_file_in_place_of_the_folder_is_named() {
    let dir = workshop(&small_config());
    std::fs::write(dir.path().join("ds"), "a file").unwrap();
    let output = run(&dir, "ds", &[]);
    assert!(matches!(output.status.code(), Some(75 | 78)), "{output:?}");
    check_fails(&output, output.status.code().unwrap(), &["ds"]);
}

#[test]
fn a_full_disk_loses_nothing_and_the_run_continues_when_there_is_room() {
    let dir = workshop(&small_config().replace("attempts = 70", "attempts = 700"));
    let Some(disk) = Disk::mount(192) else { return };
    let out = disk.path().join("ds");
    let out = out.to_str().unwrap();
    check_fails(&run(&dir, out, &[]), 75, &[out]);
    disk.grow(64 * 1024);
    check_ok(&run(&dir, out, &[]));
    assert!(disk.path().join("ds/meta/manifest.json").exists());
}
