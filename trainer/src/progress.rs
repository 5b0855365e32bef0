//! How far a run has come: all that decides the next step, besides weights and moments.

use serde::{Deserialize, Serialize};

use crate::metrics::{Confusion, Tally};

/// Where training stands. With (seed, epoch, batch) the sampler is where it was, for an epoch's order is a pure function
/// of seed and epoch.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Progress {
    /// Epochs done.
    pub epoch: u32,
    /// Batches done in the epoch that is running.
    pub batch: u32,
    /// Steps done in all.
    pub step: u64,
    /// Counts over the samples of the epoch that is running.
    pub tally: Tally,
    /// Best accuracy of the test set so far.
    pub best_accuracy: Option<f64>,
}

/// A progress in a checkpoint. Floats are bit patterns: a resumed epoch must add to exactly what it had.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ProgressJson {
    epoch: u32,
    batch: u32,
    step: u64,
    confusion: Confusion,
    sums_bits: [u64; 4],
    best_accuracy_bits: Option<u64>,
}

impl From<&Progress> for ProgressJson {
    fn from(progress: &Progress) -> Self {
        Self {
            epoch: progress.epoch,
            batch: progress.batch,
            step: progress.step,
            confusion: progress.tally.confusion,
            sums_bits: progress.tally.sums.map(f64::to_bits),
            best_accuracy_bits: progress.best_accuracy.map(f64::to_bits),
        }
    }
}

impl From<ProgressJson> for Progress {
    fn from(json: ProgressJson) -> Self {
        Self {
            epoch: json.epoch,
            batch: json.batch,
            step: json.step,
            tally: Tally { confusion: json.confusion, sums: json.sums_bits.map(f64::from_bits) },
            best_accuracy: json.best_accuracy_bits.map(f64::from_bits),
        }
    }
}
