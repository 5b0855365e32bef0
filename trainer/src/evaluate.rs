//! A checkpoint against a dataset: accuracy, precision, recall, confusion, and accuracy by shape.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use burn::tensor::{Device, Tensor};
use burn_dataset::Dataset as _;
use serde::Serialize;
use shards::{Dataset, ExitCode, Location};

use crate::checkpoint::{self, CheckpointError};
use crate::config::{Config, ConfigError};
use crate::data::{GraspDataset, LoadError, SpoolError, for_each_batch, load};
use crate::metrics::{Summary, Tally};
use crate::split::{EmptySplit, split};
use crate::step::evaluate as evaluate_batch;
use crate::upsampling::Upsampling;

/// Which samples are looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TestSet {
    /// Held-out attempts of scenes that trained.
    TestAttempts,
    /// Held-out scenes.
    TestScenes,
    /// Every sample: for a dataset that the network was not trained on.
    All,
}

/// Why a checkpoint cannot be evaluated.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// The checkpoint cannot be read.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The recipe in the checkpoint is damaged.
    #[error("damaged recipe in the checkpoint: {0}")]
    Config(#[from] ConfigError),
    /// The dataset cannot be loaded.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// Held-out sets belong to the dataset that was trained on.
    #[error(
        "the network was trained on another dataset, {was}, so nothing of this one, {is}, is held out: use --split all"
    )]
    OtherDataset {
        /// Id of the dataset that the network was trained on.
        was: String,
        /// Id of this one.
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

impl EvaluateError {
    /// The code to end with.
    #[must_use]
    pub fn exit_code(&self) -> ExitCode {
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
    /// Epochs that the checkpoint has seen.
    pub epoch: u32,
    /// Steps that the checkpoint has seen.
    pub step: u64,
    /// The set.
    pub split: TestSet,
    /// Over the whole set.
    pub all: Summary,
    /// By the shape that was aimed at, names as in the shards.
    pub by_shape: BTreeMap<&'static str, Summary>,
}

/// Evaluates a checkpoint on a set of a dataset. `scratch` is a folder with room for the decoded grids.
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
    let path = checkpoint;
    let checkpoint = checkpoint::read(path, &Device::flex())?;
    let dataset = Dataset::open(data).map_err(LoadError::from)?;
    let dataset_id = dataset.info().dataset_id();
    if set != TestSet::All && dataset_id != checkpoint.dataset_id {
        return Err(EvaluateError::OtherDataset { was: checkpoint.dataset_id, is: dataset_id });
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
    let (all, by_shape) = tally(&checkpoint.vector, &samples, &chosen, checkpoint.upsampling)?;
    Ok(Evaluation {
        epoch: checkpoint.progress.epoch,
        step: checkpoint.progress.step,
        split: set,
        all: all.summary(),
        by_shape: by_shape.into_iter().map(|(shape, tally)| (shape, tally.summary())).collect(),
    })
}

/// Samples per batch.
const BATCH: usize = 192;

fn tally(
    vector: &Tensor<1>,
    samples: &GraspDataset,
    set: &[usize],
    mode: Upsampling,
) -> Result<(Tally, BTreeMap<&'static str, Tally>), SpoolError> {
    let (mut all, mut by_shape, mut at) = (Tally::default(), BTreeMap::<_, Tally>::new(), 0);
    for_each_batch(samples, set, BATCH, |batch| {
        let results = evaluate_batch(vector, &batch, mode);
        all.add(&results);
        // `set` ascends, so its batches keep its order.
        for result in &results {
            by_shape.entry(samples.shape(set[at]).name()).or_default().add(std::slice::from_ref(result));
            at += 1;
        }
        ControlFlow::Continue(())
    })?;
    Ok((all, by_shape))
}
