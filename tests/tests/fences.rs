//! Which crate may use which. The table of ARCHITECTURE.md lists each member's direct dependencies on other members;
//! the manifests must say the same, every dependency must be used, and no member may link a family of crates that
//! belongs to another room.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

use workspace_tests::{assert_none, cargo_tree, files, members, read, read_toml};

/// Families of outside crates that a member must not link, directly or through others: `arrow` stands for `arrow` and
/// `arrow-…`.
const NEVER: &[(&str, &[&[&str]])] = &[
    ("settings", &[PHYSICS, LEARNING, COLUMNS, NETWORK]),
    ("schema", &[PHYSICS, LEARNING, COLUMNS, NETWORK]),
    ("program", &[PHYSICS, LEARNING, COLUMNS, NETWORK]),
    ("report", &[PHYSICS, LEARNING, COLUMNS, NETWORK]),
    ("shards", &[PHYSICS, LEARNING]),
    ("inspect", &[LEARNING]),
    ("simulator", &[LEARNING, COLUMNS, NETWORK]),
    ("perception", &[PHYSICS, LEARNING, COLUMNS, NETWORK]),
    ("grasps", &[PHYSICS, LEARNING, COLUMNS, NETWORK]),
    ("generator", &[LEARNING]),
    ("network", &[PHYSICS, LEARNING, COLUMNS, NETWORK]),
    ("trainer", &[PHYSICS, BACKENDS]),
    ("planner", &[PHYSICS, LEARNING, COLUMNS, STORES]),
    ("experiments", &[LEARNING]),
    ("graspmill", &[BACKENDS]),
    ("python", &[BACKENDS]),
    ("workspace-tests", &[PHYSICS, LEARNING, COLUMNS, NETWORK]),
];

const PHYSICS: &[&str] = &["rapier3d", "parry3d"];
const LEARNING: &[&str] = &["burn"];
/// What `trainer` links only with a cargo feature.
const BACKENDS: &[&str] = &["burn-autodiff", "burn-flex", "burn-tensor"];
const COLUMNS: &[&str] = &["arrow", "parquet"];
const NETWORK: &[&str] = &["object_store", "reqwest", "hyper", "tokio"];
/// Of these the clients, for `planner`, which serves.
const STORES: &[&str] = &["object_store", "reqwest"];

/// Outside crates that only one member may name: whoever else needs what they do asks that member.
const OWNED: &[(&str, &str)] = &[
    ("arrow", "shards"),
    ("axum", "planner"),
    ("clap", "graspmill"),
    ("indicatif", "graspmill"),
    ("burn", "trainer"),
    ("numpy", "python"),
    ("object_store", "shards"),
    ("parquet", "shards"),
    ("parry3d", "simulator"),
    ("pyo3", "python"),
    ("rapier3d", "simulator"),
];

/// Dependencies that no code names: they turn on a feature of a crate that another dependency brings.
const FOR_FEATURES: &[(&str, &str)] = &[("shards", "reqwest")];

/// Folders from which any crate may include a file: they belong to no crate, or hold what only tests need.
const SHARED: &[&str] = &["configs", "docs", "models", "tests"];

/// A member's direct dependencies.
#[derive(Debug, Default, PartialEq, Eq)]
struct Dependencies {
    normal: BTreeSet<String>,
    /// For tests, benches and examples only.
    dev: BTreeSet<String>,
}

/// The rows of the page's table `| crate | owns | depends on |`. What stands after `in tests:` are dev-dependencies.
fn listed(page: &str) -> BTreeMap<String, Dependencies> {
    let rows = page.lines().skip_while(|line| !line.starts_with("| crate |")).skip(2);
    let rows = rows.map_while(|line| line.strip_prefix("| ")?.strip_suffix(" |"));
    let names = |cell: &str| cell.split('`').skip(1).step_by(2).map(str::to_owned).collect::<Vec<_>>();
    rows.map(|row| {
        let cells: Vec<&str> = row.split(" | ").collect();
        let [name, _, depends] = cells[..] else { panic!("the row must have three cells: {row}") };
        let (normal, dev) = depends.split_once("in tests:").unwrap_or((depends, ""));
        let name = names(name).pop().expect("a row begins with the crate's name");
        (name, Dependencies { normal: names(normal).into_iter().collect(), dev: names(dev).into_iter().collect() })
    })
    .collect()
}

