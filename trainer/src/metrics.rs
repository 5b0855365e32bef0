//! Metrics over the samples of an epoch: losses, and the confusion matrix with accuracy (Eq. 6), precision and recall.
//! A success is predicted if the quality is above ½.

use std::collections::BTreeMap;

use network::checkpoint::{Confusion, Progress};
use serde::Serialize;

use crate::results::SampleResult;

/// Running sums over samples, in order.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Tally {
    /// Predictions against labels.
    pub confusion: Confusion,
    /// Sums of the total, quality, rotation and width losses.
    pub sums: [f64; 4],
}

impl Tally {
    /// The sums of the current epoch.
    #[must_use]
    pub fn of(progress: &Progress) -> Self {
        Self { confusion: progress.confusion, sums: progress.sums_bits.map(f64::from_bits) }
    }

    /// Makes these the sums of the current epoch.
    pub fn store(&self, progress: &mut Progress) {
        (progress.confusion, progress.sums_bits) = (self.confusion, self.sums.map(f64::to_bits));
    }

    /// Counts samples.
    pub fn add(&mut self, samples: &[SampleResult]) {
        for sample in samples {
            self.confusion.add(sample.label, sample.quality_logit > 0.0);
            let losses = [sample.total, sample.quality, sample.rotation, sample.width];
            for (sum, loss) in self.sums.iter_mut().zip(losses) {
                *sum += f64::from(loss);
            }
        }
    }

    /// The means and ratios.
    #[must_use]
    pub fn summary(&self) -> Summary {
        let confusion = self.confusion;
        let [loss, loss_quality, loss_rotation, loss_width] =
            self.sums.map(|sum| sum / confusion.count().max(1) as f64);
        Summary {
            samples: confusion.count(),
            loss,
            loss_quality,
            loss_rotation,
            loss_width,
            accuracy: confusion.accuracy(),
            accuracy_95: confusion.interval(),
            precision: confusion.precision(),
            recall: confusion.recall(),
            baseline_accuracy: confusion.baseline(),
            confusion,
        }
    }
}

/// A set's losses and ratios. Losses are means over all samples, so that
/// `loss = loss_quality + loss_rotation + 0.01 · loss_width` (rotation and width are 0 for failures). In training,
/// quality losses have the recipe's weights; in tests all weights are 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Summary {
    /// Samples.
    pub samples: u64,
    /// Eq. 5.
    pub loss: f64,
    /// Eq. 2.
    pub loss_quality: f64,
    /// Eq. 3 and 4.
    pub loss_rotation: f64,
    /// Squared error of the width, in voxels².
    pub loss_width: f64,
    /// Eq. 6.
    pub accuracy: Option<f64>,
    /// Its 95 % interval.
    pub accuracy_95: (f64, f64),
    /// Held among predicted.
    pub precision: Option<f64>,
    /// Predicted among held.
    pub recall: Option<f64>,
    /// Accuracy of always answering "failure".
    pub baseline_accuracy: Option<f64>,
    /// The counts.
    pub confusion: Confusion,
}

/// The summary of each group of results.
pub(crate) fn summaries<'a>(
    results: impl Iterator<Item = (&'static str, &'a SampleResult)>,
) -> BTreeMap<&'static str, Summary> {
    tallies(results).into_iter().map(|(name, tally)| (name, tally.summary())).collect()
}

/// The sums of each group of results.
pub(crate) fn tallies<'a, K: Ord>(results: impl Iterator<Item = (K, &'a SampleResult)>) -> BTreeMap<K, Tally> {
    let mut tallies = BTreeMap::<K, Tally>::new();
    for (key, result) in results {
        tallies.entry(key).or_default().add(std::slice::from_ref(result));
    }
    tallies
}
