//! Evaluates a checkpoint on a dataset: accuracy, precision, recall and confusion, also by shape and by rule;
//! precision–recall and calibration; errors of the grasps.

pub mod mistakes;
pub mod report;

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::slice;
use std::sync::atomic::AtomicBool;

use network::checkpoint::{Checkpoint, Confusion};
use network::{Architecture, checkpoint};
use program::{ExitCode, Failure};
use schema::{Approach, Quat, Vec3};
use serde::Serialize;
use settings::words;
use shards::{Dataset, Location};

use crate::batch::Hand;
use crate::config::{Config, Targets};
use crate::data::marks::NO_SAMPLE;
use crate::data::{GraspDataset, Record, Set, for_each_batch};
use crate::device::Device;
use crate::evaluate::mistakes::{Mistake, worst};
use crate::judge;
use crate::loss::{Closings, SampleResult};
use crate::metrics::{Summary, Tally};
use crate::model::Model;
use crate::order::{Tour, steps_in_order};
use crate::scores::{
    Calibration, GraspErrors, Ranking, Score, Spread, average_precision_by_scene, best_accuracy, calibration,
    interval_by_scene, ranking, rotation_error_deg,
};
use crate::split::split;

words! {
    /// The set of samples to evaluate.
    pub enum TestSet {
        /// Held-out attempts of training scenes.
        TestAttempts = "test-attempts",
        /// Held-out scenes.
        TestScenes = "test-scenes",
        /// Every sample.
        All = "all",
    }
}

impl TestSet {
    /// A description of the set.
    #[must_use]
    pub fn description(self) -> &'static str {
        match self {
            Self::TestAttempts => "held-out attempts of scenes that trained",
            Self::TestScenes => "held-out scenes",
            Self::All => "all samples",
        }
    }
}

/// A checkpoint's results on a set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// Epochs of the checkpoint.
    pub epoch: u32,
    /// Steps of the checkpoint.
    pub step: u64,
    /// Id of the training dataset.
    pub trained_on: String,
    /// Id of the evaluated dataset.
    pub dataset_id: String,
    /// The set.
    pub split: TestSet,
    /// Number of scenes of the set's samples.
    pub scenes: usize,
    /// Over the whole set.
    pub all: Summary,
    /// 95 % interval of its accuracy by bootstrap over scenes; `None` for fewer than two scenes.
    pub accuracy_95_by_scene: Option<(f64, f64)>,
    /// Precision–recall and the areas.
    pub ranking: Ranking,
    /// Predicted against observed shares.
    pub calibration: Calibration,
    /// Errors of orientation and width.
    pub errors: GraspErrors,
    /// The same of those with a quality above 0.9, the paper's ε.
    pub errors_of_sure: GraspErrors,
    /// By target shape, with names as in the shards.
    pub by_shape: BTreeMap<&'static str, Summary>,
    /// By rule of Appendix A: shape and approach axis.
    pub by_rule: BTreeMap<&'static str, Summary>,
    /// What only a judge is asked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hands: Option<HandScores>,
}

/// Results of a judge that those over all samples hide.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HandScores {
    /// Attempts whose hand does not hit the table, which arithmetic knows.
    pub table_free: Scores,
    /// 95 % interval of their average precision by bootstrap over scenes.
    pub average_precision_95_by_scene: Option<(f64, f64)>,
    /// What arithmetic gives without a network.
    pub arithmetic: [Arithmetic; 2],
    /// By the way in which the hand was drawn.
    pub by_source: BTreeMap<&'static str, Scores>,
    /// By the number of views.
    pub by_views: BTreeMap<&'static str, Scores>,
    /// Scenes in which some attempt held.
    pub scenes_with_held: usize,
    /// Of these, the share in which the attempt of the highest quality held.
    pub best_held: Option<f64>,
    /// Wilson's 95 % interval of that share.
    pub best_held_95: Option<(f64, f64)>,
    /// By outcome.
    pub by_outcome: BTreeMap<&'static str, Summary>,
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
        let ranking = ranking(&scores);
        let mut all = Tally::default();
        all.add(results);
        Self {
            all: all.summary(),
            roc_auc: ranking.roc_auc,
            average_precision: ranking.average_precision,
            calibration_error: calibration(&scores).expected_error,
        }
    }

    fn by<K: Ord>(results: impl Iterator<Item = (K, SampleResult)>) -> BTreeMap<K, Self> {
        let mut groups = BTreeMap::<K, Vec<SampleResult>>::new();
        for (key, result) in results {
            groups.entry(key).or_default().push(result);
        }
        groups.into_iter().map(|(key, results)| (key, Self::of(&results))).collect()
    }
}

