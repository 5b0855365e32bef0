//! `deny.toml`'s law on licences and sources, held against all that is built here: for users, for tests, for build
//! scripts.

use std::collections::BTreeSet;

use workspace_tests::{assert_none, cargo_tree, read, read_toml};

/// Whether an SPDX expression can be satisfied with the allowed licences. `/` is the old way to write OR; AND binds
/// stronger than OR; `X WITH Y` is one licence.
fn satisfied(expression: &str, allowed: &BTreeSet<String>) -> Result<bool, String> {
    let spaced = expression.replace('(', " ( ").replace(')', " ) ").replace('/', " OR ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let mut rest = words.as_slice();
    let answer = any_of(&mut rest, allowed)?;
    if rest.is_empty() { Ok(answer) } else { Err(format!("cannot read `{expression}` from {rest:?} on")) }
}

fn any_of(words: &mut &[&str], allowed: &BTreeSet<String>) -> Result<bool, String> {
    let mut answer = all_of(words, allowed)?;
    while let ["OR", rest @ ..] = words {
        *words = rest;
        answer |= all_of(words, allowed)?;
    }
    Ok(answer)
}

fn all_of(words: &mut &[&str], allowed: &BTreeSet<String>) -> Result<bool, String> {
    let mut answer = one(words, allowed)?;
    while let ["AND", rest @ ..] = words {
        *words = rest;
        answer &= one(words, allowed)?;
    }
    Ok(answer)
}

fn one(words: &mut &[&str], allowed: &BTreeSet<String>) -> Result<bool, String> {
    match *words {
        ["(", rest @ ..] => {
            *words = rest;
            let answer = any_of(words, allowed)?;
            let [")", rest @ ..] = words else { return Err("a bracket is not closed".to_owned()) };
            *words = rest;
            Ok(answer)
        }
        [licence, "WITH", exception, rest @ ..] => {
            *words = rest;
            Ok(allowed.contains(&format!("{licence} WITH {exception}")))
        }
        [licence, rest @ ..] if !["AND", "OR", ")", "WITH"].contains(licence) => {
            *words = rest;
            Ok(allowed.contains(*licence))
        }
        _ => Err(format!("expected a licence at {words:?}")),
    }
}

#[test]
fn every_dependency_has_an_allowed_licence() {
    let law = read_toml("deny.toml");
    let allow = law["licenses"]["allow"].as_array().unwrap();
    let allowed: BTreeSet<String> = allow.iter().map(|licence| licence.as_str().unwrap().to_owned()).collect();
    let packages = cargo_tree(&["--workspace", "-e", "normal,build,dev", "--format", "{p} | {l}"]);
    let problems: Vec<String> = packages
        .iter()
        .filter(|line| !line.is_empty())
        .filter_map(|line| {
            let (package, licence) = line.split_once(" | ").unwrap_or((line, ""));
            match satisfied(licence, &allowed) {
                Ok(true) => None,
                Ok(false) => Some(format!("{package} has licence {licence}, which deny.toml does not allow")),
                Err(reason) => Some(format!("{package}: {reason}")),
            }
        })
        .collect();
    assert!(packages.len() > 100, "only {} packages seen", packages.len());
    assert_none("licences", &problems);
}

#[test]
fn everything_comes_from_the_one_registry() {
    let law = read_toml("deny.toml");
    let registries: Vec<&str> =
        law["sources"]["allow-registry"].as_array().unwrap().iter().map(|source| source.as_str().unwrap()).collect();
    let lock: toml::Table = read("Cargo.lock").parse().unwrap();
    let strangers = lock["package"].as_array().unwrap().iter().filter_map(|package| {
        let source = package.get("source")?.as_str()?;
        let known = source.strip_prefix("registry+").is_some_and(|registry| registries.contains(&registry));
        (!known).then(|| format!("{} comes from {source}", package["name"]))
    });
    assert_none("sources", &strangers.collect::<Vec<_>>());
}

#[test]
fn expressions_are_read_as_spdx_means_them() {
    let allowed: BTreeSet<String> = ["MIT", "Zlib"].map(str::to_owned).into();
    for (expression, expected) in [
        ("MIT", true),
        ("GPL-3.0", false),
        ("Apache-2.0 OR MIT", true),
        ("Apache-2.0/MIT", true),
        ("Apache-2.0 / MIT", true),
        ("MIT AND GPL-3.0", false),
        ("(MIT OR Apache-2.0) AND Unicode-3.0", false),
        ("(GPL-3.0 OR MIT) AND Zlib", true),
        ("GPL-3.0 OR MIT AND Apache-2.0", false),
        ("MIT WITH LLVM-exception", false),
        ("Apache-2.0 WITH LLVM-exception OR MIT", true),
    ] {
        assert_eq!(satisfied(expression, &allowed), Ok(expected), "{expression}");
    }
    for nonsense in ["", "MIT OR", "(MIT", "MIT Zlib", "AND"] {
        assert!(satisfied(nonsense, &allowed).is_err(), "{nonsense}");
    }
}
