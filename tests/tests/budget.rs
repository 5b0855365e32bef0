//! How large the house may be: lines of code a crate, and of Python.
//!
//! A row may shrink, not grow. A change that must grow one says in its commit what went for it. `cargo test -p
//! workspace-tests --test budget -- --nocapture` prints the table as it is.

use workspace_tests::{SourceFile, assert_none, files, member_folders};

/// Lines of Rust code by folder, without tests, comments and blanks.
const RUST_MAX: &[(&str, usize)] = &[
    ("settings", 585),
    ("schema", 2312),
    ("program", 469),
    ("report", 825),
    ("shards", 3704),
    ("inspect", 1027),
    ("simulator", 5188),
    ("perception", 2829),
    ("grasps", 768),
    ("network", 2400),
    ("generator", 4361),
    ("trainer", 2773),
    ("planner", 5188),
    ("experiments", 1258),
    ("cli", 2704),
    ("python", 1610),
];

/// Lines of Python by folder, without comments and blanks; docstrings count.
const PYTHON_MAX: &[(&str, usize)] =
    &[("python/graspmill", 5000), ("scripts", 3470), ("lab", 526), ("ros2", 569), ("tests/python", 8987)];

/// The lines of a Rust file that count: not blank, not a comment, and not of an item under `#[cfg(test)]`. The
/// formatter ends an item with a line that is as deep as its first one.
fn rust_lines(text: &str) -> usize {
    let mut lines = text.lines();
    let mut count = 0;
    while let Some(line) = lines.next() {
        let code = line.trim_start();
        if code == "#[cfg(test)]" {
            let depth = &line[..line.len() - code.len()];
            let ends = |line: &str| {
                let item = line.strip_prefix(depth).unwrap_or_default();
                item.starts_with('}') || (item.ends_with([';', ',', '}']) && !item.starts_with([' ', '#']))
            };
            let _ = lines.by_ref().find(|line| ends(line));
        } else if !code.is_empty() && !code.starts_with("//") {
            count += 1;
        }
    }
    count
}

/// The lines of a Python file that are neither blank nor a comment.
fn python_lines(text: &str) -> usize {
    text.lines().map(str::trim_start).filter(|line| !line.is_empty() && !line.starts_with('#')).count()
}

/// Whether a Rust file is a test as a whole.
fn is_test(path: &str) -> bool {
    ["/tests/", "/benches/", "/examples/"].iter().any(|part| path.contains(part)) || path.ends_with("/tests.rs")
}

/// The problems of what was counted beside what is allowed, and the table.
fn beside(counted: &[(String, usize)], allowed: &[(&str, usize)]) -> (Vec<String>, String) {
    let mut problems = Vec::new();
    for (folder, lines) in counted {
        match allowed.iter().find(|(name, _)| name == folder) {
            None => problems.push(format!("{folder} has {lines} lines and no row")),
            Some((_, most)) if lines > most => problems.push(format!("{folder} has {lines} lines, at most {most}")),
            Some((_, most)) if lines + lines / 20 + 20 < *most => {
                problems.push(format!("{folder} has {lines} lines and may have {most}: lower its row"));
            }
            Some(_) => {}
        }
    }
    let gone = allowed.iter().filter(|(name, _)| !counted.iter().any(|(folder, _)| folder == name));
    problems.extend(gone.map(|(name, _)| format!("{name} is gone: remove its row")));
    let rows: String = counted.iter().map(|(folder, lines)| format!("    (\"{folder}\", {lines}),\n")).collect();
    let sum: usize = counted.iter().map(|(_, lines)| lines).sum();
    (problems, format!("{rows}    {sum} in all"))
}

/// The lines of some files, folder by folder.
fn counted(folders: Vec<String>, sources: &[SourceFile], lines: fn(&str) -> usize) -> Vec<(String, usize)> {
    let of = |folder: String| {
        let own = sources.iter().filter(|file| file.path.starts_with(&format!("{folder}/")));
        let count = own.map(|file| lines(&file.text)).sum();
        (folder, count)
    };
    folders.into_iter().map(of).collect()
}

#[test]
fn rust_stays_within_its_budget() {
    let folders = member_folders().into_iter().filter(|folder| folder != "tests").collect();
    let counted = counted(folders, &files(|path| path.ends_with(".rs") && !is_test(path)), rust_lines);
    let (problems, table) = beside(&counted, RUST_MAX);
    println!("{table}");
    assert_none("budget", &problems);
}

#[test]
fn python_stays_within_its_budget() {
    let folders = ["python/graspmill", "scripts", "lab", "ros2", "tests/python"].map(str::to_owned).to_vec();
    let counted = counted(folders, &files(|path| path.ends_with(".py")), python_lines);
    let (problems, table) = beside(&counted, PYTHON_MAX);
    println!("{table}");
    assert_none("budget", &problems);
}

#[test]
fn tests_comments_and_blanks_do_not_count() {
    let text = "\
//! What it is.

use std::fs;

/// Counts.
fn counts() -> usize {
    // Because.
    1 // one
}

#[cfg(test)]
use std::io;

impl Thing {
    #[cfg(test)]
    fn tried(
        &self,
    ) -> usize {
        2
    }

    fn kept(&self) {}
}

#[cfg(test)]
mod tests {
    #[test]
    fn it_counts() {
        assert_eq!(super::counts(), 1);
    }
}
";
    assert_eq!(rust_lines(text), 7);
    assert_eq!(python_lines("# Why.\n\nimport os\n\n\ndef f():\n    # Because.\n    return 1\n"), 3);
    assert!(
        is_test("shards/tests/it/write.rs") && is_test("planner/src/input/tests.rs") && !is_test("shards/src/lib.rs")
    );
}
