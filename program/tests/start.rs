//! How a program starts and ends, seen from outside: this test runs itself as a program.
#![expect(clippy::unwrap_used, reason = "a test, though without the harness that clippy knows")]

use std::fs::OpenOptions;
use std::process::{Command, ExitCode as Status, Output, Stdio};

use program::{Exit, ExitCode, Failure, print, write};

/// Set where this test is the program.
const IS_PROGRAM: &str = "PROGRAM_UNDER_TEST";

#[derive(Debug, thiserror::Error)]
#[error("shard 3 is damaged")]
struct Damaged;

impl Exit for Damaged {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Data
    }
}

fn command(words: &[String]) -> Result<ExitCode, Failure> {
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["log"] => {
            tracing::warn!("a warning");
            tracing::info!("an information");
        }
        ["print"] => print("x".repeat(100_000))?,
        ["write", path] => write(path.as_ref(), [0; 100_000])?,
        ["fail"] => return Err(Damaged.into()),
        ["allocate", bytes] => {
            let blocks: Vec<Vec<u8>> = (0..bytes.parse::<usize>().unwrap() / 4096).map(|_| vec![1; 4096]).collect();
            print(blocks.len())?;
        }
        _ => panic!("a contradiction"),
    }
    Ok(ExitCode::Ok)
}

fn main() -> Status {
    if std::env::var_os(IS_PROGRAM).is_some() {
        return program::run(|| command(&std::env::args().skip(1).collect::<Vec<_>>())).into();
    }
    warnings_are_logged_by_default();
    an_error_is_printed_once_and_gives_the_exit_code();
    a_write_beyond_the_file_size_limit_fails_and_does_not_kill();
    a_full_disk_is_75_and_a_closed_pipe_no_error();
    a_panic_is_an_internal_error();
    out_of_memory_is_75_at_once_and_in_one_line();
    Status::SUCCESS
}

fn this(arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::current_exe().expect("a test knows its file"));
    command.args(arguments).env(IS_PROGRAM, "1").env_remove("GRASPMILL_LOG");
    command
}

fn check(output: &Output, code: i32, error: &str) {
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(code) && stderr.contains(error), "{:?}: {stderr}", output.status);
}

fn warnings_are_logged_by_default() {
    let logged = |output: Output| {
        let stderr = String::from_utf8(output.stderr).unwrap();
        [stderr.contains("a warning"), stderr.contains("an information")]
    };
    assert_eq!(logged(this(&["log"]).output().unwrap()), [true, false]);
    assert_eq!(logged(this(&["log"]).env("GRASPMILL_LOG", "info").output().unwrap()), [true, true]);
    assert_eq!(logged(this(&["log"]).env("GRASPMILL_LOG", "info,").output().unwrap()), [true, true]);
    assert_eq!(logged(this(&["log"]).env("GRASPMILL_LOG", "").output().unwrap()), [true, false]);
    assert_eq!(logged(this(&["log"]).env("GRASPMILL_LOG", "loud=very").output().unwrap()), [true, false]);
    assert_eq!(logged(this(&["log"]).env("GRASPMILL_LOG", "error").output().unwrap()), [false, false]);
}

fn an_error_is_printed_once_and_gives_the_exit_code() {
    let output = this(&["fail"]).output().unwrap();
    assert_eq!(String::from_utf8(output.stderr.clone()).unwrap(), "error: shard 3 is damaged\n");
    check(&output, 65, "");
}

fn a_write_beyond_the_file_size_limit_fails_and_does_not_kill() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large");
    let limited = Command::new("sh")
        .args(["-c", "ulimit -f 16; exec \"$0\" write \"$1\""])
        .args([std::env::current_exe().unwrap(), path.clone()])
        .env(IS_PROGRAM, "1")
        .output()
        .unwrap();
    check(&limited, 75, &format!("error: failed to write {}: ", path.display()));
    assert_eq!(folder.path().read_dir().unwrap().count(), 0, "nothing half-written is left");
    check(&this(&["write", path.to_str().unwrap()]).output().unwrap(), 0, "");
}

fn a_full_disk_is_75_and_a_closed_pipe_no_error() {
    let full = OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = this(&["print"]).stdout(full).output().unwrap();
    check(&output, 75, "error: failed to print: ");
    check(&this(&["write", "/dev/full"]).output().unwrap(), 75, "error: failed to write /dev/full: ");
    let mut closed = this(&["print"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(closed.stdout.take());
    check(&closed.wait_with_output().unwrap(), 0, "");
}

fn a_panic_is_an_internal_error() {
    let output = this(&["panic"]).output().unwrap();
    check(&output, 1, "a contradiction");
    check(&output, 1, "error: a defect of this program");
}

fn out_of_memory_is_75_at_once_and_in_one_line() {
    for backtrace in ["0", "1", "full"] {
        let output = Command::new("sh")
            .args(["-c", "ulimit -v 400000; exec timeout -s KILL 20 \"$0\" allocate 1000000000"])
            .arg(std::env::current_exe().unwrap())
            .env(IS_PROGRAM, "1")
            .env("RUST_BACKTRACE", backtrace)
            .output()
            .unwrap();
        check(&output, 75, "error: out of memory: ");
        assert_eq!(output.stderr.iter().filter(|byte| **byte == b'\n').count(), 1, "one line");
    }
    check(&this(&["allocate", "1000000"]).output().unwrap(), 0, "");
}
