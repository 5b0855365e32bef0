//! Names of parts: `generator --shards 64` is `graspmill generate --shards 64`, `trainer fit` is `graspmill fit`.

use std::ffi::{OsStr, OsString};
use std::path::Path;

/// The words of a command line, beginning with `graspmill` instead of the name that the program was called by.
pub(crate) fn expanded(mut words: Vec<OsString>) -> Vec<OsString> {
    let program = words.first().and_then(|word| Path::new(word).file_stem()).and_then(OsStr::to_str);
    let above = match (program, words.get(1).and_then(|word| word.to_str())) {
        (Some("generator"), Some("finalize" | "missing" | "repeat" | "replay")) => Some("dataset"),
        // `--version` is everywhere that of the program.
        (Some("generator"), first) if !matches!(first, Some("--version" | "-V")) => Some("generate"),
        (Some("trainer"), Some("export")) => Some("weights"),
        _ => None,
    };
    words.splice(..words.len().min(1), ["graspmill"].into_iter().chain(above).map(OsString::from));
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_parts_are_commands_of_the_program() {
        for (given, expected) in [
            ("/bin/graspmill generate --shards 4", "graspmill generate --shards 4"),
            ("target/release/generator --shards 4", "graspmill generate --shards 4"),
            ("generator", "graspmill generate"),
            ("generator.exe missing data", "graspmill dataset missing data"),
            ("generator --version", "graspmill --version"),
            ("trainer fit --data shards", "graspmill fit --data shards"),
            ("trainer export a.safetensors", "graspmill weights export a.safetensors"),
            ("trainer --help", "graspmill --help"),
            ("graspmill", "graspmill"),
        ] {
            let words = expanded(given.split(' ').map(OsString::from).collect());
            assert_eq!(words.join(OsStr::new(" ")), *expected, "{given}");
        }
    }
}
