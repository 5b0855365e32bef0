//! Training, top to bottom: the paper's recipe (section 2.3).

use std::io;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use network::checkpoint::{Checkpoint, Progress};
use network::judge::Scope;
use network::{Architecture, Kind};
use program::{ExitCode, Failure};
use shards::{Dataset, Location};

use crate::adam;
use crate::batch::Batch;
use crate::config::{Config, TrainingParams};
use crate::data::{GraspDataset, TrainingTransform, for_each_batch, load};
use crate::device::Device;
use crate::events::{Beginning, EpochReport, Event, LabelCount};
use crate::loss::ClassWeights;
use crate::metrics::Tally;
use crate::model::Model;
use crate::order::epoch_order;
use crate::patience::epochs_without_better;
use crate::run_folder::{RunFolder, id_of, read_metrics};
use crate::split::{Split, split};
use crate::watch::Watch;

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

/// A training job.
#[derive(Debug, Clone, Copy)]
pub struct Job<'a> {
    /// The locations of the datasets.
    pub data: &'a [Location],
    /// The recipe.
    pub config: &'a Config,
    /// The run's folder.
    pub run: &'a Path,
    /// The checkpoint whose weights a new run begins with, if not with random ones.
    pub from: Option<&'a Checkpoint>,
    /// Whether to resume an existing run.
    pub resume: bool,
    /// The compute device.
    pub device: &'a Device,
}

