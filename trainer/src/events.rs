//! Events of a training run, for observers.

use network::checkpoint::Progress;
use serde::Serialize;
use shards::Dataset;

use crate::config::SplitBy;
use crate::metrics::Summary;
use crate::split::Labels;

/// An event.
#[derive(Debug)]
pub enum Event<'a> {
    /// The datasets are open and about to be read.
    Loading(&'a [Dataset]),
    /// A scene is read: its attempts, or its grid where all are kept. Sent from any thread.
    SceneLoaded,
    /// Training begins or resumes.
    Begun(&'a Beginning),
    /// A batch is done.
    Step {
        /// Samples in it.
        samples: usize,
        /// Its mean loss, Eq. 5.
        loss: f64,
    },
    /// An epoch is done.
    Epoch(&'a EpochReport),
}

/// The state when training begins.
#[derive(Debug, Clone)]
pub struct Beginning {
    /// Attempts without a sample, because their grasp is outside the grid.
    pub outside: u64,
    /// Labels of the sets.
    pub labels: Labels,
    /// The progress at which training resumes; zero for a new run.
    pub progress: Progress,
}

/// The metrics of an epoch; a line of `metrics.jsonl`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EpochReport {
    /// Number of the epoch, from 1.
    pub epoch: u32,
    /// Total number of steps.
    pub step: u64,
    /// Adam's step size at the epoch's last step.
    pub learning_rate: f64,
    /// Over the training samples as they were visited: rotated, shifted and weighted by the recipe.
    pub train: Summary,
    /// Over held-out attempts of known scenes, after the epoch.
    pub test_attempts: Summary,
    /// Over held-out scenes, after the epoch.
    pub test_scenes: Summary,
    /// The set that selects the best checkpoint.
    pub split_by: SplitBy,
    /// Whether this epoch's weights are the best so far.
    pub is_best: bool,
    /// Seconds since this process began the epoch.
    pub seconds: f64,
}

impl EpochReport {
    /// The summary of the selecting test set.
    #[must_use]
    pub fn test(&self) -> &Summary {
        match self.split_by {
            SplitBy::Attempt => &self.test_attempts,
            SplitBy::Scene => &self.test_scenes,
        }
    }
}
