//! Metrics over the samples of an epoch: losses, and the confusion matrix with accuracy (Eq. 6), precision and recall.
//! A success is predicted if the quality is above ½.

use serde::{Deserialize, Serialize};

use crate::loss::SampleResult;

/// True and false positives and negatives.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Confusion {
    /// Held, and predicted so.
    pub true_positive: u64,
    /// Failed, but predicted to hold.
    pub false_positive: u64,
    /// Failed, and predicted so.
    pub true_negative: u64,
    /// Held, but predicted to fail.
    pub false_negative: u64,
}

impl Confusion {
    /// Counts a sample.
    pub fn add(&mut self, label: u8, predicted: bool) {
        *match (label == 1, predicted) {
            (true, true) => &mut self.true_positive,
            (false, true) => &mut self.false_positive,
            (false, false) => &mut self.true_negative,
            (true, false) => &mut self.false_negative,
        } += 1;
    }

    /// Samples.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.true_positive + self.false_positive + self.true_negative + self.false_negative
    }

    /// Eq. 6: the share of right predictions; `None` without samples.
    #[must_use]
    pub fn accuracy(&self) -> Option<f64> {
        ratio(self.true_positive + self.true_negative, self.count())
    }

    /// The share of predicted successes that held; `None` if none was predicted.
    #[must_use]
    pub fn precision(&self) -> Option<f64> {
        ratio(self.true_positive, self.true_positive + self.false_positive)
    }

    /// The share of held grasps that were predicted; `None` if none held.
    #[must_use]
    pub fn recall(&self) -> Option<f64> {
        ratio(self.true_positive, self.true_positive + self.false_negative)
    }

    /// The accuracy of always answering "failure"; `None` without samples.
    #[must_use]
    pub fn baseline(&self) -> Option<f64> {
        ratio(self.true_negative + self.false_positive, self.count())
    }

    /// Wilson's 95 % interval of the accuracy; (0, 1) without samples.
    #[must_use]
    pub fn interval(&self) -> (f64, f64) {
        let Some(p) = self.accuracy() else { return (0.0, 1.0) };
        let (n, z) = (self.count() as f64, 1.959_964);
        let centre = p + z * z / (2.0 * n);
        let reach = z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
        let scale = 1.0 + z * z / n;
        (((centre - reach) / scale).max(0.0), ((centre + reach) / scale).min(1.0))
    }
}

fn ratio(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

/// Running sums over samples, in order.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Tally {
    /// Predictions against labels.
    pub confusion: Confusion,
    /// Sums of the total, quality, rotation and width losses.
    pub sums: [f64; 4],
}

impl Tally {
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

#[cfg(test)]
mod tests {
    use super::*;

    const SOME: Confusion = Confusion { true_positive: 30, false_positive: 10, true_negative: 50, false_negative: 10 };

    #[test]
    fn ratios_are_those_of_the_textbook() {
        assert_eq!(SOME.accuracy(), Some(0.8));
        assert_eq!(SOME.precision(), Some(0.75));
        assert_eq!(SOME.recall(), Some(0.75));
        assert_eq!(SOME.baseline(), Some(0.6));
        assert_eq!(Confusion::default().accuracy(), None);
    }

    #[test]
    fn wilsons_interval_is_that_of_the_tables() {
        let (low, high) = SOME.interval();
        assert!((low - 0.7112).abs() < 1e-3 && (high - 0.8667).abs() < 1e-3, "{low} {high}");
    }
}