/// What arithmetic gives without a network. Thresholds are the best for this very set, which flatters it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Arithmetic {
    /// What is asked.
    pub asked: &'static str,
    /// Accuracy at the best threshold.
    pub accuracy: Option<f64>,
    /// The same on attempts whose hand does not hit the table.
    pub accuracy_table_free: Option<f64>,
    /// Area under the ROC curve.
    pub roc_auc: Option<f64>,
    /// Average precision.
    pub average_precision: Option<f64>,
}

impl Arithmetic {
    fn of(asked: &'static str, scores: &[Score], is_free: &[bool]) -> Self {
        let Ranking { roc_auc, average_precision, .. } = ranking(scores);
        let free: Vec<Score> = scores.iter().zip(is_free).filter_map(|(score, free)| free.then_some(*score)).collect();
        let (accuracy, accuracy_table_free) = (best_accuracy(scores), best_accuracy(&free));
        Self { asked, accuracy, accuracy_table_free, roc_auc, average_precision }
    }
}

fn score(result: &SampleResult) -> Score {
    Score { logit: result.quality_logit, held: result.label == 1 }
}

/// An evaluation with data for a closer look.
#[derive(Debug)]
pub struct Examination {
    /// The results.
    pub evaluation: Evaluation,
    /// Failed attempts with the highest qualities, worst first.
    pub overrated: Vec<Mistake>,
    /// Held attempts with the lowest qualities, worst first.
    pub underrated: Vec<Mistake>,
    /// Their dataset.
    pub dataset: Dataset,
}

/// A sample of the set and its result: 64 bytes, in memory for each.
struct Found {
    record: Record,
    /// Of a judge: what it was asked, and what arithmetic alone says of it.
    hand: Option<(Hand, f32)>,
    result: SampleResult,
}

/// Evaluates a checkpoint on a set of a dataset, and keeps the `mistakes_max` worst errors of each kind.
/// Without `targets` those of the recipe are asked.
///
/// # Errors
/// If checkpoint or dataset cannot be read, or the set has no samples.
pub fn examine(
    path: &Path,
    data: impl Into<Location>,
    set: TestSet,
    targets: Option<Targets>,
    mistakes_max: usize,
) -> Result<Examination, Failure> {
    let checkpoint = checkpoint::read(path)?;
    let dataset = Dataset::open(data)?;
    let dataset_id = dataset.id().to_owned();
    let trained_on = trained_on(&checkpoint, &dataset, set)?;
    if let Architecture::Judge(scope) = &checkpoint.architecture {
        let info = dataset.info();
        info.hands().iter().try_for_each(|hand| scope.must_match(hand, &info.grid))?;
    }
    let model = Model::of(&checkpoint.architecture, dataset.info().hands().iter());
    let found = results(&checkpoint, &dataset, &model, (set, targets), path)?;
    if found.is_empty() {
        let what = "the dataset has no attempt whose grasp lies in the grid";
        return Err(Failure::new(ExitCode::Config, what));
    }
    must_be_finite(&found, path)?;
    let mistakes = found.iter().map(|Found { record, result, .. }| Mistake {
        scene_id: record.scene.into(),
        attempt_id: record.attempt,
        score: score(result),
    });
    let mistakes: Vec<Mistake> = mistakes.collect();
    let scores: Vec<Score> = mistakes.iter().map(|mistake| mistake.score).collect();
    let scenes: Vec<(u64, u64)> = tallies(found.iter().map(|own| (own.record.scene, &own.result)))
        .into_values()
        .map(|tally| (tally.confusion.true_positive + tally.confusion.true_negative, tally.confusion.count()))
        .collect();
    let by = |key: fn(&Record) -> &'static str| summaries(found.iter().map(|own| (key(&own.record), &own.result)));
    let results: Vec<SampleResult> = found.iter().map(|own| own.result).collect();
    let mut all = Tally::default();
    all.add(&results);
    let evaluation = Evaluation {
        epoch: checkpoint.progress.epoch,
        step: checkpoint.progress.step,
        trained_on,
        dataset_id,
        split: set,
        scenes: scenes.len(),
        all: all.summary(),
        accuracy_95_by_scene: interval_by_scene(&scenes),
        ranking: ranking(&scores),
        calibration: calibration(&scores),
        // A judge predicts no grasp, so it has no errors of one.
        errors: errors(found.iter(), dataset.info().grid.voxel_size_m()),
        errors_of_sure: errors(found.iter().filter(|own| is_sure(&own.result)), dataset.info().grid.voxel_size_m()),
        by_shape: by(|record| record.rule.shape.kind_name()),
        by_rule: by(|record| record.rule.name()),
        hands: model.crops().map(|_| hand_scores(&found)),
    };
    let [overrated, underrated] = [false, true].map(|held| worst(&mistakes, held, mistakes_max));
    Ok(Examination { evaluation, overrated, underrated, dataset })
}

