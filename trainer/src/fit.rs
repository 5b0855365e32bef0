//! Training, top to bottom: the paper's recipe (section 2.3).

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use network::checkpoint::{Checkpoint, Progress};
use network::head::Head;
use network::judge::Scope;
use network::{Architecture, VoxelParams};
use program::{ExitCode, Failure};
use schema::Gripper;
use shards::{Dataset, Location};

use crate::adam;
use crate::batch::Batch;
use crate::config::{self, Config, TrainingParams, VoxelConfig};
use crate::data::{GraspDataset, Set, for_each_batch};
use crate::device::Device;
use crate::events::{Beginning, EpochReport, Event};
use crate::judge::Judge;
use crate::method::{Epoch, Method};
use crate::metrics::Tally;
use crate::order::{SceneOrder, epoch_order, epoch_steps, steps_in_order};
use crate::run_folder::{RunFolder, id_of, read_metrics};
use crate::split::{LabelCount, Labels, split};
use crate::voxel::Voxel;

/// How training ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// After the last epoch.
    Done,
    /// Stopped by a signal; the checkpoint is written.
    Stopped,
}

/// Samples per batch in tests: larger, because there are no gradients.
pub(crate) const TEST_BATCH: usize = 192;

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
    let (architecture, dataset_id) = (architecture(config, &datasets, device)?, id_of(&datasets));
    let (vector, progress, moments) = match folder.last(&datasets)? {
        Some(last) => (last.vector, last.progress, last.moments),
        None => (first_vector(&architecture, config, from)?, Progress::default(), None),
    };
    folder.write_config(config)?;
    let state = Checkpoint { vector, architecture, config: config.to_toml(), dataset_id, progress, moments };
    observe(Event::Loading(&datasets));
    match &config.method {
        config::Method::Voxel(own) => {
            train(Voxel::in_training(own, device.clone()), state, job, &datasets, &folder, stop, observe)
        }
        config::Method::Judge => {
            let scope = state.architecture.scope("the recipe")?;
            train(Judge::new(scope, grippers_of(&datasets)), state, job, &datasets, &folder, stop, observe)
        }
    }
}

