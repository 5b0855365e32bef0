//! The recipe as it stands in the file, and its checks.

use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::{Config, SplitBy, SplitConfig};
use crate::augmentation::Augmentation;
use crate::schedule::Schedule;
use network::receptive_field::RESOLUTION;
use network::upsampling::Upsampling;

/// The file's keys.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawConfig {
    seed: u64,
    network: RawNetwork,
    training: RawTraining,
    augmentation: RawAugmentation,
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
    schedule: String,
    positive_weight: f64,
    patience_epochs: u32,
    samples_per_scene: usize,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawAugmentation {
    quarter_turns: bool,
    shift_z_voxels_max: usize,
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
        let Augmentation { quarter_turns, shift_z_voxels_max } = config.augmentation;
        Self {
            seed: config.seed,
            network: RawNetwork { upsampling: config.upsampling.name().to_owned() },
            training: RawTraining {
                epochs: config.epochs,
                batch: config.batch,
                learning_rate: config.learning_rate,
                schedule: config.schedule.name().to_owned(),
                positive_weight: config.positive_weight,
                patience_epochs: config.patience_epochs,
                samples_per_scene: config.samples_per_scene,
            },
            augmentation: RawAugmentation { quarter_turns, shift_z_voxels_max },
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
        let found = self.find(key);
        if found.is_none() {
            self.problems.push(format!("{key} is missing"));
        }
        self.find(key)
    }

    fn find(&self, key: &str) -> Option<&Value> {
        let found = key.split('.').try_fold(None, |at: Option<&Value>, part| {
            let table = at.map_or(Some(self.table), Value::as_table)?;
            table.get(part).map(Some)
        });
        found.flatten()
    }

    /// A key that may be left out: what `read` gives if it is there, else `off`.
    fn optional<T>(&mut self, key: &'static str, off: T, read: impl FnOnce(&mut Self, &'static str) -> T) -> T {
        if self.find(key).is_some() {
            read(self, key)
        } else {
            self.known.push(key);
            off
        }
    }

    /// True or false; false where there is a problem.
    fn flag(&mut self, key: &'static str) -> bool {
        let Some(value) = self.value(key).cloned() else { return false };
        value.as_bool().unwrap_or_else(|| {
            self.problems.push(format!("{key} must be true or false, got {value}"));
            false
        })
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
    let schedules = Schedule::ALL.map(|schedule| (schedule.name(), schedule));
    let config = Config {
        seed: reader.whole("seed", 0, i64::MAX).unsigned_abs(),
        upsampling: reader.word("network.upsampling", &modes),
        epochs: reader.whole("training.epochs", 1, 10_000) as u32,
        batch: reader.whole("training.batch", 1, 4096) as usize,
        learning_rate: reader.number("training.learning_rate", 0.0, 1.0),
        schedule: reader.optional("training.schedule", Schedule::Constant, |reader, key| reader.word(key, &schedules)),
        positive_weight: reader
            .optional("training.positive_weight", 1.0, |reader, key| reader.number(key, 0.0, 1000.0)),
        patience_epochs: reader.optional("training.patience_epochs", 0, |reader, key| reader.whole(key, 0, 10_000))
            as u32,
        samples_per_scene: reader.whole("training.samples_per_scene", 1, 4096) as usize,
        augmentation: Augmentation {
            quarter_turns: reader.optional("augmentation.quarter_turns", false, Reader::flag),
            shift_z_voxels_max: reader.optional("augmentation.shift_z_voxels_max", 0, |reader, key| {
                reader.whole(key, 0, RESOLUTION as i64 - 1)
            }) as usize,
        },
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

    const GOOD: &str = crate::config::PAPER;

    #[test]
    fn the_papers_recipe_is_read_and_comes_back_from_its_own_toml() {
        let config = Config::parse(GOOD, Path::new("paper.toml")).unwrap();
        assert_eq!((config.epochs, config.batch, config.learning_rate), (30, 48, 3e-4));
        assert_eq!(config.split.by, SplitBy::Attempt);
        assert_eq!(Config::parse(&config.to_toml(), Path::new("again")).unwrap(), config);
    }

    /// A recipe, and a checkpoint's, from before the keys that may be left out.
    const OLD: &str = "seed = 1\n\n[network]\nupsampling = \"linear\"\n\n[training]\nepochs = 30\nbatch = 48\n\
                       learning_rate = 0.0003\nsamples_per_scene = 1\n\n[split]\nby = \"attempt\"\ntest_share = 0.1\n\
                       other_share = 0.03\n\n[checkpoint]\nevery_steps = 500\n";

    #[test]
    fn what_goes_beyond_the_paper_may_be_left_out_and_is_off() {
        let config = Config::parse(OLD, Path::new("old.toml")).unwrap();
        assert_eq!(config, Config::parse(GOOD, Path::new("paper.toml")).unwrap());
        assert_eq!(config.augmentation, Augmentation::OFF);
        assert_eq!((config.schedule, config.positive_weight, config.patience_epochs), (Schedule::Constant, 1.0, 0));
    }

    #[test]
    fn what_goes_beyond_the_paper_is_checked_too() {
        let text = OLD.replace(
            "[split]",
            "schedule = \"linear\"\npositive_weight = 0.0\npatience_epochs = -1\n\
                   [augmentation]\nquarter_turns = 1\nshift_z_voxels_max = 40\nflips = true\n[split]",
        );
        let Err(ConfigError::Invalid { problems, .. }) = Config::parse(&text, Path::new("x")) else {
            panic!("must be refused");
        };
        let all = problems.join("\n");
        for problem in [
            "training.schedule must be \"constant\" or \"cosine\", got \"linear\"",
            "training.positive_weight must be a number above 0 and at most 1000",
            "training.patience_epochs must be",
            "augmentation.quarter_turns must be true or false, got 1",
            "augmentation.shift_z_voxels_max must be a whole number between 0 and 39, got 40",
            "augmentation.flips is unknown",
        ] {
            assert!(all.contains(problem), "{problem} is not in\n{all}");
        }
        assert_eq!(problems.len(), 6, "{all}");
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