/// The network's predictions for a set, by scene and attempt.
fn results(
    checkpoint: &Checkpoint,
    dataset: &Dataset,
    model: &Model,
    (set, targets): (TestSet, Option<Targets>),
    path: &Path,
) -> Result<Vec<Found>, Failure> {
    let stop = AtomicBool::new(false);
    let config = Config::parse(&checkpoint.config, path);
    // Weights from elsewhere have no recipe.
    let targets = targets.unwrap_or(config.as_ref().map_or(Targets::Attempt, |config| config.training.targets));
    let seen = model.seen(targets);
    let mut samples = GraspDataset::survey(slice::from_ref(dataset), seen, &stop, &|| {})?;
    let wanted = match set {
        TestSet::All => None,
        TestSet::TestAttempts => Some(Set::TestAttempts),
        TestSet::TestScenes => Some(Set::TestScenes),
    };
    if wanted.is_some() {
        let damaged = |error| Failure::new(ExitCode::Data, format!("damaged recipe in the checkpoint: {error}"));
        let config = config.map_err(damaged)?;
        split(&mut samples.marks, config.seed, &config.split)?;
    }
    let set_of = |mark: u8| (if let Some(set) = wanted { mark == set as u8 } else { mark != NO_SAMPLE }).then_some(0);
    let tour = Tour::ascending(&samples.marks, |mark| set_of(mark).is_some());
    let mut found = Vec::new();
    for_each_batch(&samples, (&tour, 0), steps_in_order(&samples.marks, &tour, BATCH, set_of), None, |_, batch| {
        let results = model.evaluate(&checkpoint.vector, &batch, &Device::Host);
        let clearances = model.crops().map(|crops| judge::clearances(&batch, crops)).unwrap_or_default();
        let mut hands = batch.hands.iter().copied().zip(clearances);
        let own = batch.records.iter().zip(results);
        found.extend(own.map(|(record, result)| Found { record: *record, hand: hands.next(), result }));
        ControlFlow::Continue(())
    })?;
    Ok(found)
}

/// What a network was trained on, as the evaluation names it.
///
/// # Errors
/// If nothing of the dataset is held out, or the network saw it with others, so that no one knows what.
fn trained_on(checkpoint: &Checkpoint, dataset: &Dataset, set: TestSet) -> Result<String, Failure> {
    let (is, was) = (dataset.id(), &checkpoint.dataset_id);
    let refused = |text: String| Err(Failure::new(ExitCode::Config, text));
    if !was.split('+').any(|id| dataset.has_id(id)) {
        return match set {
            TestSet::All => Ok(was.clone()),
            TestSet::TestAttempts | TestSet::TestScenes => refused(format!(
                "the network was trained on another dataset, {was}, so nothing of this one, {is}, is held out: use \
                 --split all"
            )),
        };
    }
    if was.contains('+') {
        return refused(format!(
            "the network was trained on several datasets, {is} among them: evaluate it on one that it never saw"
        ));
    }
    Ok(is.to_owned())
}

fn must_be_finite(found: &[Found], path: &Path) -> Result<(), Failure> {
    let Some(Found { record, result, .. }) = found.iter().find(|own| !own.result.total.is_finite()) else {
        return Ok(());
    };
    let (attempt, scene, loss) = (record.attempt, record.scene, result.total);
    let text = format!("the loss of attempt {attempt} of scene {scene} must be finite, got {loss}");
    Err(Failure::new(ExitCode::Data, format!("{text}: {}", path.display())))
}

