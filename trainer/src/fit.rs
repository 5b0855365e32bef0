//! Training, top to bottom: the paper's recipe (section 2.3).

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use network::checkpoint::Checkpoint;
use network::layers::initial_vector;
use program::{Exit, ExitCode};
use shards::{Dataset, Location};

use crate::adam::Adam;
use crate::config::{Config, TrainingParams};
use crate::data::{
    GraspDataset, LoadError, SpoolError, TrainingTransform, for_each_batch, for_each_training_batch, load,
};
use crate::device::Device;
use crate::events::{Beginning, EpochReport, Event, LabelCount};
use crate::loss::ClassWeights;
use crate::metrics::Tally;
use crate::order::epoch_order;
use crate::patience::epochs_without_better;
use crate::progress::Progress;
use crate::run_folder::{RunError, RunFolder};
use crate::split::{EmptySplit, Split, split};
use crate::step::{evaluate, step};
use crate::watch::Watch;

/// Why training failed.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// The dataset cannot be loaded.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The run's folder cannot be used.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A set of the split is empty.
    #[error(transparent)]
    Split(#[from] EmptySplit),
    /// The decoded grids cannot be read.
    #[error(transparent)]
    Spool(#[from] SpoolError),
    /// The loss is not finite any more.
    #[error("the loss or its gradient is no finite number at step {step}: training.learning_rate is too high")]
    Diverged {
        /// Step.
        step: u64,
    },
}

impl Exit for FitError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::Load(error) => error.exit_code(),
            Self::Run(error) => error.exit_code(),
            Self::Spool(error) => error.exit_code(),
            Self::Split(_) | Self::Diverged { .. } => ExitCode::Config,
        }
    }
}

/// How training ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// After the last epoch, or early without further improvement.
    Done,
    /// Stopped by a signal; the checkpoint is written.
    Stopped,
}

/// Samples per batch in tests: larger, because there are no gradients.
const TEST_BATCH: usize = 192;

/// Weights, optimiser and progress: the state of training.
struct State {
    vector: Vec<f32>,
    adam: Adam,
    progress: Progress,
}

/// A training job.
#[derive(Debug, Clone, Copy)]
pub struct Job<'a> {
    /// The location of the dataset.
    pub data: &'a Location,
    /// The recipe.
    pub config: &'a Config,
    /// The run's folder.
    pub run: &'a Path,
    /// Whether to resume an existing run.
    pub resume: bool,
    /// The compute device.
    pub device: &'a Device,
}

/// [`fit_job`] on the host.
///
/// # Errors
/// [`FitError`].
pub fn fit(
    data: impl Into<Location>,
    config: &Config,
    run: &Path,
    resume: bool,
    stop: &AtomicBool,
    observe: &(dyn Fn(Event<'_>) + Sync),
) -> Result<Ending, FitError> {
    fit_job(&Job { data: &data.into(), config, run, resume, device: &Device::Host }, stop, observe)
}

/// Trains the network on a dataset and writes checkpoints and metrics to a folder.
///
/// On the CPU the result is a pure function of dataset and configuration: neither the number of threads nor stopping
/// and resuming at any batch changes a bit of it.
///
/// # Errors
/// [`FitError`].
pub fn fit_job(job: &Job<'_>, stop: &AtomicBool, observe: &(dyn Fn(Event<'_>) + Sync)) -> Result<Ending, FitError> {
    let (config, device) = (job.config, job.device);
    let dataset = Dataset::open(job.data.clone()).map_err(LoadError::from)?;
    let dataset_id = dataset.id();
    let folder = RunFolder::open(job.run, config, job.resume)?;
    let watch = Watch::new(folder.path(), config.checkpoint.every_steps);
    let observe: &(dyn Fn(Event<'_>) + Sync) = &|event| {
        watch.see(&event);
        observe(event);
    };
    let last = folder.last(&dataset)?;
    folder.write_config(config)?;
    let mut state = match last {
        Some(checkpoint) => resumed(checkpoint, config),
        None => begun(config),
    };

    observe(Event::Loading(&dataset));
    let samples = match load(&dataset, folder.path(), stop, &|| observe(Event::SceneLoaded)) {
        Err(LoadError::Stopped) => return Ok(Ending::Stopped),
        loaded => loaded?,
    };
    let split = split(&samples.ids(), config.seed, &config.split)?;
    let save = |state: &State| folder.save_last(&checkpoint(state, config, dataset_id));
    let mut metrics = folder.metrics()?;
    metrics.truncate(state.progress.epoch as usize);
    observe(Event::Begun(&Beginning::of(&samples, &split, &state.progress)));
    let set = TrainingSet::new(&samples, &split.train, config, device);
    while state.progress.epoch < config.training.epochs {
        let without_better = epochs_without_better(&metrics);
        if config.training.patience_epochs > 0 && without_better >= config.training.patience_epochs {
            observe(Event::NoBetter(without_better));
            break;
        }
        let began = Instant::now();
        let tested = match train_epoch(&mut state, &set, stop, observe, &save)? {
            ControlFlow::Continue(()) => test_epoch(&state.vector, &split, &set, stop)?,
            ControlFlow::Break(()) => None,
        };
        let Some([test_attempts, test_scenes]) = tested else {
            save(&state)?;
            return Ok(Ending::Stopped);
        };
        let mut report = EpochReport {
            epoch: state.progress.epoch + 1,
            step: state.progress.step,
            learning_rate: set.learning_rate(state.progress.step.saturating_sub(1)),
            train: state.progress.tally.summary(),
            test_attempts: test_attempts.summary(),
            test_scenes: test_scenes.summary(),
            split_by: config.split.by,
            is_best: false,
            seconds: began.elapsed().as_secs_f64(),
        };
        report.is_best = report.test().accuracy > state.progress.best_accuracy;
        let best_accuracy = if report.is_best { report.test().accuracy } else { state.progress.best_accuracy };
        let (epoch, step) = (report.epoch, report.step);
        state.progress = Progress { epoch, batch: 0, step, tally: Tally::default(), best_accuracy };
        if report.is_best {
            folder.save_best(&checkpoint(&state, config, dataset_id))?;
        }
        metrics.truncate(report.epoch as usize - 1);
        metrics.push(serde_json::to_string(&report).unwrap_or_default()); // numbers under fixed keys always serialise
        folder.write_metrics(&metrics)?;
        save(&state)?;
        observe(Event::Epoch(&report));
    }
    Ok(Ending::Done)
}

/// The training samples, with their order and weights.
struct TrainingSet<'a> {
    samples: &'a GraspDataset,
    config: &'a Config,
    train: &'a [usize],
    device: &'a Device,
    weights: ClassWeights,
    /// Steps of an epoch.
    steps: u64,
}

