//! The progress of training, and its counts of predictions against labels.

use serde::{Deserialize, Serialize};

/// The progress of training when the checkpoint was written; with weights and moments it determines the next step,
/// because an epoch's order is a pure function of seed and epoch. Floats are stored as bit patterns, because a resumed
/// epoch must continue with exactly the same sums.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Progress {
    /// Epochs done.
    pub epoch: u32,
    /// Batches done in the current epoch.
    pub batch: u32,
    /// Total number of steps.
    pub step: u64,
    /// Predictions against labels in the current epoch.
    pub confusion: Confusion,
    /// Sums of the losses in the current epoch, as bits of `f64`.
    pub sums_bits: [u64; 4],
    /// Best accuracy of the test set so far, as bits of `f64`.
    pub best_accuracy_bits: Option<u64>,
}

/// True and false positives and negatives.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Confusion {
    /// Held, and predicted to hold.
    pub true_positive: u64,
    /// Failed, but predicted to hold.
    pub false_positive: u64,
    /// Failed, and predicted to fail.
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
