//! The results of a judge that those over all samples hide.

use std::collections::BTreeMap;

use network::checkpoint::Confusion;
use serde::Serialize;

use super::sample::Found;
use crate::metrics::{Summary, Tally, summaries};
use crate::results::SampleResult;
use crate::scores::{Ranking, Score, average_precision_by_scene, calibration, ranking, score};

/// Results of a judge that those over all samples hide.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JudgeScores {
    /// Attempts whose gripper does not hit the table, which arithmetic knows.
    pub table_free: Scores,
    /// 95 % interval of their average precision by bootstrap over scenes.
    pub average_precision_95_by_scene: Option<(f64, f64)>,
    /// Scenes in which some attempt held.
    pub scenes_with_held: usize,
    /// Of these, the share in which the attempt of the highest quality held.
    pub best_held: Option<f64>,
    /// Wilson's 95 % interval of that share.
    pub best_held_95: Option<(f64, f64)>,
    /// How well the share of repeats that hold is foretold, of attempts that were repeated.
    pub robustness: Option<RobustnessScores>,
    /// By outcome.
    pub by_outcome: BTreeMap<&'static str, Summary>,
}

/// The robustness that a judge expects beside the true one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RobustnessScores {
    /// Attempts that were repeated.
    pub attempts: usize,
    /// Mean share of their repeats that held.
    pub mean: f64,
    /// Mean expected share.
    pub mean_expected: f64,
    /// Mean size of the difference …
    pub mean_error: f64,
    /// … and that of an answer that is the mean for all.
    pub mean_error_of_mean: f64,
}

impl RobustnessScores {
    fn of(found: &[Found]) -> Option<Self> {
        let pairs: Vec<[f64; 2]> =
            found.iter().filter_map(|(_, result)| result.robustness).map(|pair| pair.map(f64::from)).collect();
        let over_all = |value: &dyn Fn(&[f64; 2]) -> f64| pairs.iter().map(value).sum::<f64>() / pairs.len() as f64;
        let mean = over_all(&|[_, share]| *share);
        (!pairs.is_empty()).then(|| Self {
            attempts: pairs.len(),
            mean,
            mean_expected: over_all(&|[expected, _]| *expected),
            mean_error: over_all(&|[expected, share]| (expected - share).abs()),
            mean_error_of_mean: over_all(&|[_, share]| (mean - share).abs()),
        })
    }
}

/// Results on some of the attempts.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scores {
    /// Losses and ratios.
    pub all: Summary,
    /// Area under the ROC curve.
    pub roc_auc: Option<f64>,
    /// Average precision.
    pub average_precision: Option<f64>,
    /// Expected calibration error.
    pub calibration_error: f64,
}

impl Scores {
    fn of(results: &[SampleResult]) -> Self {
        let scores: Vec<Score> = results.iter().map(score).collect();
        let Ranking { roc_auc, average_precision, .. } = ranking(&scores);
        let (mut all, calibration_error) = (Tally::default(), calibration(&scores).expected_error);
        all.add(results);
        Self { all: all.summary(), roc_auc, average_precision, calibration_error }
    }
}

pub(super) fn judge_scores(found: &[Found]) -> JudgeScores {
    let free = || found.iter().filter(|(sample, _)| !sample.data.hits_table);
    let of_scenes: Vec<(u32, Score)> = free().map(|(sample, result)| (sample.id.scene, score(result))).collect();
    let mut scenes = BTreeMap::<u32, (bool, Score)>::new();
    for (sample, result) in found {
        let own = score(result);
        let (any, best) = scenes.entry(sample.id.scene).or_insert((false, own));
        *any |= own.held;
        if own.logit > best.logit {
            *best = own;
        }
    }
    let with_held = scenes.values().filter(|(any, _)| *any).count();
    let best_held = scenes.values().filter(|(_, best)| best.held).count();
    let (held, failed) = (best_held as u64, (with_held - best_held) as u64);
    let counts = Confusion { true_positive: held, false_positive: failed, ..Confusion::default() };
    JudgeScores {
        table_free: Scores::of(&free().map(|(_, result)| *result).collect::<Vec<_>>()),
        average_precision_95_by_scene: average_precision_by_scene(&of_scenes),
        scenes_with_held: with_held,
        best_held: (with_held > 0).then(|| best_held as f64 / with_held as f64),
        best_held_95: (with_held > 0).then(|| counts.interval()),
        robustness: RobustnessScores::of(found),
        by_outcome: summaries(found.iter().map(|(sample, result)| (sample.data.outcome.name(), result))),
    }
}