/// What a member's manifest lists.
fn dependencies(folder: &str) -> Dependencies {
    let manifest = read_toml(&format!("{folder}/Cargo.toml"));
    let targets = manifest.get("target").and_then(toml::Value::as_table).into_iter().flatten();
    let tables = [&manifest].into_iter().chain(targets.filter_map(|(_, target)| target.as_table()));
    let mut found = Dependencies::default();
    for table in tables {
        let names = |kind: &str| {
            let names = table.get(kind).and_then(toml::Value::as_table).into_iter().flatten();
            names.map(|(name, _)| name.clone()).collect::<Vec<_>>()
        };
        found.normal.extend(names("dependencies"));
        found.normal.extend(names("build-dependencies"));
        found.dev.extend(names("dev-dependencies"));
    }
    found
}

#[test]
fn members_depend_on_what_the_architecture_page_lists() {
    let names: BTreeSet<String> = members().into_iter().map(|(_, name)| name).collect();
    let listed = listed(&read("ARCHITECTURE.md"));
    let mut problems = Vec::new();
    for (folder, name) in members() {
        let of_members = |found: BTreeSet<String>| found.intersection(&names).cloned().collect();
        let Dependencies { normal, dev } = dependencies(&folder);
        let found = Dependencies { normal: of_members(normal), dev: of_members(dev) };
        match listed.get(&name) {
            Some(row) if *row == found => {}
            row => problems.push(format!("{name}'s manifest has {found:?}, ARCHITECTURE.md lists {row:?}")),
        }
    }
    assert_none("ARCHITECTURE.md's table of crates", &problems);
    let unknown: Vec<String> = listed.into_keys().filter(|name| !names.contains(name)).collect();
    assert_none("ARCHITECTURE.md's table has crates that are no members", &unknown);
}

#[test]
fn every_dependency_is_named_where_it_is_needed() {
    let mut problems = Vec::new();
    for (folder, name) in members() {
        let (mut code, mut tests) = (String::new(), String::new());
        for file in files(|path| path.ends_with(".rs") && path.starts_with(&format!("{folder}/"))) {
            let (normal, test) = halves(&file.path, &file.text);
            code.push_str(normal);
            tests.push_str(test);
        }
        let Dependencies { normal, dev } = dependencies(&folder);
        let for_features = |of: &str| FOR_FEATURES.contains(&(name.as_str(), of));
        for unused in normal.iter().filter(|of| !names_crate(&code, of) && !for_features(of)) {
            problems.push(format!("{name}: {unused} is a dependency, and no code outside of tests names it"));
        }
        for unused in dev.iter().filter(|of| !names_crate(&tests, of)) {
            problems.push(format!("{name}: {unused} is a dev-dependency, and no test names it"));
        }
        for twice in normal.intersection(&dev) {
            problems.push(format!("{name}: {twice} is a dependency twice"));
        }
        for (owned, owner) in OWNED.iter().filter(|(owned, owner)| *owner != name && normal.contains(*owned)) {
            problems.push(format!("{name}: only {owner} may use {owned} directly"));
        }
    }
    assert_none("dependencies", &problems);
}

/// A file's text outside of tests, and what only tests, benches and examples see.
fn halves<'a>(path: &str, text: &'a str) -> (&'a str, &'a str) {
    let is_test = path.ends_with("/tests.rs")
        || ["/tests/", "/benches/", "/examples/"].iter().any(|folder| path.contains(folder)) && !path.contains("/src/");
    let from = if is_test { 0 } else { text.find("#[cfg(test)]\nmod tests {").unwrap_or(text.len()) };
    text.split_at(from)
}

