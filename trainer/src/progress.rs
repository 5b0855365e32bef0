//! The progress of a run. With weights and moments it determines the next step.

use network::checkpoint;

use crate::metrics::{Confusion, Tally};

/// The progress of training. (seed, epoch, batch) restores the sampler, because an epoch's order is a pure function of
/// seed and epoch.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Progress {
    /// Epochs done.
    pub epoch: u32,
    /// Batches done in the current epoch.
    pub batch: u32,
    /// Total number of steps.
    pub step: u64,
    /// Metrics of the current epoch.
    pub tally: Tally,
    /// Best accuracy of the test set so far.
    pub best_accuracy: Option<f64>,
}

impl From<&Progress> for checkpoint::Progress {
    fn from(progress: &Progress) -> Self {
        let Confusion { true_positive, false_positive, true_negative, false_negative } = progress.tally.confusion;
        Self {
            epoch: progress.epoch,
            batch: progress.batch,
            step: progress.step,
            confusion: checkpoint::Confusion { true_positive, false_positive, true_negative, false_negative },
            sums_bits: progress.tally.sums.map(f64::to_bits),
            best_accuracy_bits: progress.best_accuracy.map(f64::to_bits),
        }
    }
}

impl From<checkpoint::Progress> for Progress {
    fn from(stored: checkpoint::Progress) -> Self {
        let checkpoint::Confusion { true_positive, false_positive, true_negative, false_negative } = stored.confusion;
        let confusion = Confusion { true_positive, false_positive, true_negative, false_negative };
        Self {
            epoch: stored.epoch,
            batch: stored.batch,
            step: stored.step,
            tally: Tally { confusion, sums: stored.sums_bits.map(f64::from_bits) },
            best_accuracy: stored.best_accuracy_bits.map(f64::from_bits),
        }
    }
}