/// Trains by a method from a state on.
fn train<M: Method>(
    method: M,
    mut state: Checkpoint,
    Job { config, run, .. }: &Job<'_>,
    datasets: &[Dataset],
    folder: &RunFolder,
    stop: &AtomicBool,
    observe: &(dyn Fn(Event<'_>) + Sync),
) -> Result<Ending, Failure> {
    let (samples, labels) = match load(datasets, method, config, stop, &|| observe(Event::SceneLoaded)) {
        Err(_) if stop.load(Ordering::Relaxed) => return Ok(Ending::Stopped),
        loaded => loaded?,
    };
    let mut metrics: Vec<String> = read_metrics(run)?.lines().map(str::to_owned).collect();
    metrics.truncate(state.progress.epoch as usize);
    observe(Event::Begun(&Beginning { outside: samples.outside, labels, progress: state.progress }));
    let training = Training { config, folder, samples: &samples, stop, observe, train: labels.train };
    while state.progress.epoch < config.training.epochs {
        let report = match training.epoch(&mut state) {
            Ok(Some(report)) => report,
            stopped => {
                // A store that cannot be reached costs no step.
                folder.save_last(&state)?;
                return stopped.map(|_| Ending::Stopped);
            }
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
        let differs = [("grids", a.grid != b.grid), ("procedures", a.procedure != b.procedure)];
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

/// Surveys and splits the samples; reads their scenes too where these are few.
fn load<'a, M: Method>(
    datasets: &'a [Dataset],
    method: M,
    config: &Config,
    stop: &AtomicBool,
    scene_done: &(dyn Fn() + Sync),
) -> Result<(GraspDataset<'a, M>, Labels), Failure> {
    let scenes: u64 = datasets.iter().map(|dataset| dataset.info().scene_count).sum();
    let is_small = scenes <= config.training.shuffle_scenes as u64;
    let mut samples = GraspDataset::survey(datasets, method, stop, if is_small { &|| () } else { scene_done })?;
    let labels = split(&mut samples.marks, config.seed, &config.split)?;
    if is_small {
        samples.keep(stop, scene_done)?;
    }
    Ok((samples, labels))
}

/// The weights that a new run begins with.
fn first_vector(architecture: &Architecture, config: &Config, from: Option<&Checkpoint>) -> Result<Vec<f32>, Failure> {
    match from {
        None => Ok(architecture.initial_vector(config.seed)),
        Some(from) if can_begin_with(&from.architecture, architecture) => {
            // What the other did not learn, another head or the robustness, comes last.
            let mut vector = architecture.initial_vector(config.seed);
            let shared = architecture.shared_parameters(&from.architecture);
            vector[..shared].copy_from_slice(&from.vector[..shared]);
            Ok(vector)
        }
        Some(_) => Err(Failure::new(
            ExitCode::Config,
            "the weights of --from are another network's than the recipe's, or a judge's of another grid",
        )),
    }
}

/// Whether training may begin with another network's weights: a judge may come from other grippers, a network of voxels
/// from one with another head.
fn can_begin_with(from: &Architecture, own: &Architecture) -> bool {
    match (from, own) {
        (Architecture::Judge(from), Architecture::Judge(own)) => from.is_on(&own.grid),
        (Architecture::Voxel(from), Architecture::Voxel(own)) => VoxelParams { head: own.head, ..*from } == *own,
        _ => false,
    }
}

/// The network that a recipe asks for.
pub(crate) fn architecture(config: &Config, datasets: &[Dataset], device: &Device) -> Result<Architecture, Failure> {
    let grippers: Vec<Gripper> = grippers_of(datasets).cloned().collect();
    let info = datasets[0].info();
    let robustness = datasets.iter().any(|dataset| dataset.info().repeats_some());
    let scope = Scope::of(&grippers, info.procedure.pregrasp_distance_m, info.grid, robustness);
    match &config.method {
        config::Method::Voxel(_) if scope.grippers.is_some() => {
            let text = "the voxel network has no gripper input: train it on data of one gripper, or a judge on these";
            Err(Failure::new(ExitCode::Config, text))
        }
        config::Method::Voxel(VoxelConfig { network, .. })
            if network.head == Head::Closings && *device != Device::Host =>
        {
            Err(Failure::new(ExitCode::Config, "a head by closing is trained on the host: --device cpu"))
        }
        config::Method::Voxel(VoxelConfig { network, .. }) => Ok(Architecture::Voxel(network.params())),
        config::Method::Judge if *device != Device::Host => {
            Err(Failure::new(ExitCode::Config, "a judge is trained on the host: --device cpu"))
        }
        config::Method::Judge => Ok(Architecture::Judge(Box::new(scope))),
    }
}

/// The grippers of the first dataset, then those of the next.
pub(crate) fn grippers_of(datasets: &[Dataset]) -> impl Iterator<Item = &Gripper> {
    datasets.iter().flat_map(|dataset| dataset.info().grippers())
}

/// What stays the same during training.
struct Training<'a, M: Method> {
    config: &'a Config,
    folder: &'a RunFolder,
    samples: &'a GraspDataset<'a, M>,
    stop: &'a AtomicBool,
    observe: &'a (dyn Fn(Event<'_>) + Sync),
    train: LabelCount,
}

impl<M: Method> Training<'_, M> {
    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Adam's step size at a step, counted from 0 over all epochs.
    fn learning_rate(&self, step: u64) -> f64 {
        let TrainingParams { schedule, learning_rate, epochs, batch, .. } = self.config.training;
        let steps = u64::from(epochs) * self.train.samples.div_ceil(batch) as u64;
        schedule.learning_rate(learning_rate, step, steps)
    }

    /// The rest of an epoch and its tests; `None` if a signal stopped it.
    fn epoch(&self, state: &mut Checkpoint) -> Result<Option<EpochReport>, Failure> {
        let began = Instant::now();
        self.train(state)?;
        let [test_attempts, test_scenes] = self.test(&state.vector)?;
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
        let (epoch, marks) = (state.progress.epoch, &self.samples.marks);
        let order = epoch_order(marks, self.config, epoch);
        let mut steps = epoch_steps(marks, &order, self.config, epoch);
        let start = steps.by_ref().take(state.progress.batch as usize).last().map_or(0, |last| last.done);
        let epoch = Epoch { seed: self.config.seed, number: epoch, train: self.train };
        let mut outcome = Ok(());
        for_each_batch(self.samples, &order, start, steps, Some(&epoch), |_, batch| {
            if self.is_stopped() {
                return ControlFlow::Break(());
            }
            outcome = self.step(state, &batch);
            if outcome.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        })?;
        outcome
    }

    fn step(&self, state: &mut Checkpoint, batch: &Batch<M::Data>) -> Result<(), Failure> {
        // Of averaged weights the steps go on from their own.
        let own = state.moments.as_ref().and_then(|moments| moments.point.as_ref());
        let result = self.samples.method.step(own.unwrap_or(&state.vector), batch);
        let samples = result.samples.len();
        let loss = result.samples.iter().map(|sample| f64::from(sample.total)).sum::<f64>() / samples as f64;
        let number = state.progress.step + 1;
        // Checked before the step, so that checkpoints never contain a diverged state.
        if !loss.is_finite() || !result.gradient.iter().map(|part| part.abs()).sum::<f32>().is_finite() {
            let what = "the loss or its gradient is not finite at step";
            return Err(Failure::new(ExitCode::Config, format!("{what} {number}: training.learning_rate is too high")));
        }
        let learning_rate = self.learning_rate(state.progress.step);
        match self.config.training.average_decay {
            0.0 => adam::step(&mut state.moments, learning_rate, &mut state.vector, &result.gradient),
            decay => {
                adam::averaged_step(&mut state.moments, learning_rate, decay, &mut state.vector, &result.gradient);
            }
        }
        let mut tally = Tally::of(&state.progress);
        tally.add(&result.samples);
        tally.store(&mut state.progress);
        state.progress.batch += 1;
        state.progress.step = number;
        (self.observe)(Event::Step { samples, loss });
        let every = u64::from(self.config.checkpoint.every_steps);
        if every > 0 && number.is_multiple_of(every) { self.folder.save_last(state) } else { Ok(()) }
    }

    /// The results of held-out attempts and of held-out scenes, or of a part of them if a signal stops it.
    fn test(&self, vector: &[f32]) -> Result<[Tally; 2], Failure> {
        let marks = &self.samples.marks;
        let set_of = |mark: u8| [Set::TestAttempts as u8, Set::TestScenes as u8].iter().position(|set| *set == mark);
        let order = SceneOrder::ascending(marks, |mark| set_of(mark).is_some());
        let mut tallies = [Tally::default(); 2];
        let steps = steps_in_order(marks, &order, TEST_BATCH, set_of);
        for_each_batch(self.samples, &order, 0, steps, None, |set, batch| {
            if self.is_stopped() {
                return ControlFlow::Break(());
            }
            tallies[set].add(&self.samples.method.evaluate(vector, &batch));
            ControlFlow::Continue(())
        })?;
        Ok(tallies)
    }
}
