//! House rules that no linter holds. A rule that must bend names the file here, where everyone sees it.

use std::os::unix::fs::PermissionsExt;

use workspace_tests::{SourceFile, assert_none, files, member_folders, members, read, read_toml, root};

/// Longest Rust or Python file; a longer one owns more than one thing.
const LINES_MAX: usize = 600;

/// Longest line with a comment, in characters; rustfmt holds code to the same width and leaves comments alone.
const COMMENT_COLUMNS_MAX: usize = 120;

/// Files that are longer, and how long they may be. They may shrink, not grow.
const LONG: &[(&str, usize)] = &[];

/// Module names that say nothing, so everything ends up in them.
const EMPTY_NAMES: &[&str] = &["utils", "util", "common", "core", "helpers", "helper", "misc"];

/// Put together here, so that this file does not break the rule it states.
const FORBIDDEN: &[(&str, &str)] = &[
    (concat!("#[", "allow("), "use #[expect(…, reason = \"…\")]"),
    (concat!("#![", "allow("), "use #![expect(…, reason = \"…\")]"),
    (concat!("to", "do!("), "write it, or open an issue"),
    (concat!("unimple", "mented!("), "write it, or return an error"),
    (concat!("db", "g!("), "left from debugging"),
];

fn rust_files() -> Vec<SourceFile> {
    files(|path| path.ends_with(".rs"))
}

fn is_text(path: &str) -> bool {
    let endings = [".rs", ".toml", ".md", ".sh", ".py", ".txt", ".yml", ".yaml", ".cff", ".sbatch"];
    let names = ["LICENSE-MIT", "LICENSE-APACHE", ".ci/run", ".gitignore", ".gitattributes", "Containerfile"];
    endings.iter().any(|ending| path.ends_with(ending)) || names.contains(&path)
}

#[test]
fn files_own_one_thing() {
    let allowed = |path: &str| LONG.iter().find(|(name, _)| *name == path).map_or(LINES_MAX, |(_, lines)| *lines);
    let mut problems = Vec::new();
    let code = files(|path| path.ends_with(".rs") || path.ends_with(".py"));
    for file in &code {
        let (lines, most) = (file.text.lines().count(), allowed(&file.path));
        if lines > most {
            problems.push(format!("{} has {lines} lines, at most {most}", file.path));
        }
    }
    for (path, _) in LONG {
        let lines = code.iter().find(|file| file.path == *path).map_or(0, |file| file.text.lines().count());
        if lines <= LINES_MAX {
            problems.push(format!("{path} has {lines} lines and needs no row in LONG any more"));
        }
    }
    assert_none("file length", &problems);
}

/// The comment in a line of Rust, Python or bash, if there is one.
fn comment<'a>(path: &str, line: &'a str) -> Option<&'a str> {
    let mark = if path.ends_with(".rs") { "//" } else { "#" };
    let line = line.trim_start();
    if line.starts_with(mark) { Some(line) } else { line.find(&format!(" {mark} ")).map(|at| &line[at + 1..]) }
}

#[test]
fn comments_are_not_wider_than_code() {
    let mut problems = Vec::new();
    let endings = [".rs", ".py", ".sh"];
    for file in files(|path| endings.iter().any(|ending| path.ends_with(ending))) {
        for (number, line) in file.text.lines().enumerate() {
            let columns = line.chars().count();
            if columns > COMMENT_COLUMNS_MAX && comment(&file.path, line).is_some() {
                problems.push(format!(
                    "{}:{}: {columns} columns, at most {COMMENT_COLUMNS_MAX}",
                    file.path,
                    number + 1
                ));
            }
        }
    }
    assert_none("comments", &problems);
}

#[test]
fn nothing_forbidden_is_written() {
    let mut problems = Vec::new();
    for file in rust_files() {
        for (number, line) in file.text.lines().enumerate() {
            for (words, instead) in FORBIDDEN.iter().filter(|(words, _)| line.contains(words)) {
                problems.push(format!("{}:{}: {words}: {instead}", file.path, number + 1));
            }
        }
    }
    assert_none("forbidden", &problems);
}

#[test]
fn only_the_allocator_is_unsafe() {
    let words = concat!("expect(", "unsafe_code");
    let unsafe_files: Vec<String> =
        rust_files().into_iter().filter(|file| file.text.contains(words)).map(|file| file.path).collect();
    assert_eq!(unsafe_files, ["program/src/allocator.rs"]);
}

#[test]
fn every_file_says_what_it_is_for() {
    let mut problems = Vec::new();
    for file in rust_files() {
        let said = file.text.lines().take_while(|line| line.starts_with("//!")).count();
        let least = if file.path.ends_with("/lib.rs") { 3 } else { 1 };
        if said < least {
            problems.push(format!("{} begins with {said} lines of //!, at least {least}", file.path));
        }
    }
    assert_none("module docs", &problems);
}

#[test]
fn text_is_clean() {
    let mut problems = Vec::new();
    for file in files(is_text) {
        for (number, line) in file.text.lines().enumerate() {
            if line.contains('\t') {
                problems.push(format!("{}:{}: a tab", file.path, number + 1));
            }
            if line.ends_with([' ', '\r']) {
                problems.push(format!("{}:{}: blanks at the end", file.path, number + 1));
            }
        }
        if !file.text.is_empty() && !file.text.ends_with('\n') {
            problems.push(format!("{}: no newline at the end", file.path));
        }
    }
    assert_none("text", &problems);
}

