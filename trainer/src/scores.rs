//! Scores of the predicted qualities of a set besides the accuracy at ½: ranking (average precision, ROC), calibration,
//! and confidence intervals for samples that are correlated within a scene.

use network::checkpoint::Confusion;
use schema::statistics::{bootstrap, bootstrap_share};
use serde::Serialize;

use crate::results::SampleResult;

/// A prediction and its label.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// Logit of the predicted quality.
    pub logit: f32,
    /// Whether the attempt held its object.
    pub held: bool,
}

impl Score {
    /// The predicted quality, a probability.
    #[must_use]
    pub fn quality(&self) -> f64 {
        1.0 / (1.0 + libm::exp(-f64::from(self.logit)))
    }
}

/// The score of a result.
pub(crate) fn score(result: &SampleResult) -> Score {
    Score { logit: result.quality_logit, held: result.label == 1 }
}

/// How well qualities rank attempts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Ranking {
    /// Σ (Rₙ − Rₙ₋₁) Pₙ over falling thresholds; `None` if nothing held.
    pub average_precision: Option<f64>,
    /// Area under the ROC curve: the probability that a held grasp scores above a failed one, ties counting half;
    /// `None` unless both exist.
    pub roc_auc: Option<f64>,
}

/// The ranking of scores in any order.
#[must_use]
pub fn ranking(scores: &[Score]) -> Ranking {
    let mut sorted = scores.to_vec();
    sorted.sort_by(|a, b| b.logit.total_cmp(&a.logit));
    let positives = sorted.iter().filter(|score| score.held).count();
    let negatives = sorted.len() - positives;
    let (mut held, mut failed) = (0_usize, 0_usize);
    let (mut precision_sum, mut wins) = (0.0, 0.0);
    for tied in sorted.chunk_by(|a, b| a.logit == b.logit) {
        let held_here = tied.iter().filter(|score| score.held).count();
        let failed_here = tied.len() - held_here;
        wins += failed_here as f64 * (held as f64 + held_here as f64 / 2.0);
        held += held_here;
        failed += failed_here;
        precision_sum += held_here as f64 * (held as f64 / (held + failed) as f64);
    }
    Ranking {
        average_precision: (positives > 0).then(|| precision_sum / positives as f64),
        roc_auc: (positives > 0 && negatives > 0).then(|| wins / (positives as f64 * negatives as f64)),
    }
}

/// How well qualities agree with observed frequencies.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Calibration {
    /// Mean absolute difference of predicted and observed shares over the bins, weighted by samples.
    pub expected_error: f64,
    /// Mean squared difference of quality and label (Brier score).
    pub brier: f64,
    /// [`BINS`] equally wide bins of quality, from 0 to 1.
    pub bins: Vec<Bin>,
}

/// Samples with a quality in a bin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Bin {
    /// The lower end of the bin; the upper end is the lower end of the next bin.
    pub from: f64,
    /// Samples.
    pub samples: u64,
    /// Their mean quality; `None` without samples.
    pub predicted: Option<f64>,
    /// The share that held; `None` without samples.
    pub observed: Option<f64>,
    /// Wilson's 95 % interval of that share; (0, 1) without samples.
    pub observed_95: (f64, f64),
}

/// Number of bins of a calibration.
pub const BINS: usize = 10;

/// The calibration of scores.
#[must_use]
pub fn calibration(scores: &[Score]) -> Calibration {
    let mut sums = [(0_u64, 0_u64, 0.0_f64); BINS];
    let mut squares = 0.0;
    for score in scores {
        let quality = score.quality();
        let (samples, held, sum) = &mut sums[((quality * BINS as f64) as usize).min(BINS - 1)];
        *samples += 1;
        *held += u64::from(score.held);
        *sum += quality;
        squares += (quality - f64::from(u8::from(score.held))).powi(2);
    }
    let whole = scores.len().max(1) as f64;
    let bins = sums.iter().enumerate().map(|(at, (samples, held, sum))| {
        let share = |part: f64| (*samples > 0).then(|| part / *samples as f64);
        // Held and failed take the place of right and wrong: the interval of a share is the same.
        let counts = Confusion { true_positive: *held, false_positive: samples - held, ..Confusion::default() };
        Bin {
            from: at as f64 / BINS as f64,
            samples: *samples,
            predicted: share(*sum),
            observed: share(*held as f64),
            observed_95: counts.interval(),
        }
    });
    Calibration {
        expected_error: sums.iter().map(|(_, held, sum)| (sum - *held as f64).abs()).sum::<f64>() / whole,
        brier: squares / whole,
        bins: bins.collect(),
    }
}