/// Whether some line of code, not a comment, has a path that begins with this crate.
fn names_crate(code: &str, name: &str) -> bool {
    let name = name.replace('-', "_");
    let begins = |before: &str| {
        let before = before.strip_suffix("::").unwrap_or(before);
        !before.ends_with(|c: char| c.is_alphanumeric() || c == '_')
    };
    let ends = |after: &str| ["::", ";", " as "].iter().any(|end| after.starts_with(end));
    let mut lines = code.lines().filter(|line| !line.trim_start().starts_with("//"));
    lines.any(|line| line.match_indices(&name).any(|(at, _)| begins(&line[..at]) && ends(&line[at + name.len()..])))
}

/// Which of `tree` (lines of `cargo tree`) belong to a family.
fn of_families<'a>(tree: &'a [String], families: &[&[&str]]) -> Vec<&'a String> {
    let is_of = |name: &str, family: &str| {
        name.strip_prefix(family).is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
    };
    let name = |line: &'a String| line.split(' ').next().unwrap_or_default();
    tree.iter().filter(|line| families.iter().copied().flatten().any(|family| is_of(name(line), family))).collect()
}

/// The program without the feature `full` runs on a robot: no physics, no columns, no clients of stores.
#[test]
fn the_robots_program_links_what_planning_needs() {
    let tree = cargo_tree(&["-p", "graspmill", "--no-default-features", "-e", "normal,build"]);
    let found = of_families(&tree, &[PHYSICS, LEARNING, COLUMNS, STORES]);
    assert_none("the robot's program", &found.into_iter().cloned().collect::<Vec<_>>());
    assert!(tree.iter().any(|line| line.starts_with("planner ")), "{tree:?}");
}

/// Whether a file is no test as a whole.
fn is_product(path: &str) -> bool {
    // The last injects faults in tests.
    let is_test = path.starts_with("tests/") || path.ends_with("/tests.rs") || path == "shards/src/store/fault.rs";
    path.contains("/src/") && path.ends_with(".rs") && !is_test
}

/// What a command needs of another is a call: exit codes and printed text are for people and schedulers.
#[test]
fn no_crate_starts_a_process() {
    let problems: Vec<String> = files(is_product)
        .iter()
        .filter(|file| halves(&file.path, &file.text).0.contains("process::Command"))
        .map(|file| format!("{} starts a process", file.path))
        .collect();
    assert_none("processes", &problems);
}

/// Calls from Python, by file, whose work no threads share: who adds one knows that nothing below it uses rayon.
const ALONE: &[(&str, usize)] = &[
    ("python/src/dataset.rs", 7),
    ("python/src/experiment.rs", 1),
    ("python/src/fault.rs", 1),
    ("python/src/plan.rs", 2),
    ("python/src/pool.rs", 2),
    ("python/src/programs.rs", 3),
    ("python/src/scene.rs", 1),
];

/// The process's threads do not outlive a fork, as of PyTorch's workers: a child that shares work among them waits for
/// ever. So only programs use them, and the package has threads of its own.
#[test]
fn the_package_has_threads_of_its_own() {
    let mut problems = Vec::new();
    for file in files(is_product) {
        let code = halves(&file.path, &file.text).0;
        let count = |words: &[&str]| words.iter().map(|words| code.matches(*words).count()).sum::<usize>();
        let is_program = file.path.starts_with("cli/") || file.path == "program/src/start.rs";
        if !is_program && count(&["build_global", "start_threads(", "rayon::spawn(", "rayon::scope("]) > 0 {
            problems.push(format!("{} uses the threads of the process", file.path));
        }
        let alone = count(&["free(py, ", "detached(py, "]).saturating_sub(count(&["on_threads("]));
        let known = ALONE.iter().find(|(path, _)| *path == file.path).map_or(0, |(_, known)| *known);
        if alone != known {
            let path = &file.path;
            problems.push(format!("{path}: {alone} calls without on_threads, {known} are known to need no threads"));
        }
    }
    assert_none("threads", &problems);
}