impl<'a> TrainingSet<'a> {
    fn new(samples: &'a GraspDataset, train: &'a [usize], config: &'a Config, device: &'a Device) -> Self {
        let count = LabelCount::of(samples, train);
        let weights = ClassWeights::new(config.training.positive_weight, count.held, count.samples);
        Self { samples, config, train, device, weights, steps: train.len().div_ceil(config.training.batch) as u64 }
    }

    /// Adam's step size at a step, counted from 0 over all epochs.
    fn learning_rate(&self, step: u64) -> f64 {
        let config = self.config;
        config.training.schedule.learning_rate(
            config.training.learning_rate,
            step,
            u64::from(config.training.epochs) * self.steps,
        )
    }
}

/// The rest of an epoch; `Break` if a signal stopped it.
fn train_epoch(
    state: &mut State,
    set: &TrainingSet<'_>,
    stop: &AtomicBool,
    observe: &(dyn Fn(Event<'_>) + Sync),
    save: &dyn Fn(&State) -> Result<(), RunError>,
) -> Result<ControlFlow<()>, FitError> {
    let TrainingSet { samples, config, .. } = *set;
    let Config { seed, augmentation, training: TrainingParams { samples_per_scene, .. }, .. } = *config;
    let epoch = state.progress.epoch;
    let order = epoch_order(set.train, |at| samples.scene(at), samples_per_scene, seed, epoch);
    let transform = TrainingTransform { seed, epoch, augmentation, weights: set.weights };
    let done = (state.progress.batch as usize * config.training.batch).min(order.len());
    let mut outcome = Ok(ControlFlow::Continue(()));
    for_each_training_batch(samples, &order[done..], config.training.batch, &transform, |batch| {
        if stop.load(Ordering::Relaxed) {
            outcome = Ok(ControlFlow::Break(()));
            return ControlFlow::Break(());
        }
        state.adam.set_learning_rate(set.learning_rate(state.progress.step));
        let result = step(&state.vector, &batch, config.network.upsampling, set.device);
        let count = result.samples.len();
        let loss = result.samples.iter().map(|sample| f64::from(sample.total)).sum::<f64>() / count as f64;
        // Checked before the step, so that checkpoints never contain a diverged state.
        if !loss.is_finite() || !result.gradient.iter().map(|part| part.abs()).sum::<f32>().is_finite() {
            outcome = Err(FitError::Diverged { step: state.progress.step + 1 });
            return ControlFlow::Break(());
        }
        state.adam.step(&mut state.vector, &result.gradient);
        state.progress.tally.add(&result.samples);
        state.progress.batch += 1;
        state.progress.step += 1;
        observe(Event::Step { step: state.progress.step, samples: count, loss });
        let every = u64::from(config.checkpoint.every_steps);
        if every > 0
            && state.progress.step.is_multiple_of(every)
            && let Err(error) = save(state)
        {
            outcome = Err(error.into());
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    })?;
    outcome
}

/// Both test sets after an epoch; `None` if a signal stopped it.
fn test_epoch(
    vector: &[f32],
    split: &Split,
    set: &TrainingSet<'_>,
    stop: &AtomicBool,
) -> Result<Option<[Tally; 2]>, FitError> {
    let TrainingSet { samples, config, device, .. } = *set;
    let mut tallies = [Tally::default(); 2];
    let is_stopped = || stop.load(Ordering::Relaxed);
    for (tally, test) in tallies.iter_mut().zip([&split.test_attempts, &split.test_scenes]) {
        for_each_batch(samples, test, TEST_BATCH, |batch| {
            tally.add(&evaluate(vector, &batch, config.network.upsampling, device));
            if is_stopped() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })?;
        if is_stopped() {
            return Ok(None);
        }
    }
    Ok(Some(tallies))
}

fn begun(config: &Config) -> State {
    State {
        vector: initial_vector(config.seed),
        adam: Adam::new(config.training.learning_rate),
        progress: Progress::default(),
    }
}

fn resumed(checkpoint: Checkpoint, config: &Config) -> State {
    let adam = match checkpoint.moments {
        Some(moments) => Adam::resume(config.training.learning_rate, moments),
        None => Adam::new(config.training.learning_rate),
    };
    State { vector: checkpoint.vector, adam, progress: checkpoint.progress.into() }
}

fn checkpoint(state: &State, config: &Config, dataset_id: &str) -> Checkpoint {
    Checkpoint {
        vector: state.vector.clone(),
        upsampling: config.network.upsampling,
        config: config.to_toml(),
        dataset_id: dataset_id.to_owned(),
        progress: (&state.progress).into(),
        moments: state.adam.moments().cloned(),
    }
}
