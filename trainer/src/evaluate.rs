//! Evaluates a checkpoint on a dataset: accuracy, precision, recall and confusion, also by shape and by rule;
//! precision–recall and calibration; errors of the grasps.

pub mod mistakes;
pub mod report;

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use burn_dataset::Dataset as _;
use network::checkpoint::{self, CheckpointError};
use network::upsampling::Upsampling;
use program::{Exit, ExitCode};
use serde::Serialize;
use shards::{Dataset, Location};

use crate::config::Config;
use crate::data::{GraspDataset, LoadError, SpoolError, for_each_batch, load};
use crate::device::Device;
use crate::evaluate::mistakes::{Keeper, Mistake, Mistakes};
use crate::loss::SampleResult;
use crate::metrics::{Summary, Tally};
use crate::scores::{
    Calibration, GraspErrors, Ranking, Score, Spread, calibration, interval_by_scene, ranking, rotation_error_deg,
};
use crate::split::{EmptySplit, split};
use crate::step::evaluate as evaluate_batch;

/// The set of samples to evaluate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TestSet {
    /// Held-out attempts of training scenes.
    TestAttempts,
    /// Held-out scenes.
    TestScenes,
    /// Every sample: for a dataset that the network was not trained on.
    All,
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

/// Why a checkpoint cannot be evaluated.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// The checkpoint cannot be read.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The recipe in the checkpoint is damaged.
    #[error("damaged recipe in the checkpoint: {0}")]
    Config(#[from] settings::Error),
    /// The dataset cannot be loaded.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// Held-out sets exist only for the training dataset.
    #[error(
        "the network was trained on another dataset, {was}, so nothing of this one, {is}, is held out: use --split all"
    )]
    OtherDataset {
        /// Id of the training dataset.
        was: String,
        /// Id of this dataset.
        is: String,
    },
    /// The set has no samples.
    #[error(transparent)]
    Split(#[from] EmptySplit),
    /// The dataset has no samples.
    #[error("the dataset has no attempt whose grasp lies in the grid")]
    NoSamples,
    /// The decoded grids cannot be read.
    #[error(transparent)]
    Spool(#[from] SpoolError),
}

impl Exit for EvaluateError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::Checkpoint(error) => error.exit_code(),
            Self::Load(error) => error.exit_code(),
            Self::Spool(error) => error.exit_code(),
            Self::Config(_) => ExitCode::Data,
            Self::OtherDataset { .. } | Self::Split(_) | Self::NoSamples => ExitCode::Config,
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
    /// By target shape, with names as in the shards.
    pub by_shape: BTreeMap<&'static str, Summary>,
    /// By rule of Appendix A: shape and approach axis.
    pub by_rule: BTreeMap<&'static str, Summary>,
}

/// An evaluation with data for a closer look.
#[derive(Debug)]
pub struct Examination {
    /// The results.
    pub evaluation: Evaluation,
    /// The network's worst errors.
    pub mistakes: Mistakes,
    /// Their dataset.
    pub dataset: Dataset,
}

/// Evaluates a checkpoint on a set of a dataset. `scratch` is a folder for the decoded grids.
///
/// # Errors
/// [`EvaluateError`].
pub fn evaluate(
    checkpoint: &Path,
    data: impl Into<Location>,
    set: TestSet,
    scratch: &Path,
    stop: &AtomicBool,
    scene_done: &(dyn Fn() + Sync),
) -> Result<Evaluation, EvaluateError> {
    Ok(examine(checkpoint, data, set, scratch, stop, scene_done, 0)?.evaluation)
}

