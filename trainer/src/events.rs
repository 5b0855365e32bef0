//! What happens while the network trains, for whoever watches.

use serde::Serialize;
use shards::Dataset;

use crate::config::SplitBy;
use crate::data::GraspDataset;
use crate::metrics::Summary;
use crate::progress::Progress;
use crate::split::Split;

/// Something that happened.
#[derive(Debug)]
pub enum Event<'a> {
    /// The dataset is open; its grids are about to be decoded.
    Loading(&'a Dataset),
    /// A scene is decoded. Comes from any thread.
    SceneLoaded,
    /// Training begins, or goes on.
    Begun(&'a Beginning),
    /// A batch is done.
    Step {
        /// Number of the step in the run, from 1.
        step: u64,
        /// Samples in it.
        samples: usize,
        /// Its mean loss, Eq. 5.
        loss: f64,
    },
    /// An epoch is done.
    Epoch(&'a EpochReport),
    /// Training ends early: none of the last so many epochs was better than the best before.
    NoBetter(u32),
}

/// Labels of a set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LabelCount {
    /// Samples.
    pub samples: usize,
    /// Successes among them.
    pub held: usize,
}

impl LabelCount {
    /// Of some samples of a dataset.
    #[must_use]
    pub fn of(samples: &GraspDataset, set: &[usize]) -> Self {
        Self { samples: set.len(), held: set.iter().filter(|at| samples.label(**at) == 1).count() }
    }

    /// The accuracy of always answering "failure"; 1 without samples.
    #[must_use]
    pub fn baseline_accuracy(&self) -> f64 {
        1.0 - self.held as f64 / self.samples.max(1) as f64
    }
}

/// What is known when training begins.
#[derive(Debug, Clone)]
pub struct Beginning {
    /// Attempts that are no samples, for their grasp lies outside the grid.
    pub outside: u64,
    /// Labels of the samples that train.
    pub train: LabelCount,
    /// Labels of held-out attempts.
    pub test_attempts: LabelCount,
    /// Labels in held-out scenes.
    pub test_scenes: LabelCount,
    /// Where training goes on; zero for a new run.
    pub progress: Progress,
}

impl Beginning {
    pub(crate) fn of(samples: &GraspDataset, split: &Split, progress: &Progress) -> Self {
        Self {
            outside: samples.outside_count(),
            train: LabelCount::of(samples, &split.train),
            test_attempts: LabelCount::of(samples, &split.test_attempts),
            test_scenes: LabelCount::of(samples, &split.test_scenes),
            progress: *progress,
        }
    }
}

/// An epoch in numbers; a line of `metrics.jsonl`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EpochReport {
    /// Number of the epoch, from 1.
    pub epoch: u32,
    /// Steps done in all.
    pub step: u64,
    /// Adam's step size at the epoch's last step.
    pub learning_rate: f64,
    /// Over the training samples, as they were visited: turned, shifted and weighted as the recipe says.
    pub train: Summary,
    /// Over held-out attempts of known scenes, after the epoch.
    pub test_attempts: Summary,
    /// Over held-out scenes, after the epoch.
    pub test_scenes: Summary,
    /// Which of the two chooses the best checkpoint.
    pub split_by: SplitBy,
    /// Whether this epoch's weights are the best so far.
    pub is_best: bool,
    /// Seconds since this process began the epoch.
    pub seconds: f64,
}

impl EpochReport {
    /// The summary of the test set that counts.
    #[must_use]
    pub fn test(&self) -> &Summary {
        match self.split_by {
            SplitBy::Attempt => &self.test_attempts,
            SplitBy::Scene => &self.test_scenes,
        }
    }
}
