//! Files of a crate that need each other in a circle can only be read together. There are few, and each is listed here
//! and explained in ARCHITECTURE.md.

use std::collections::{BTreeMap, BTreeSet};

use workspace_tests::{assert_none, files, member_folders};

/// Circles that may be: the crate's folder and its modules, sorted.
const ALLOWED: &[(&str, &[&str])] = &[("simulator", &["attempt", "shortcuts", "watch"])];

/// The modules that each module of a crate names.
type Uses = BTreeMap<String, BTreeSet<String>>;

/// The module in a file below `src`; the crate's root is empty.
fn module(path: &str) -> String {
    let path = path.strip_suffix(".rs").unwrap_or(path);
    if ["lib", "main"].contains(&path) { String::new() } else { path.replace('/', "::") }
}

/// Every path in a `use` tree: `a::{b, c::{self, d}}` is `a::b`, `a::c::self`, `a::c::d`.
fn leaves(prefix: &str, tree: &str, found: &mut Vec<String>) {
    let (mut depth, mut start) = (0, 0);
    let mut parts = Vec::new();
    for (at, letter) in tree.char_indices() {
        match letter {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(&tree[start..at]);
                start = at + 1;
            }
            _ => {}
        }
    }
    parts.push(&tree[start..]);
    for part in parts.into_iter().map(str::trim).filter(|part| !part.is_empty()) {
        match part.split_once('{') {
            Some((head, rest)) => leaves(&format!("{prefix}{head}"), rest.trim_end().trim_end_matches('}'), found),
            None => found.push(format!("{prefix}{}", part.split(" as ").next().unwrap_or(part))),
        }
    }
}

/// Paths to other modules of the crate, as a file's code outside of its unit tests writes them.
fn paths(text: &str) -> Vec<String> {
    let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or(text);
    let code: Vec<&str> = code.lines().map(|line| line.split("//").next().unwrap_or(line)).collect();
    let code = code.join("\n");
    let mut found = Vec::new();
    for opening in ["crate::", "super::", "self::"] {
        for (at, _) in code.match_indices(opening) {
            let before = &code[..at];
            let is_path = !before.ends_with(|c: char| c.is_alphanumeric() || "_:$".contains(c));
            let rest = &code[at..];
            if is_path && before.trim_end_matches(' ').ends_with("use") {
                leaves("", rest.split(';').next().unwrap_or(rest), &mut found);
            } else if is_path {
                let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_' && c != ':').unwrap_or(rest.len());
                found.push(rest[..end].to_owned());
            }
        }
    }
    found
}

/// The module, among `modules`, in which a path of module `from` ends.
fn target(from: &str, path: &str, modules: &BTreeSet<String>) -> String {
    let mut at: Vec<&str> = from.split("::").filter(|name| !name.is_empty()).collect();
    for (place, part) in path.split("::").enumerate() {
        match part {
            "crate" => at.clear(),
            "super" => drop(at.pop()),
            "self" if place == 0 => {}
            part => at.push(part),
        }
    }
    while !modules.contains(&at.join("::")) {
        at.pop();
    }
    at.join("::")
}

/// The modules of a crate, given as (path below `src`, text), and what each names. Roots only re-export, so paths that
/// end there are left out.
fn uses(sources: &[(&str, &str)]) -> Uses {
    let modules: BTreeSet<String> = sources.iter().map(|(path, _)| module(path)).chain([String::new()]).collect();
    let named = |from: &str, text: &str| {
        let targets = paths(text).into_iter().map(|path| target(from, &path, &modules));
        targets.filter(|to| !to.is_empty() && to != from).collect()
    };
    let inner = sources.iter().map(|(path, text)| (module(path), *text)).filter(|(name, _)| !name.is_empty());
    inner.map(|(name, text)| (name.clone(), named(&name, text))).collect()
}

/// All modules that one leads to.
fn reach<'a>(uses: &'a Uses, from: &str) -> BTreeSet<&'a str> {
    let mut seen = BTreeSet::new();
    let mut next: Vec<&str> = uses[from].iter().map(String::as_str).collect();
    while let Some(name) = next.pop() {
        if seen.insert(name) {
            next.extend(uses[name].iter().map(String::as_str));
        }
    }
    seen
}

/// The groups of modules in which each leads to each.
fn circles(uses: &Uses) -> BTreeSet<Vec<&str>> {
    let reached: BTreeMap<&str, BTreeSet<&str>> = uses.keys().map(|name| (name.as_str(), reach(uses, name))).collect();
    let in_circles = reached.iter().filter(|(name, to)| to.contains(*name));
    in_circles.map(|(name, to)| to.iter().copied().filter(|other| reached[other].contains(name)).collect()).collect()
}

#[test]
fn files_need_each_other_in_a_circle_only_where_the_architecture_page_says_why() {
    let mut problems = Vec::new();
    for folder in member_folders() {
        let src = format!("{folder}/src/");
        let files = files(|path| path.starts_with(&src) && path.ends_with(".rs"));
        let sources: Vec<_> = files.iter().map(|file| (&file.path[src.len()..], file.text.as_str())).collect();
        let uses = uses(&sources);
        let found = circles(&uses);
        let allowed = ALLOWED.iter().filter(|(of, _)| *of == folder).map(|(_, names)| names.to_vec()).collect();
        problems.extend(found.difference(&allowed).map(|names| format!("{folder}: {names:?} need each other")));
        problems.extend(allowed.difference(&found).map(|names| format!("{folder}: {names:?} need no row any more")));
    }
    assert_none("circles", &problems);
}

#[test]
fn a_circle_is_found_through_other_files_and_use_trees() {
    let sources = [
        ("lib.rs", "mod a;\npub use a::A;"),
        ("a.rs", "use crate::{c, b::{self, B as Other}};"),
        ("b.rs", "// crate::a\nfn f() { super::d::inner::g(); }\n#[cfg(test)]\nmod tests { use crate::c; }"),
        ("c.rs", "use crate::A;"),
        ("d.rs", "mod inner;"),
        ("d/inner.rs", "use crate::a::A;"),
    ];
    let uses = uses(&sources);
    assert_eq!(uses["a"].iter().collect::<Vec<_>>(), ["b", "c"]);
    assert_eq!(circles(&uses).into_iter().collect::<Vec<_>>(), [["a", "b", "d::inner"]]);
}