/// Like [`evaluate`], and keeps the `mistakes_max` worst errors of each kind.
///
/// # Errors
/// [`EvaluateError`].
pub fn examine(
    checkpoint: &Path,
    data: impl Into<Location>,
    set: TestSet,
    scratch: &Path,
    stop: &AtomicBool,
    scene_done: &(dyn Fn() + Sync),
    mistakes_max: usize,
) -> Result<Examination, EvaluateError> {
    let path = checkpoint;
    let checkpoint = checkpoint::read(path)?;
    let dataset = Dataset::open(data).map_err(LoadError::from)?;
    let dataset_id = dataset.id().to_owned();
    let is_the_same = dataset.has_id(&checkpoint.dataset_id);
    let trained_on = if is_the_same { dataset_id.clone() } else { checkpoint.dataset_id };
    if set != TestSet::All && !is_the_same {
        return Err(EvaluateError::OtherDataset { was: trained_on, is: dataset_id });
    }
    let samples = load(&dataset, scratch, stop, scene_done)?;
    let chosen = match set {
        TestSet::All => (0..samples.len()).collect(),
        TestSet::TestAttempts | TestSet::TestScenes => {
            let config = Config::parse(&checkpoint.config, path)?;
            let split = split(&samples.ids(), config.seed, &config.split)?;
            if set == TestSet::TestAttempts { split.test_attempts } else { split.test_scenes }
        }
    };
    if chosen.is_empty() {
        return Err(EvaluateError::NoSamples);
    }
    let results = results(&checkpoint.vector, &samples, &chosen, checkpoint.upsampling)?;
    let found = || chosen.iter().copied().zip(&results);
    let scores: Vec<Score> = results.iter().map(score).collect();
    let scenes: Vec<(u64, u64)> = tallies(found().map(|(at, result)| (samples.scene(at), result)))
        .into_values()
        .map(|tally| (tally.confusion.true_positive + tally.confusion.true_negative, tally.confusion.count()))
        .collect();
    let summaries = |tallies: BTreeMap<&'static str, Tally>| {
        tallies.into_iter().map(|(name, tally)| (name, tally.summary())).collect()
    };
    let mut all = Tally::default();
    all.add(&results);
    let mut worst = Keeper::new(mistakes_max);
    for (at, result) in found() {
        let (scene_id, attempt_id) = (samples.scene(at), samples.attempt(at));
        worst.see(Mistake { scene_id, attempt_id, score: score(result) });
    }
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
        errors: errors(&results, dataset.info().grid.voxel_size_m()),
        by_shape: summaries(tallies(found().map(|(at, result)| (samples.rule(at).shape.kind_name(), result)))),
        by_rule: summaries(tallies(found().map(|(at, result)| (samples.rule(at).name(), result)))),
    };
    Ok(Examination { evaluation, mistakes: worst.into_mistakes(), dataset })
}

/// Samples per batch.
const BATCH: usize = 192;

/// The network's predictions for samples, in their order.
fn results(
    vector: &[f32],
    samples: &GraspDataset,
    set: &[usize],
    mode: Upsampling,
) -> Result<Vec<SampleResult>, SpoolError> {
    debug_assert!(set.is_sorted(), "a batch sorts its samples");
    let mut results = Vec::with_capacity(set.len());
    for_each_batch(samples, set, BATCH, |batch| {
        results.extend(evaluate_batch(vector, &batch, mode, &Device::Host));
        ControlFlow::Continue(())
    })?;
    Ok(results)
}

fn score(result: &SampleResult) -> Score {
    Score { logit: result.quality_logit, held: result.label == 1 }
}

fn tallies<'a, K: Ord>(results: impl Iterator<Item = (K, &'a SampleResult)>) -> BTreeMap<K, Tally> {
    let mut tallies = BTreeMap::<K, Tally>::new();
    for (key, result) in results {
        tallies.entry(key).or_default().add(std::slice::from_ref(result));
    }
    tallies
}

fn errors(results: &[SampleResult], voxel_size_m: f32) -> GraspErrors {
    let held = || results.iter().filter(|result| result.label == 1);
    let width_mm = |result: &SampleResult| 1e3 * f64::from(voxel_size_m) * f64::from(result.width).sqrt();
    GraspErrors {
        samples: held().count(),
        rotation_deg: Spread::of(held().map(|result| rotation_error_deg(result.rotation)).collect()),
        width_mm: Spread::of(held().map(width_mm).collect()),
    }
}
