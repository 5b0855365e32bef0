//! What the fuzz target `trainer_config` calls, and a test that replays its seeds and past findings. Whatever the bytes
//! are, this returns, and a recipe that is accepted comes back from its own text.

use std::path::Path;

use crate::config::Config;

/// The text of a recipe.
///
/// # Errors
/// What is wrong with the text.
///
/// # Panics
/// If an accepted recipe is not read as it is written.
pub fn config(data: &[u8]) -> Result<(), String> {
    let parse = |text: &str| Config::parse(text, Path::new("fuzzed")).map_err(|e| e.to_string());
    let config = parse(&String::from_utf8_lossy(data))?;
    assert_eq!(parse(&config.to_toml()), Ok(config), "an accepted recipe comes back");
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// Seeds named `whole-…` are accepted.
    #[test]
    fn seeds_and_past_findings_of_the_recipe_are_survived() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds/trainer_config");
        let mut names: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        for name in names {
            let result = config(&fs::read(folder.join(&name)).unwrap());
            let name = name.to_string_lossy();
            assert_eq!(result.is_ok(), name.starts_with("whole-"), "{name}: {result:?}");
        }
    }
}
