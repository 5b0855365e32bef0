//! The workspace's own tests: fences between the crates, the house rules that no other tool checks, and the licences of
//! the dependencies.
//!
//! This library is what those tests need to look at the repository: its root, its members, its files. The tests are in
//! `tests/tests`, one file for each kind of rule.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Folders that hold what was made, not what was written: anywhere, and at the root.
const MADE: &[&str] = &["target", ".git", ".venv", "__pycache__", ".pytest_cache"];
const MADE_AT_ROOT: &[&str] = &["data", "runs"];

/// A file of the repository.
#[derive(Debug)]
pub struct SourceFile {
    /// Path from the repository's root, with `/`.
    pub path: String,
    /// What it says.
    pub text: String,
}

/// The repository's root.
#[must_use]
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package lies in the repository").to_owned()
}

/// A file's text.
///
/// # Panics
/// If the repository has no such text file.
#[must_use]
pub fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// A TOML file, parsed.
///
/// # Panics
/// If the repository has no such file, or it is not TOML.
#[must_use]
pub fn read_toml(path: &str) -> toml::Table {
    read(path).parse().unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// Folders of the workspace's members, as the root manifest lists them.
///
/// # Panics
/// If the root manifest does not list them.
#[must_use]
pub fn member_folders() -> Vec<String> {
    let manifest = read_toml("Cargo.toml");
    let members = manifest["workspace"]["members"].as_array().expect("members is a list");
    members.iter().map(|member| member.as_str().expect("a member is a path").to_owned()).collect()
}

/// Folder and name of every member; libraries for other projects have the prefix `graspmill-` in Cargo alone.
///
/// # Panics
/// If a member's manifest has no name.
#[must_use]
pub fn members() -> Vec<(String, String)> {
    let name = |folder: String| {
        let manifest = read_toml(&format!("{folder}/Cargo.toml"));
        let name = manifest["package"]["name"].as_str().expect("a package has a name");
        (folder, name.trim_start_matches("graspmill-").to_owned())
    };
    member_folders().into_iter().map(name).collect()
}

/// The repository's files whose path `wanted` accepts, sorted by path.
///
/// # Panics
/// If one of them cannot be read as text.
#[must_use]
pub fn files(wanted: impl Fn(&str) -> bool) -> Vec<SourceFile> {
    let mut paths = Vec::new();
    walk(&root(), "", &mut paths);
    paths.retain(|path| wanted(path));
    paths.sort();
    paths.into_iter().map(|path| SourceFile { text: read(&path), path }).collect()
}

fn walk(folder: &Path, prefix: &str, paths: &mut Vec<String>) {
    for entry in fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
        let entry = entry.unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
        let name = entry.file_name().to_string_lossy().into_owned();
        let kind = entry.file_type().unwrap_or_else(|e| panic!("{prefix}{name}: {e}"));
        let made = MADE.contains(&name.as_str()) || (prefix.is_empty() && MADE_AT_ROOT.contains(&name.as_str()));
        if kind.is_dir() && !made {
            walk(&entry.path(), &format!("{prefix}{name}/"), paths);
        } else if kind.is_file() {
            paths.push(format!("{prefix}{name}"));
        }
    }
}

/// The lines that `cargo tree` prints with these arguments, without the marks for repeated packages; sorted, each once.
///
/// # Panics
/// If cargo cannot be run or fails; what it said is in the message.
#[must_use]
pub fn cargo_tree(arguments: &[&str]) -> Vec<String> {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let output = Command::new(cargo)
        .args(["tree", "--locked", "--prefix", "none"])
        .args(arguments)
        .current_dir(root())
        .output()
        .unwrap_or_else(|e| panic!("failed to run cargo tree: {e}"));
    assert!(output.status.success(), "cargo tree {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let mut lines: Vec<String> = text.lines().map(|line| line.trim_end_matches(" (*)").to_owned()).collect();
    lines.sort();
    lines.dedup();
    lines
}

/// Fails with all the problems at once, one a line.
///
/// # Panics
/// If there are any.
pub fn assert_none(rule: &str, problems: &[String]) {
    assert!(problems.is_empty(), "{rule}:\n  {}", problems.join("\n  "));
}