#[test]
fn no_module_has_an_empty_name() {
    let mut problems = Vec::new();
    for file in rust_files() {
        let mut parts = file.path.trim_end_matches(".rs").split('/');
        if parts.any(|part| EMPTY_NAMES.contains(&part)) {
            problems.push(format!("{}: name what it owns", file.path));
        }
    }
    assert_none("module names", &problems);
}

#[test]
fn configs_begin_with_what_they_are_for() {
    let unsaid = files(|path| path.starts_with("configs/") && path.ends_with(".toml"))
        .into_iter()
        .filter(|file| !file.text.starts_with("# "))
        .map(|file| format!("{}: begin with a comment", file.path));
    assert_none("configs", &unsaid.collect::<Vec<_>>());
}

#[test]
fn members_share_the_laws_and_the_versions() {
    let mut problems = Vec::new();
    for folder in member_folders() {
        let manifest = read_toml(&format!("{folder}/Cargo.toml"));
        let shared = |table: Option<&toml::Value>| {
            table.and_then(|table| table.get("workspace")).and_then(toml::Value::as_bool) == Some(true)
        };
        if !shared(manifest.get("lints")) {
            problems.push(format!("{folder}: lints must be the workspace's"));
        }
        for key in ["version", "edition", "rust-version", "license", "publish"] {
            if !shared(manifest["package"].get(key)) {
                problems.push(format!("{folder}: {key} must be the workspace's"));
            }
        }
        for kind in ["dependencies", "dev-dependencies", "build-dependencies"] {
            for (name, dependency) in manifest.get(kind).and_then(toml::Value::as_table).into_iter().flatten() {
                // A crate that turns on a feature of its own for its tests names itself by its path.
                let is_itself = manifest["package"]["name"].as_str() == Some(name);
                if !is_itself && !shared(Some(dependency)) {
                    problems.push(format!("{folder}: {name}'s version must stand in the root manifest"));
                }
            }
        }
    }
    assert_none("manifests", &problems);
}

#[test]
fn versions_are_pinned() {
    let manifest = read_toml("Cargo.toml");
    let dependencies = manifest["workspace"]["dependencies"].as_table().unwrap();
    let loose = dependencies.iter().filter_map(|(name, dependency)| {
        let version = dependency.as_str().or_else(|| dependency.get("version")?.as_str());
        let pinned = dependency.get("path").is_some() || version.is_some_and(|version| version.starts_with('='));
        (!pinned).then(|| format!("{name} must be pinned with =, got {version:?}"))
    });
    assert_none("versions", &loose.collect::<Vec<_>>());
}

#[test]
fn the_architecture_page_names_every_member() {
    let page = read("ARCHITECTURE.md");
    let named = |folder: &str| page.contains(&format!("`{folder}`")) || page.contains(&format!("`{folder}/`"));
    let unnamed = member_folders().into_iter().filter(|folder| !named(folder));
    assert_none("ARCHITECTURE.md must name", &unnamed.collect::<Vec<_>>());
}

#[test]
fn the_images_are_built_from_every_member() {
    let file = read("Containerfile");
    let missing = member_folders().into_iter().filter(|folder| !file.contains(&format!("\nCOPY {folder} {folder}\n")));
    assert_none("Containerfile must copy", &missing.collect::<Vec<_>>());
}

#[test]
fn members_are_named_as_their_folders() {
    let is_so = |folder: &str, name: &str| match name {
        "graspmill" => folder == "cli",
        name => folder == name.trim_start_matches("workspace-"),
    };
    let strangers = members().into_iter().filter(|(folder, name)| !is_so(folder, name));
    assert_none("members", &strangers.map(|(folder, name)| format!("{folder} is named {name}")).collect::<Vec<_>>());
}

#[test]
fn schema_does_no_io() {
    let doors = ["std::fs", "std::io", "std::net", "std::env", "std::process", "std::thread"];
    let mut problems = Vec::new();
    for file in files(|path| path.starts_with("schema/src/")) {
        for door in doors.into_iter().filter(|door| file.text.contains(door)) {
            problems.push(format!("{}: {door}", file.path));
        }
    }
    assert_none("schema does no IO", &problems);
}

#[test]
fn scripts_can_be_run_and_stop_at_errors() {
    let mut problems = Vec::new();
    for file in files(|path| path == ".ci/run" || (path.ends_with(".sh") && !path.starts_with('.'))) {
        let mode = root().join(&file.path).metadata().unwrap().permissions().mode();
        if mode & 0o111 == 0 {
            problems.push(format!("{}: not executable", file.path));
        }
        if !file.text.starts_with("#!/usr/bin/env bash\n") {
            problems.push(format!("{}: must begin with #!/usr/bin/env bash", file.path));
        }
        if !file.text.contains("\nset -euo pipefail\n") {
            problems.push(format!("{}: must set -euo pipefail", file.path));
        }
    }
    assert_none("scripts", &problems);
}
