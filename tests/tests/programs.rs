//! The five programs start and end alike.

use std::fs::OpenOptions;
use std::path::PathBuf;
use std::process::{Command, Output};

use workspace_tests::{assert_none, read};

const PROGRAMS: [&str; 5] = ["generator", "shards", "trainer", "planner", "experiments"];

/// Lines of a `main.rs`, at most: it calls `program::run`, and the commands are files of their own.
const MAIN_LINES_MAX: usize = 40;

/// A program of this build; `cargo build --workspace --bins` makes it, and so does `cargo test --workspace`.
fn path(name: &str) -> PathBuf {
    let tests = std::env::current_exe().expect("a test knows its file");
    let folder = tests.parent().and_then(|deps| deps.parent()).expect("tests lie in target/PROFILE/deps");
    let path = folder.join(name);
    assert!(path.is_file(), "{} is missing: cargo build --workspace --bins", path.display());
    path
}

fn problem(name: &str, output: &Output, error: &str) -> Option<String> {
    let stderr = String::from_utf8_lossy(&output.stderr);
    let is_right = output.status.code() == Some(75) && stderr.starts_with(&format!("error: {error}"));
    (!is_right).then(|| format!("{name}: {:?}: {stderr}", output.status))
}

#[test]
fn every_main_is_short_and_starts_like_the_others() {
    let problems = PROGRAMS.into_iter().filter_map(|name| {
        let text = read(&format!("{name}/src/main.rs"));
        let is_right = text.lines().count() < MAIN_LINES_MAX
            && text.contains(&format!("    program::run({name}::commands::run)\n"));
        (!is_right)
            .then(|| format!("{name}: main.rs must call program::run alone, in less than {MAIN_LINES_MAX} lines"))
    });
    assert_none("main.rs", &problems.collect::<Vec<_>>());
}

#[test]
fn a_full_disk_behind_standard_output_is_75() {
    let problems = PROGRAMS.into_iter().filter_map(|name| {
        let full = OpenOptions::new().write(true).open("/dev/full").unwrap();
        let output = Command::new(path(name)).args(["manual", "markdown"]).stdout(full).output().unwrap();
        problem(name, &output, "failed to print: ")
    });
    assert_none("full disk", &problems.collect::<Vec<_>>());
}

/// Without the guard the system kills the program by a signal.
#[test]
fn a_file_size_limit_is_75() {
    let problems = PROGRAMS.into_iter().filter_map(|name| {
        let folder = tempfile::tempdir().unwrap();
        let output = Command::new("sh")
            .args(["-c", "ulimit -f 0; exec \"$0\" manual man \"$1\""])
            .args([path(name), folder.path().to_owned()])
            .output()
            .unwrap();
        problem(name, &output, "failed to write the manual into ")
    });
    assert_none("file-size limit", &problems.collect::<Vec<_>>());
}
