//! The program under all its names starts and ends alike.

use std::fs::OpenOptions;
use std::process::{Command, Output};

const PROGRAMS: [(&str, &str); 3] = [
    ("graspmill", env!("CARGO_BIN_EXE_graspmill")),
    ("generator", env!("CARGO_BIN_EXE_generator")),
    ("trainer", env!("CARGO_BIN_EXE_trainer")),
];

fn check_is_75(name: &str, output: &Output, error: &str) {
    let stderr = String::from_utf8_lossy(&output.stderr);
    let is_right = output.status.code() == Some(75) && stderr.starts_with(&format!("error: {error}"));
    assert!(is_right, "{name}: {:?}: {stderr}", output.status);
}

#[test]
fn a_full_disk_behind_standard_output_is_75() {
    for (name, path) in PROGRAMS {
        for words in [&["--help"][..], &["--version"]] {
            let full = OpenOptions::new().write(true).open("/dev/full").unwrap();
            let output = Command::new(path).args(words).stdout(full).output().unwrap();
            check_is_75(name, &output, "failed to print: ");
        }
    }
}

/// Without the guard the system kills the program by a signal.
#[test]
fn a_file_size_limit_is_75() {
    let (name, path) = PROGRAMS[0];
    let folder = tempfile::tempdir().unwrap();
    let limited = "ulimit -f 0; exec \"$0\" manual man \"$1\"";
    let output = Command::new("sh").args(["-c", limited, path]).arg(folder.path()).output().unwrap();
    check_is_75(name, &output, "failed to write the manual into ");
}

#[test]
fn every_name_has_the_help_of_its_commands_and_refuses_others() {
    for (name, path) in PROGRAMS {
        let said = |word: &str| Command::new(path).arg(word).output().unwrap();
        let help = said("--help");
        assert!(help.status.success() && String::from_utf8_lossy(&help.stdout).contains("Usage: graspmill"), "{name}");
        assert_eq!(said("--version").stdout, format!("graspmill {}\n", env!("CARGO_PKG_VERSION")).as_bytes(), "{name}");
        assert_eq!(said("--nonsense").status.code(), Some(2), "{name}");
    }
}

#[test]
fn a_dry_run_of_a_pipeline_says_its_steps_and_files_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let words = ["pipeline", "wsg_50", "--out", "new", "--dry-run"];
    let output = Command::new(PROGRAMS[0].1).current_dir(&folder).args(words).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && said.starts_with("8 steps. "), "{output:?}");
    for text in ["new/from.safetensors\n", "new/generate.toml\n", "new/plan-wsg_50.toml\n", "\ngraspmill generate "] {
        assert!(said.contains(text), "{text}: {said}");
    }
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 0);
}