/// Trains the network on one or several datasets and writes checkpoints and metrics to a folder.
///
/// On the CPU the result is a pure function of dataset and configuration: neither the number of threads nor stopping
/// and resuming at any batch changes a bit of it.
///
/// # Errors
/// If the dataset cannot be read or split, the run's folder is refused or cannot be written, or the loss diverges.
pub fn fit(job: &Job<'_>, stop: &AtomicBool, observe: &(dyn Fn(Event<'_>) + Sync)) -> Result<Ending, Failure> {
    let Job { data, config, run, from, resume, device } = *job;
    let datasets = open(data)?;
    let folder = RunFolder::open(run, config, resume)?;
    let watch = Watch::new(run, config.checkpoint.every_steps);
    let observe: &(dyn Fn(Event<'_>) + Sync) = &|event| {
        watch.see(&event);
        observe(event);
    };
    let (architecture, dataset_id) = (architecture(config, &datasets[0], device)?, id_of(&datasets));
    let (vector, progress, moments) = match folder.last(&datasets)? {
        Some(last) => (last.vector, last.progress, last.moments),
        None => (first_vector(&architecture, config, from)?, Progress::default(), None),
    };
    folder.write_config(config)?;
    let model = Model::of(&architecture);
    let mut state = Checkpoint { vector, architecture, config: config.to_toml(), dataset_id, progress, moments };

    observe(Event::Loading(&datasets));
    let samples = match load(&datasets, run, model.seen(0.5), stop, &|| observe(Event::SceneLoaded)) {
        Err(_) if stop.load(Ordering::Relaxed) => return Ok(Ending::Stopped),
        loaded => loaded?,
    };
    let mut split = split(&samples.ids(), config.seed, &config.split)?;
    // Of hands that hit the table there is nothing to learn.
    split.train.retain(|at| samples.hand(*at).is_none_or(|hand| !hand.hits_table));
    let mut metrics: Vec<String> = read_metrics(run)?.lines().map(str::to_owned).collect();
    metrics.truncate(progress.epoch as usize);
    observe(Event::Begun(&Beginning::of(&samples, &split, &progress)));
    let labels = LabelCount::of(&samples, &split.train);
    let training = Training {
        config,
        model: &model,
        device,
        folder: &folder,
        samples: &samples,
        split: &split,
        stop,
        observe,
        weights: ClassWeights::new(config.training.positive_weight, labels.held, labels.samples),
        steps: labels.samples.div_ceil(config.training.batch) as u64,
    };
    while state.progress.epoch < config.training.epochs {
        let without_better = epochs_without_better(&metrics);
        if config.training.patience_epochs > 0 && without_better >= config.training.patience_epochs {
            observe(Event::NoBetter(without_better));
            break;
        }
        let Some(report) = training.epoch(&mut state)? else {
            folder.save_last(&state)?;
            return Ok(Ending::Stopped);
        };
        if report.is_best {
            folder.save_best(&state)?;
        }
        metrics.push(serde_json::to_string(&report).unwrap_or_default()); // numbers under fixed keys always serialise
        folder.write_metrics(&metrics)?;
        folder.save_last(&state)?;
        observe(Event::Epoch(&report));
    }
    Ok(Ending::Done)
}

/// Opens datasets that can be trained on together.
fn open(data: &[Location]) -> Result<Vec<Dataset>, Failure> {
    let refused = |why: String| Failure::new(ExitCode::Config, why);
    let datasets: Vec<Dataset> = data.iter().cloned().map(Dataset::open).collect::<Result<_, _>>()?;
    let Some((first, others)) = datasets.split_first() else {
        return Err(refused("no dataset to train on".to_owned()));
    };
    for (number, other) in others.iter().enumerate() {
        let (a, b) = (first.info(), other.info());
        let differs = [
            ("grids", a.grid != b.grid),
            ("grippers", a.gripper != b.gripper),
            ("procedures", a.procedure != b.procedure),
        ];
        if let Some((what, _)) = differs.into_iter().find(|(_, differ)| *differ) {
            let (here, there) = (first.location(), other.location());
            return Err(refused(format!("datasets of other {what} cannot be trained on together: {here}, {there}")));
        }
        if datasets[..=number].iter().any(|earlier| earlier.id() == other.id()) {
            return Err(refused(format!("the dataset is given twice: {}", other.location())));
        }
    }
    Ok(datasets)
}

/// The weights that a new run begins with.
fn first_vector(architecture: &Architecture, config: &Config, from: Option<&Checkpoint>) -> Result<Vec<f32>, Failure> {
    match from {
        None => Ok(architecture.initial_vector(config.seed)),
        Some(from) if from.architecture == *architecture => Ok(from.vector.clone()),
        Some(_) => Err(Failure::new(
            ExitCode::Config,
            "the weights of --from are another network's than the recipe's, or a judge's of another hand or grid",
        )),
    }
}

/// The network that a recipe asks for.
fn architecture(config: &Config, dataset: &Dataset, device: &Device) -> Result<Architecture, Failure> {
    match config.network.kind {
        Kind::Voxel => Ok(Architecture::Voxel(config.network.upsampling)),
        Kind::Judge if *device != Device::Host => {
            Err(Failure::new(ExitCode::Config, "a judge is trained on the host: --device cpu"))
        }
        Kind::Judge => {
            let info = dataset.info();
            let pregrasp_distance_m = info.procedure.pregrasp_distance_m;
            Ok(Architecture::Judge(Box::new(Scope {
                gripper: info.gripper.clone(),
                pregrasp_distance_m,
                grid: info.grid,
            })))
        }
    }
}

/// What stays the same during training.
struct Training<'a> {
    config: &'a Config,
    model: &'a Model,
    device: &'a Device,
    folder: &'a RunFolder,
    samples: &'a GraspDataset,
    split: &'a Split,
    stop: &'a AtomicBool,
    observe: &'a (dyn Fn(Event<'_>) + Sync),
    weights: ClassWeights,
    /// Steps of an epoch.
    steps: u64,
}

