//! A writer killed at any moment leaves a dataset that the next one completes, byte for byte.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use shards::{DatasetInfo, Draft, Finalized};

use crate::sample;

const DIR: &str = "SHARDS_TEST_KILLED_DIR";

fn info() -> DatasetInfo {
    sample::sized(6, 8, 400, 5)
}

fn write_what_is_missing(dir: &Path) -> Draft {
    let draft = Draft::begin(dir, &info()).unwrap();
    for shard in draft.missing().unwrap() {
        sample::write_shard(&draft, shard);
    }
    draft
}

/// Not a test by itself: the program that is killed.
#[test]
fn child() {
    if let Some(dir) = std::env::var_os(DIR) {
        write_what_is_missing(Path::new(&dir));
    }
}

#[test]
fn killed_writers_leave_what_the_next_one_completes() {
    let (whole, dir) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    write_what_is_missing(whole.path()).finalize().unwrap();
    for round in 0..25 {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "killed::child"])
            .env(DIR, dir.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(2 + 3 * round % 23));
        child.kill().unwrap();
        child.wait().unwrap();
        if round % 6 == 5 {
            let _ = std::fs::remove_file(dir.path().join(shards::layout::marker(round as u32 % 8)));
        }
    }
    let draft = write_what_is_missing(dir.path());
    assert!(matches!(draft.finalize().unwrap(), Finalized::Complete(_)));
    assert_eq!(sample::files(dir.path()), sample::files(whole.path()));
}

#[test]
fn writers_of_the_same_shards_at_the_same_time_agree() {
    let (whole, dir) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    write_what_is_missing(whole.path()).finalize().unwrap();
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| write_what_is_missing(dir.path()));
        }
    });
    Draft::open(dir.path()).unwrap().finalize().unwrap();
    assert_eq!(sample::files(dir.path()), sample::files(whole.path()));
}
