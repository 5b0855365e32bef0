//! The training recipe as a file. `RawConfig` is what TOML holds; [`Config`] is what the rest of the crate sees. All
//! problems are reported at once, each with its key.
//!
//! What goes beyond the paper (`[augmentation]`, `training.schedule`, `training.positive_weight`,
//! `training.patience_epochs`) may be left out and then is off: recipes and checkpoints from before these keys stay good.

mod raw;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::augmentation::Augmentation;
use crate::schedule::Schedule;
use network::upsampling::Upsampling;

pub use raw::RawConfig;

/// The paper's recipe, which is there without a file.
pub const PAPER: &str = include_str!("../../configs/train/paper.toml");

/// A checked recipe.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// Seed of the split, the order of samples and the initial weights.
    pub seed: u64,
    /// How the decoder doubles its grids.
    pub upsampling: Upsampling,
    /// Passes over the training samples.
    pub epochs: u32,
    /// Samples a step.
    pub batch: usize,
    /// Adam's step size; the first step's where the schedule changes it.
    pub learning_rate: f64,
    /// How the step size changes.
    pub schedule: Schedule,
    /// How much more a held attempt's quality loss counts than a failed one's; 1 is the paper's.
    pub positive_weight: f64,
    /// Epochs without a better test accuracy after which training ends; 0 for never.
    pub patience_epochs: u32,
    /// Samples of one scene that stay together in the order of an epoch: 1 is a plain shuffle; more share the encoder's
    /// work and make batches less mixed.
    pub samples_per_scene: usize,
    /// How training scenes are turned and shifted.
    pub augmentation: Augmentation,
    /// Which samples test.
    pub split: SplitConfig,
    /// Steps between checkpoints within an epoch; 0 for one at the end of each epoch only.
    pub checkpoint_every_steps: u32,
}

/// Which samples are held out, and how. Both kinds always are, so that one training run yields both accuracies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SplitConfig {
    /// The test set whose accuracy is *the* accuracy, and chooses the best checkpoint.
    pub by: SplitBy,
    /// Share of all samples in that test set.
    pub test_share: f64,
    /// Share of all samples in the other one.
    pub other_share: f64,
}

/// A way to hold out samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SplitBy {
    /// Single attempts, as the paper does: the network has seen the same grid with other attempts.
    Attempt,
    /// Whole scenes: nothing leaks.
    Scene,
}

/// Why a recipe is refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("failed to read the configuration: {source}: {}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not TOML.
    #[error("not TOML: {message}: {}", .path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What the parser said.
        message: String,
    },
    /// Keys that are unknown, missing or out of range, all of them.
    #[error("{} problem{} in the configuration {}:\n  {}", .problems.len(), if .problems.len() == 1 { "" } else { "s" }, .path.display(), .problems.join("\n  "))]
    Invalid {
        /// The file.
        path: PathBuf,
        /// One message a problem, beginning with the key's path.
        problems: Vec<String>,
    },
}

impl Config {
    /// Reads a recipe.
    ///
    /// # Errors
    /// [`ConfigError`]; [`ConfigError::Invalid`] names every unknown, missing and out-of-range key.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    /// The recipe of a file, or the paper's.
    ///
    /// # Errors
    /// As [`Config::read`].
    pub fn load(path: Option<&Path>) -> Result<Self, ConfigError> {
        path.map_or_else(|| Self::parse(PAPER, Path::new("configs/train/paper.toml")), Self::read)
    }

    /// Checks the text of a recipe; `path` is for messages.
    ///
    /// # Errors
    /// As [`Config::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        let table: toml::Table = text
            .parse()
            .map_err(|e: toml::de::Error| ConfigError::Syntax { path: path.to_owned(), message: e.to_string() })?;
        raw::check(&table).map_err(|problems| ConfigError::Invalid { path: path.to_owned(), problems })
    }

    /// The recipe as TOML, every key written out.
    #[must_use]
    pub fn to_toml(&self) -> String {
        // RawConfig holds numbers and two words; such a value always has a TOML form.
        toml::to_string(&RawConfig::from(self)).unwrap_or_default()
    }
}
