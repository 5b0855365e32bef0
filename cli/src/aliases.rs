//! Names of earlier versions: `generator --shards 64` is `graspmill generate --shards 64`.

use std::ffi::OsString;
use std::path::Path;

/// A program of an earlier version, its commands by their words today, and what comes before all other words.
struct Alias {
    program: &'static str,
    commands: &'static [(&'static str, &'static [&'static str])],
    otherwise: &'static [&'static str],
}

const ALIASES: [Alias; 5] = [
    Alias {
        program: "generator",
        commands: &[
            ("annotate", &["objects", "annotate"]),
            ("finalize", &["dataset", "finalize"]),
            ("gc", &["dataset", "gc"]),
            ("import-objects", &["objects", "import"]),
            ("manual", &["manual"]),
            ("missing", &["dataset", "missing"]),
            ("repeat", &["dataset", "repeat"]),
            ("replay", &["dataset", "replay"]),
        ],
        otherwise: &["generate"],
    },
    Alias { program: "shards", commands: &[("manual", &["manual"])], otherwise: &["dataset"] },
    Alias {
        program: "trainer",
        commands: &[("export", &["weights", "export"]), ("import", &["weights", "import"]), ("recipe", &["pipeline"])],
        otherwise: &[],
    },
    Alias { program: "planner", commands: &[], otherwise: &[] },
    Alias { program: "experiments", commands: &[("manual", &["manual"])], otherwise: &["experiment"] },
];

/// The words of a command line, beginning with `graspmill`. The name of an earlier program is that of this process, or
/// the first word after it.
pub(crate) fn expanded(words: Vec<OsString>) -> Vec<OsString> {
    let is = |word: &OsString, alias: &Alias| Path::new(word).file_stem().is_some_and(|stem| stem == alias.program);
    let of = |word: Option<&OsString>| ALIASES.iter().find(|alias| word.is_some_and(|word| is(word, alias)));
    let (alias, rest) = match (of(words.first()), of(words.get(1))) {
        (Some(alias), _) => (Some(alias), words.into_iter().skip(1)),
        (None, alias) => (alias, words.into_iter().skip(1 + usize::from(alias.is_some()))),
    };
    let mut rest = rest.peekable();
    let mut expanded = vec!["graspmill"];
    if let Some(Alias { commands, otherwise, .. }) = alias {
        // `--version` is everywhere that of the program.
        let first = rest.peek().and_then(|word| word.to_str());
        let is_version = matches!(first, Some("--version" | "-V"));
        match commands.iter().find(|(name, _)| first == Some(name)) {
            Some((_, now)) => {
                expanded.extend(*now);
                rest.next();
            }
            None if is_version => {}
            None => expanded.extend(*otherwise),
        }
    }
    expanded.into_iter().map(OsString::from).chain(rest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_earlier_versions_are_commands_of_this_one() {
        for (given, expected) in [
            ("/bin/graspmill generate --shards 4", "graspmill generate --shards 4"),
            ("target/release/generator --shards 4", "graspmill generate --shards 4"),
            ("generator", "graspmill generate"),
            ("generator.exe gc data", "graspmill dataset gc data"),
            ("generator --version", "graspmill --version"),
            ("graspmill generator import-objects meshes", "graspmill objects import meshes"),
            ("shards verify generator", "graspmill dataset verify generator"),
            ("trainer fit --data shards", "graspmill fit --data shards"),
            ("trainer recipe wsg_50 --out x", "graspmill pipeline wsg_50 --out x"),
            ("planner plan --demo", "graspmill plan --demo"),
            ("planner --help", "graspmill --help"),
            ("experiments run a.toml", "graspmill experiment run a.toml"),
            ("experiments --help", "graspmill experiment --help"),
            ("graspmill", "graspmill"),
        ] {
            let words = expanded(given.split(' ').map(OsString::from).collect());
            assert_eq!(words.join(std::ffi::OsStr::new(" ")), *expected, "{given}");
        }
    }
}