/// Number of bootstrap draws.
const DRAWS: u32 = 1000;

/// The 95 % interval of the accuracy by bootstrap over scenes, because samples of a scene share a grid and are
/// correlated. Scenes are drawn with replacement, as many as there are, 1,000 times. `scenes` has the right predictions
/// and samples of each scene. `None` for fewer than two scenes.
#[must_use]
pub fn interval_by_scene(scenes: &[(u64, u64)]) -> Option<(f64, f64)> {
    (scenes.len() > 1).then(|| bootstrap_share(scenes, DRAWS)).flatten()
}

/// The same of the average precision, of each sample's scene and score. `None` for fewer than two scenes or if nothing
/// held.
#[must_use]
pub fn average_precision_by_scene(samples: &[(u32, Score)]) -> Option<(f64, f64)> {
    let mut numbers: Vec<u32> = samples.iter().map(|(scene, _)| *scene).collect();
    numbers.sort_unstable();
    numbers.dedup();
    if numbers.len() < 2 || !samples.iter().any(|(_, score)| score.held) {
        return None;
    }
    // By falling logit, with the place of the scene.
    let place = |scene: u32| numbers.partition_point(|number| *number < scene);
    let mut sorted: Vec<(usize, Score)> = samples.iter().map(|(scene, score)| (place(*scene), *score)).collect();
    sorted.sort_by(|a, b| b.1.logit.total_cmp(&a.1.logit));
    bootstrap(numbers.len(), DRAWS, |drawn| {
        let mut times = vec![0_u32; numbers.len()];
        drawn.iter().for_each(|scene| times[*scene] += 1);
        let (mut held, mut all, mut sum) = (0.0, 0.0, 0.0);
        for tied in sorted.chunk_by(|a, b| a.1.logit == b.1.logit) {
            let of =
                |held: bool| tied.iter().filter(move |(_, score)| score.held == held).map(|(scene, _)| times[*scene]);
            let held_here = f64::from(of(true).sum::<u32>());
            held += held_here;
            all += held_here + f64::from(of(false).sum::<u32>());
            if all > 0.0 {
                sum += held_here * held / all;
            }
        }
        // Draws in which nothing held say nothing.
        (held > 0.0).then(|| sum / held)
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use schema::statistics::quantile;
    use schema::{Purpose, Stream};

    fn scores(values: &[(f32, bool)]) -> Vec<Score> {
        values.iter().map(|(logit, held)| Score { logit: *logit, held: *held }).collect()
    }

    /// With scores 0.1, 0.4, 0.35, 0.8 and labels 0, 0, 1, 1 scikit-learn 1.9.1 gives 0.8333 and 0.75.
    #[test]
    fn average_precision_and_area_are_scikit_learns() {
        let ranking = ranking(&scores(&[(0.1, false), (0.4, false), (0.35, true), (0.8, true)]));
        assert!((ranking.average_precision.unwrap() - 0.833_333_333).abs() < 1e-9);
        assert_eq!(ranking.roc_auc, Some(0.75));
    }

    #[test]
    fn one_sided_sets_have_no_area() {
        let held = ranking(&scores(&[(0.0, true), (1.0, true)]));
        assert_eq!((held.average_precision, held.roc_auc), (Some(1.0), None));
        let failed = ranking(&scores(&[(0.0, false)]));
        assert_eq!((failed.average_precision, failed.roc_auc), (None, None));
        assert_eq!(ranking(&[]).roc_auc, None);
    }

    #[test]
    fn calibration_is_that_of_the_definition() {
        // Qualities ½ (bin 5), and nearly 1 (the last bin) for an extreme logit.
        let found = calibration(&scores(&[(0.0, true), (0.0, false), (0.0, false), (800.0, true)]));
        assert_eq!(found.bins[5].samples, 3);
        assert_eq!(found.bins[5].predicted, Some(0.5));
        assert!((found.bins[5].observed.unwrap() - 1.0 / 3.0).abs() < 1e-12);
        assert_eq!((found.bins[9].samples, found.bins[9].observed), (1, Some(1.0)));
        assert_eq!((found.bins[0].predicted, found.bins[0].observed_95), (None, (0.0, 1.0)));
        assert!((found.brier - 3.0 * 0.25 / 4.0).abs() < 1e-12);
        assert!((found.expected_error - 0.75 * (0.5 - 1.0 / 3.0)).abs() < 1e-12);
    }

    #[test]
    fn one_scene_has_no_interval() {
        assert!(interval_by_scene(&[(3, 4), (1, 2)]).is_some());
        assert_eq!(interval_by_scene(&[(3, 4)]), None);
    }

    /// Against the ranking of each draw, made by copying the drawn scenes' samples.
    #[test]
    fn the_interval_of_the_average_precision_is_that_of_drawn_scenes() {
        let mut dice = Stream::new(3, 0, Purpose::Bootstrap, 0);
        let mut sample = |scene: u32| {
            let held = dice.unit() < 0.3;
            let logit = (4.0 * dice.unit() + f64::from(u8::from(held))).round() as f32;
            (7 * scene, Score { logit, held })
        };
        let samples: Vec<(u32, Score)> = (0..30).flat_map(|scene| [scene; 6]).map(&mut sample).collect();
        let drawn = |draw: u32| {
            let mut stream = Stream::new(0, 0, Purpose::Bootstrap, draw);
            let scenes: Vec<u32> = (0..30).map(|_| 7 * stream.index(30) as u32).collect();
            let of = |scene: &u32| samples.iter().filter(|(own, _)| own == scene).map(|(_, score)| *score).collect();
            let all: Vec<Vec<Score>> = scenes.iter().map(of).collect();
            ranking(&all.concat()).average_precision.unwrap()
        };
        let mut all: Vec<f64> = (0..DRAWS).map(drawn).collect();
        all.sort_by(f64::total_cmp);
        let [low, high] = [0.025, 0.975].map(|share| quantile(&all, share).unwrap());
        let (found_low, found_high) = average_precision_by_scene(&samples).unwrap();
        assert!((found_low - low).abs() < 1e-12 && (found_high - high).abs() < 1e-12, "{found_low} {found_high}");
        let found = ranking(&samples.iter().map(|(_, score)| *score).collect::<Vec<_>>()).average_precision.unwrap();
        assert!(low < found && found < high && high - low < 0.3, "{low} {found} {high}");
        assert_eq!(average_precision_by_scene(&samples[..6]), None);
    }

    proptest! {
        /// Computed pair by pair and threshold by threshold.
        #[test]
        fn ranking_is_what_counting_finds(values in prop::collection::vec((-3_i8..4, any::<bool>()), 1..60)) {
            let all: Vec<Score> = values.iter().map(|(l, held)| Score { logit: f32::from(*l), held: *held }).collect();
            let found = ranking(&all);
            let (held, failed): (Vec<Score>, Vec<Score>) = all.iter().partition(|score| score.held);
            let pairs = held.iter().flat_map(|a| failed.iter().map(move |b| (a.logit, b.logit)));
            let wins: f64 = pairs.map(|(a, b)| if a > b { 1.0 } else if a == b { 0.5 } else { 0.0 }).sum();
            if let Some(area) = found.roc_auc {
                prop_assert!((area - wins / (held.len() * failed.len()) as f64).abs() < 1e-12);
            } else {
                prop_assert!(held.is_empty() || failed.is_empty());
            }
            let (mut sum, mut before) = (0.0, 0);
            for threshold in (-3_i8..4).rev().map(f32::from) {
                let hits = held.iter().filter(|score| score.logit >= threshold).count();
                let misses = failed.iter().filter(|score| score.logit >= threshold).count();
                if hits > before {
                    sum += (hits - before) as f64 * hits as f64 / (hits + misses) as f64;
                }
                before = hits;
            }
            if let Some(average) = found.average_precision {
                prop_assert!((average - sum / held.len() as f64).abs() < 1e-12);
            } else {
                prop_assert!(held.is_empty());
            }
        }
    }
}