fn hand_scores(found: &[Found]) -> HandScores {
    let hands = || found.iter().filter_map(|own| Some((&own.record, own.hand.as_ref()?, &own.result)));
    let free: Vec<SampleResult> =
        hands().filter(|(_, (hand, _), _)| !hand.hits_table).map(|(.., result)| *result).collect();
    let of_scenes: Vec<(u32, Score)> = hands()
        .filter(|(_, (hand, _), _)| !hand.hits_table)
        .map(|(record, _, result)| (record.scene, score(result)))
        .collect();
    let is_free: Vec<bool> = hands().map(|(_, (hand, _), _)| !hand.hits_table).collect();
    let arithmetic = |asked, value: fn(f32, bool) -> f32| {
        let score = |(_, (hand, clearance), result): (_, &(Hand, f32), _)| Score {
            logit: value(*clearance, !hand.hits_table),
            ..score(result)
        };
        Arithmetic::of(asked, &hands().map(score).collect::<Vec<_>>(), &is_free)
    };
    let mut scenes = BTreeMap::<u32, (bool, Score)>::new();
    for (record, _, result) in hands() {
        let own = score(result);
        let (any, best) = scenes.entry(record.scene).or_insert((false, own));
        *any |= own.held;
        if own.logit > best.logit {
            *best = own;
        }
    }
    let with_held = scenes.values().filter(|(any, _)| *any).count();
    let best_held = scenes.values().filter(|(_, best)| best.held).count();
    let (held, failed) = (best_held as u64, (with_held - best_held) as u64);
    let counts = Confusion { true_positive: held, false_positive: failed, ..Confusion::default() };
    let source = |record: &Record| match record.rule.approach {
        Approach::Axis(_) => "rules",
        approach => approach.name(),
    };
    let views = |views: usize| match views {
        ..=1 => "1 view",
        2 => "2 views",
        _ => "3 views or more",
    };
    HandScores {
        table_free: Scores::of(&free),
        average_precision_95_by_scene: average_precision_by_scene(&of_scenes),
        arithmetic: [
            arithmetic("does the swept hand touch the table", |_, free| f32::from(u8::from(free))),
            arithmetic("… or what was seen, by one threshold", |clearance, _| clearance),
        ],
        by_source: Scores::by(hands().map(|(record, _, result)| (source(record), *result))),
        by_views: Scores::by(hands().map(|(_, (hand, _), result)| (views(hand.views), *result))),
        scenes_with_held: with_held,
        best_held: (with_held > 0).then(|| best_held as f64 / with_held as f64),
        best_held_95: (with_held > 0).then(|| counts.interval()),
        by_outcome: summaries(hands().map(|(_, (hand, _), result)| (hand.outcome.name(), result))),
    }
}

/// Samples per batch.
const BATCH: usize = 192;

fn summaries<'a>(results: impl Iterator<Item = (&'static str, &'a SampleResult)>) -> BTreeMap<&'static str, Summary> {
    tallies(results).into_iter().map(|(name, tally)| (name, tally.summary())).collect()
}

fn tallies<'a, K: Ord>(results: impl Iterator<Item = (K, &'a SampleResult)>) -> BTreeMap<K, Tally> {
    let mut tallies = BTreeMap::<K, Tally>::new();
    for (key, result) in results {
        tallies.entry(key).or_default().add(std::slice::from_ref(result));
    }
    tallies
}

/// Whether the network gives a sample more than the paper's ε = 0.9.
fn is_sure(result: &SampleResult) -> bool {
    result.quality_logit > libm::logf(9.0)
}

/// Of the held ones; a judge predicts no grasp, so it has no errors of one.
fn errors<'a>(found: impl Iterator<Item = &'a Found>, voxel_size_m: f32) -> GraspErrors {
    let held: Vec<(&Record, &SampleResult, Quat)> = found
        .filter(|own| own.result.label == 1)
        .filter_map(|own| Some((&own.record, &own.result, Quat::from_array(own.result.predicted?))))
        .collect();
    let over = |error: &dyn Fn(&Record, &SampleResult, Quat) -> f64| {
        Spread::of(held.iter().map(|(record, result, predicted)| error(record, result, *predicted)).collect())
    };
    // The cosine between an axis of the true hand and one of the predicted hand.
    let cosine =
        |record: &Record, axis: Vec3, predicted: Vec3| (Quat::from_array(record.rotation) * axis).dot(predicted);
    let apart_deg = |cosine: f32| f64::from(libm::acosf(cosine.clamp(-1.0, 1.0)).to_degrees());
    GraspErrors {
        samples: held.len(),
        rotation_deg: over(&|_, result, _| rotation_error_deg(result.rotation)),
        approach_deg: over(&|record, _, predicted| apart_deg(cosine(record, Vec3::Z, predicted * Vec3::Z))),
        closing_deg: over(&|record, _, predicted| apart_deg(cosine(record, Vec3::Y, predicted * Vec3::Y).abs())),
        nearest_closing_deg: over(&|record, _, predicted| {
            let to = |axis: Vec3| cosine(record, axis, predicted * Vec3::Y).abs();
            apart_deg(match record.closings {
                Closings::Half => to(Vec3::Y),
                Closings::Quarter => to(Vec3::Y).max(to(Vec3::X)),
                Closings::Any => libm::hypotf(to(Vec3::X), to(Vec3::Y)),
            })
        }),
        width_mm: over(&|_, result, _| 1e3 * f64::from(voxel_size_m) * f64::from(result.width).sqrt()),
    }
}
