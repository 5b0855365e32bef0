//! The recipe as it stands in the file, and its checks.

use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::{Config, SplitBy, SplitConfig};
use crate::upsampling::Upsampling;

/// The file's keys.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawConfig {
    seed: u64,
    network: RawNetwork,
    training: RawTraining,
    split: RawSplit,
    checkpoint: RawCheckpoint,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawNetwork {
    upsampling: String,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawTraining {
    epochs: u32,
    batch: usize,
    learning_rate: f64,
    samples_per_scene: usize,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawSplit {
    by: SplitBy,
    test_share: f64,
    other_share: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawCheckpoint {
    every_steps: u32,
}

impl From<&Config> for RawConfig {
    fn from(config: &Config) -> Self {
        let SplitConfig { by, test_share, other_share } = config.split;
        Self {
            seed: config.seed,
            network: RawNetwork { upsampling: config.upsampling.name().to_owned() },
            training: RawTraining {
                epochs: config.epochs,
                batch: config.batch,
                learning_rate: config.learning_rate,
                samples_per_scene: config.samples_per_scene,
            },
            split: RawSplit { by, test_share, other_share },
            checkpoint: RawCheckpoint { every_steps: config.checkpoint_every_steps },
        }
    }
}

/// Reads values key by key and remembers what was wrong, so that one run tells everything.
struct Reader<'a> {
    table: &'a Table,
    known: Vec<&'static str>,
    problems: Vec<String>,
}

impl Reader<'_> {
    fn value(&mut self, key: &'static str) -> Option<&Value> {
        self.known.push(key);
        let found = key.split('.').try_fold(None, |at: Option<&Value>, part| {
            let table = at.map_or(Some(self.table), Value::as_table)?;
            table.get(part).map(Some)
        });
        if found.flatten().is_none() {
            self.problems.push(format!("{key} is missing"));
        }
        found.flatten()
    }

    /// A whole number between two limits; the lower limit where there is a problem.
    fn whole(&mut self, key: &'static str, low: i64, high: i64) -> i64 {
        let Some(value) = self.value(key).cloned() else { return low };
        match value.as_integer() {
            Some(number) if (low..=high).contains(&number) => number,
            _ => {
                self.problems.push(format!("{key} must be a whole number between {low} and {high}, got {value}"));
                low
            }
        }
    }

    /// A number above `low` and at most `high`.
    fn number(&mut self, key: &'static str, low: f64, high: f64) -> f64 {
        let Some(value) = self.value(key).cloned() else { return high };
        match value.as_float().or_else(|| value.as_integer().map(|n| n as f64)) {
            Some(number) if number > low && number <= high => number,
            _ => {
                self.problems.push(format!("{key} must be a number above {low} and at most {high}, got {value}"));
                high
            }
        }
    }

    /// One of some words.
    fn word<T: Copy>(&mut self, key: &'static str, words: &[(&str, T)]) -> T {
        let value = self.value(key).cloned();
        let found = value.as_ref().and_then(Value::as_str);
        if let (None, Some(value)) = (words.iter().find(|(word, _)| Some(*word) == found), &value) {
            let all: Vec<String> = words.iter().map(|(word, _)| format!("{word:?}")).collect();
            self.problems.push(format!("{key} must be {}, got {value}", all.join(" or ")));
        }
        words.iter().find(|(word, _)| Some(*word) == found).map_or(words[0].1, |(_, meaning)| *meaning)
    }

    fn report_unknown(&mut self, table: &Table, prefix: &str) {
        for (key, value) in table {
            let path = format!("{prefix}{key}");
            let inner = format!("{path}.");
            match value {
                Value::Table(table) if self.known.iter().any(|known| known.starts_with(&inner)) => {
                    self.report_unknown(table, &inner);
                }
                _ if self.known.contains(&path.as_str()) => {}
                _ => self.problems.push(format!("{path} is unknown")),
            }
        }
    }
}

/// The config in a table, or all that is wrong with it.
pub(super) fn check(table: &Table) -> Result<Config, Vec<String>> {
    let mut reader = Reader { table, known: Vec::new(), problems: Vec::new() };
    let modes = Upsampling::ALL.map(|mode| (mode.name(), mode));
    let config = Config {
        seed: reader.whole("seed", 0, i64::MAX).unsigned_abs(),
        upsampling: reader.word("network.upsampling", &modes),
        epochs: reader.whole("training.epochs", 1, 10_000) as u32,
        batch: reader.whole("training.batch", 1, 4096) as usize,
        learning_rate: reader.number("training.learning_rate", 0.0, 1.0),
        samples_per_scene: reader.whole("training.samples_per_scene", 1, 4096) as usize,
        split: SplitConfig {
            by: reader.word("split.by", &[("attempt", SplitBy::Attempt), ("scene", SplitBy::Scene)]),
            test_share: reader.number("split.test_share", 0.0, 0.45),
            other_share: reader.number("split.other_share", 0.0, 0.45),
        },
        checkpoint_every_steps: reader.whole("checkpoint.every_steps", 0, 1_000_000) as u32,
    };
    reader.report_unknown(table, "");
    if reader.problems.is_empty() { Ok(config) } else { Err(reader.problems) }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::config::ConfigError;

    const GOOD: &str = include_str!("../../../configs/train/paper.toml");

    #[test]
    fn the_papers_recipe_is_read_and_comes_back_from_its_own_toml() {
        let config = Config::parse(GOOD, Path::new("paper.toml")).unwrap();
        assert_eq!((config.epochs, config.batch, config.learning_rate), (30, 48, 3e-4));
        assert_eq!(config.split.by, SplitBy::Attempt);
        assert_eq!(Config::parse(&config.to_toml(), Path::new("again")).unwrap(), config);
    }

    #[test]
    fn every_problem_is_told_at_once_with_its_key() {
        let text = "seed = -1\nspeed = 3\n[network]\nupsampling = \"cubic\"\n[training]\nepochs = 0\nbatch = \"many\"\n\
                    learning_rate = 0.0\n[training.deep]\nx = 1\n[split]\nby = \"day\"\ntest_share = 0.9\nother_share = 0.1\n\
                    [checkpoint]\nevery_steps = 10\n";
        let Err(ConfigError::Invalid { problems, .. }) = Config::parse(text, Path::new("x")) else {
            panic!("must be refused");
        };
        let all = problems.join("\n");
        for key in [
            "seed must be",
            "speed is unknown",
            "network.upsampling must be \"linear\" or \"nearest\", got \"cubic\"",
            "training.epochs must be a whole number between 1 and 10000, got 0",
            "training.batch must be",
            "training.learning_rate must be",
            "training.samples_per_scene is missing",
            "training.deep is unknown",
            "split.by must be",
            "split.test_share must be",
        ] {
            assert!(all.contains(key), "{key} is not in\n{all}");
        }
        assert_eq!(problems.len(), 10, "{all}");
    }

    #[test]
    fn what_is_not_toml_is_said_to_be_none() {
        assert!(matches!(Config::parse("seed = = 1", Path::new("x")), Err(ConfigError::Syntax { .. })));
    }
}