impl Training<'_> {
    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Adam's step size at a step, counted from 0 over all epochs.
    fn learning_rate(&self, step: u64) -> f64 {
        let TrainingParams { schedule, learning_rate, epochs, .. } = self.config.training;
        schedule.learning_rate(learning_rate, step, u64::from(epochs) * self.steps)
    }

    /// The rest of an epoch and its tests; `None` if a signal stopped it.
    fn epoch(&self, state: &mut Checkpoint) -> Result<Option<EpochReport>, Failure> {
        let began = Instant::now();
        self.train(state)?;
        let test_attempts = self.test(&state.vector, &self.split.test_attempts)?;
        let test_scenes = self.test(&state.vector, &self.split.test_scenes)?;
        if self.is_stopped() {
            return Ok(None);
        }
        let Progress { epoch, step, best_accuracy_bits, .. } = state.progress;
        let mut report = EpochReport {
            epoch: epoch + 1,
            step,
            learning_rate: self.learning_rate(step.saturating_sub(1)),
            train: Tally::of(&state.progress).summary(),
            test_attempts: test_attempts.summary(),
            test_scenes: test_scenes.summary(),
            split_by: self.config.split.by,
            is_best: false,
            seconds: began.elapsed().as_secs_f64(),
        };
        let accuracy = report.test().accuracy;
        report.is_best = accuracy > best_accuracy_bits.map(f64::from_bits);
        let best_accuracy_bits = if report.is_best { accuracy.map(f64::to_bits) } else { best_accuracy_bits };
        state.progress = Progress { epoch: report.epoch, step, best_accuracy_bits, ..Progress::default() };
        Ok(Some(report))
    }

    /// The rest of the steps of an epoch, or those until a signal.
    fn train(&self, state: &mut Checkpoint) -> Result<(), Failure> {
        let Config { seed, augmentation, training: TrainingParams { batch, samples_per_scene, .. }, .. } = *self.config;
        let epoch = state.progress.epoch;
        let order = epoch_order(&self.split.train, |at| self.samples.record(at).scene, samples_per_scene, seed, epoch);
        let transform = TrainingTransform { seed, epoch, augmentation, weights: self.weights };
        let done = (state.progress.batch as usize * batch).min(order.len());
        let mut outcome = Ok(());
        for_each_batch(self.samples, &order[done..], batch, Some(&transform), |batch| {
            if self.is_stopped() {
                return ControlFlow::Break(());
            }
            outcome = self.step(state, &batch);
            if outcome.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        })?;
        outcome
    }

    fn step(&self, state: &mut Checkpoint, batch: &Batch) -> Result<(), Failure> {
        let result = self.model.step(&state.vector, batch, self.device);
        let samples = result.samples.len();
        let loss = result.samples.iter().map(|sample| f64::from(sample.total)).sum::<f64>() / samples as f64;
        let number = state.progress.step + 1;
        // Checked before the step, so that checkpoints never contain a diverged state.
        if !loss.is_finite() || !result.gradient.iter().map(|part| part.abs()).sum::<f32>().is_finite() {
            let what = "the loss or its gradient is no finite number at step";
            return Err(Failure::new(ExitCode::Config, format!("{what} {number}: training.learning_rate is too high")));
        }
        let learning_rate = self.learning_rate(state.progress.step);
        adam::step(&mut state.moments, learning_rate, &mut state.vector, &result.gradient);
        let mut tally = Tally::of(&state.progress);
        tally.add(&result.samples);
        tally.store(&mut state.progress);
        state.progress.batch += 1;
        state.progress.step = number;
        (self.observe)(Event::Step { step: number, samples, loss });
        let every = u64::from(self.config.checkpoint.every_steps);
        if every > 0 && number.is_multiple_of(every) { self.folder.save_last(state) } else { Ok(()) }
    }

    /// The results of a test set, or of a part of it if a signal stops it.
    fn test(&self, vector: &[f32], set: &[usize]) -> io::Result<Tally> {
        let mut tally = Tally::default();
        for_each_batch(self.samples, set, TEST_BATCH, None, |batch| {
            if self.is_stopped() {
                return ControlFlow::Break(());
            }
            tally.add(&self.model.evaluate(vector, &batch, self.device));
            ControlFlow::Continue(())
        })?;
        Ok(tally)
    }
}