#[test]
fn no_member_links_a_family_that_it_must_not() {
    let mut problems = Vec::new();
    for (folder, name) in members() {
        let row = NEVER.iter().find(|(of, _)| *of == name);
        let (_, families) = row.unwrap_or_else(|| panic!("{name} needs its row in NEVER"));
        let tree = cargo_tree(&["--manifest-path", &format!("{folder}/Cargo.toml"), "-e", "normal,build"]);
        let found = of_families(&tree, families);
        problems.extend(found.into_iter().map(|line| format!("{name} must not link {line}")));
    }
    assert_none("families", &problems);
    assert_eq!(NEVER.len(), members().len(), "no row without a member");
}

/// The folder at the root that a path leads to, from the folder of the file that names it.
fn reached(from: &str, path: &str) -> String {
    let mut whole = PathBuf::new();
    for part in Path::new(from).parent().unwrap_or(Path::new("")).join(path).components() {
        if part == Component::ParentDir {
            whole.pop();
        } else {
            whole.push(part);
        }
    }
    whole.iter().next().unwrap_or_default().to_string_lossy().into_owned()
}

#[test]
fn no_member_includes_a_file_of_another() {
    let mut problems = Vec::new();
    for file in files(|path| path.ends_with(".rs")) {
        let own = file.path.split('/').next().unwrap_or_default();
        for opening in ["include!(\"", "include_str!(\"", "include_bytes!(\"", "#[path = \""] {
            let paths = file.text.match_indices(opening).map(|(at, _)| &file.text[at + opening.len()..]);
            for path in paths.filter_map(|rest| rest.split('"').next()) {
                let folder = reached(&file.path, path);
                if folder != own && !SHARED.contains(&folder.as_str()) {
                    problems.push(format!("{} includes {path} of {folder}", file.path));
                }
            }
        }
    }
    assert_none("included files", &problems);
}

#[test]
fn a_fence_stops_what_it_should() {
    let page = "| crate | owns | depends on |\n|---|---|---|\n| `a` | x | – |\n| `tests` (`b`) | y | `a`, `c`; in tests: `d` |\n\n";
    let listed = listed(page);
    assert_eq!(listed["a"], Dependencies::default());
    let set = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<BTreeSet<_>>();
    assert_eq!(listed["b"], Dependencies { normal: set(&["a", "c"]), dev: set(&["d"]) });

    let tree = ["parry3d v0.31.1", "arrow-array v60.1.0", "arrowhead v1.0.0", "tokio-util v0.7.20"].map(str::to_owned);
    assert_eq!(of_families(&tree, &[PHYSICS, COLUMNS]), [&tree[0], &tree[1]]);
    assert_eq!(of_families(&tree, &[NETWORK]), [&tree[3]]);

    for code in ["use burn::tensor;", "use ::burn::tensor;", "x(burn::y());", "pub use burn;", "use burn as b;"] {
        assert!(names_crate(code, "burn"), "{code}");
    }
    for code in ["// burn::tensor", "use auburn::x;", "use crate::burn::x;", "let burn = 1;", "use burn_ml::x;"] {
        assert!(!names_crate(code, "burn"), "{code}");
    }
    assert!(names_crate("use ply_rs_bw::x;", "ply-rs-bw"));

    assert_eq!(reached("planner/src/serve/tests.rs", "../../../report/fonts/x.ttf"), "report");
    assert_eq!(reached("report/src/assets.rs", "../fonts/x.ttf"), "report");
    assert_eq!(reached("planner/src/config.rs", "../../configs/plan/paper.toml"), "configs");
}
