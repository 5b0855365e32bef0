//! What training costs on this machine.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use network::DenseNetwork;
use network::judge::Crop;
use network::layers::{LAYERS, initial_vector};
use network::receptive_field::{PatchSizes, RESOLUTION};
use network::upsampling::Upsampling;
use program::{Failure, peak_memory_bytes};
use report::document::{Block, Cell, Document, Table};
use schema::{Grid, Gripper, Outcome, Pose, Purpose, Quat, Stream, Vec3};
use serde::Serialize;
use shards::{Dataset, Location};

use crate::batch::{Batch, Hand, Sample};
use crate::config::{Config, JUDGE, PAPER};
use crate::data::{GraspDataset, Seen, for_each_batch};
use crate::device::Device;
use crate::fit::{architecture, hands_of};
use crate::judge;
use crate::loss::{Closings, Target};
use crate::model::Model;
use crate::order::{epoch_steps, epoch_tour};
use crate::split::split;
use crate::step::{evaluate, step};

/// Times everything is done; the median counts.
const TIMES: usize = 9;

/// Everything that was measured; times in seconds, medians.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchReport {
    /// This program's version.
    pub version: &'static str,
    /// The profile that it was built with: `dev`, which tests use, or `release`.
    pub profile: &'static str,
    /// Samples of a batch of the paper's network.
    pub batch: usize,
    /// Threads.
    pub threads: usize,
    /// Burn's products of `f32` matrices, in multiply-adds a second; like all that is measured by Burn `None` if the
    /// program was built without its backend for the device (for the host: cargo feature `flex`).
    pub matmul_mac_per_s: Option<f64>,
    /// Multiply-adds of a training step in which every sample has its own scene.
    pub step_mac: f64,
    /// A training step, every sample of another scene.
    pub step_s: f64,
    /// A training step, six samples a scene.
    pub step_of_few_scenes_s: f64,
    /// A training step by autodiff, every sample of another scene.
    pub step_by_graph_s: Option<f64>,
    /// A step without a gradient.
    pub test_s: f64,
    /// The dense network for inference on one grid.
    pub dense_s: f64,
    /// The same on one thread.
    pub dense_one_thread_s: f64,
    /// The dense network by Burn's convolutions.
    pub dense_by_graph_s: Option<f64>,
    /// Reading, without training: `None` without a dataset.
    pub reading: Option<Reading>,
    /// What training a judge costs.
    pub judge: JudgeReport,
    /// The most memory the process has held for the training steps, in bytes, where the system tells.
    pub memory_bytes: Option<u64>,
}

/// What training a judge costs by its recipe, `configs/train/judge.toml`; times in seconds, medians.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JudgeReport {
    /// Hands of a batch.
    pub batch: usize,
    /// Of which so many are in the same scene.
    pub samples_per_scene: usize,
    /// A training step.
    pub step_s: f64,
    /// A step without a gradient.
    pub test_s: f64,
    /// Reading the dataset once, without training: `None` without a dataset.
    pub reading: Option<Reading>,
}

/// Reading in a recipe's order; in that of the paper every sample is of another scene as far as there are scenes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reading {
    /// Attempts in the data.
    pub attempts: u64,
    /// Time to look at every attempt once, before the first epoch.
    pub survey_s: f64,
    /// Batches that were read: an epoch, or as many as there are in four windows of scenes.
    pub batches: u32,
    /// Reading a batch; the first window, which has to be filled, counts.
    pub batch_s: f64,
    /// The most memory the process has held, in bytes, where the system tells.
    pub memory_bytes: Option<u64>,
}

impl BenchReport {
    /// The measurements for people.
    #[must_use]
    pub fn document(&self) -> Document {
        let row = |name: &str, seconds: f64, has_rate: bool| self.row(name, self.batch, seconds, has_rate);
        let mut rows = vec![
            row("training step, each sample of another scene", self.step_s, true),
            row("training step, six samples a scene", self.step_of_few_scenes_s, false),
        ];
        rows.extend(self.step_by_graph_s.map(|s| row("the same as the first, by Burn's autodiff", s, true)));
        rows.push(row("test step, each sample of another scene", self.test_s, false));
        rows.extend(self.reading.as_ref().map(|reading| row("reading alone", reading.batch_s, false)));
        let judge = &self.judge;
        let row = |name: &str, seconds: f64| self.row(&format!("judge: {name}"), judge.batch, seconds, false);
        rows.push(row(&format!("training step, {} hands a scene", judge.samples_per_scene), judge.step_s));
        rows.push(row("test step", judge.test_s));
        rows.extend(judge.reading.as_ref().map(|reading| row("reading alone", reading.batch_s)));
        let head = ["", "batch", "ms", "samples/s", "GMAC/s", "of the products' rate"];
        let products = |rate: f64| format!("; products of matrices: {:.1} GMAC/s", rate / 1e9);
        let by_burn = |seconds: f64| format!(", {:.1} ms by Burn's convolutions", 1e3 * seconds);
        let bytes = |bytes: Option<u64>| bytes.map_or("unknown".to_owned(), program::text::bytes);
        let reading = |network: &str, reading: Option<&Reading>| {
            reading.map_or_else(String::new, |Reading { attempts, survey_s, batches, memory_bytes, .. }| {
                format!(
                    "\nFor {network} {} attempts were looked at in {survey_s:.1} s, and {} batches read. Memory at most {}.",
                    program::text::grouped(*attempts),
                    program::text::grouped(u64::from(*batches)),
                    bytes(*memory_bytes)
                )
            })
        };
        let blocks = vec![
            Block::Text(format!(
                "graspmill {}, {} build, {} threads{}.",
                self.version,
                self.profile,
                self.threads,
                self.matmul_mac_per_s.map(products).unwrap_or_default()
            )),
            Block::Table(Table::new(head, rows)),
            Block::Text(format!(
                "Dense network, one grid: {:.1} ms ({:.1} ms on one thread{}).\nMemory of the training steps at most {}.{}{}",
                1e3 * self.dense_s,
                1e3 * self.dense_one_thread_s,
                self.dense_by_graph_s.map(by_burn).unwrap_or_default(),
                bytes(self.memory_bytes),
                reading("the paper's network", self.reading.as_ref()),
                reading("a judge", judge.reading.as_ref())
            )),
        ];
        Document { blocks, ..Document::default() }
    }

    /// What a batch takes, and its rate of arithmetic if that of a training step is known.
    fn row(&self, name: &str, batch: usize, seconds: f64, has_rate: bool) -> Vec<Cell> {
        let mac_per_s = has_rate.then_some(self.step_mac / seconds);
        let share =
            mac_per_s.zip(self.matmul_mac_per_s).map(|(mac, products)| format!("{:.0} %", 100.0 * mac / products));
        vec![
            name.into(),
            Cell::Number(batch.to_string()),
            Cell::Number(format!("{:.1}", 1e3 * seconds)),
            Cell::Number(format!("{:.0}", batch as f64 / seconds)),
            Cell::Number(mac_per_s.map(|mac| format!("{:.1}", mac / 1e9)).unwrap_or_default()),
            Cell::Number(share.unwrap_or_default()),
        ]
    }
}

/// Measures at the given batch size on a device; with a dataset, as if it were there so many times, also how fast
/// batches are read.
///
/// # Errors
/// If the dataset cannot be read.
pub fn bench(
    samples: usize,
    data: Option<(&Location, usize)>,
    device: &Device,
    on_phase: &dyn Fn(&str),
) -> Result<BenchReport, Failure> {
    let mode = Upsampling::Linear;
    let vector = initial_vector(1);
    on_phase("training steps");
    let (many, few) = (batch(samples, samples), batch(samples, samples.div_ceil(6)));
    let step_s = median_s(|| drop(step(&vector, &many, mode, device)));
    let step_of_few_scenes_s = median_s(|| drop(step(&vector, &few, mode, device)));
    let test_s = median_s(|| drop(evaluate(&vector, &many, mode, device)));
    let memory_bytes = peak_memory_bytes();
    on_phase("the dense network");
    let grid = &many.grids[0];
    let dense = DenseNetwork::new(&vector, mode);
    let dense_s = median_s(|| drop(dense.infer(grid)));
    // Where the system gives no thread more, this one has to do.
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let infer = || median_s(|| drop(dense.infer(grid)));
    let dense_one_thread_s = alone.map_or_else(|_| infer(), |alone| alone.install(infer));
    on_phase("the same by Burn");
    let [matmul_mac_per_s, step_by_graph_s, dense_by_graph_s] = by_burn(&vector, &many, mode, device);
    on_phase("the judge");
    let recipe = Config::parse(JUDGE, Path::new("configs/train/judge.toml"))?;
    let mut judge = judge_steps(&recipe)?;
    on_phase("reading");
    let mut reading = None;
    if let Some((data, times)) = data {
        let mut paper = Config::parse(PAPER, Path::new("configs/train/paper.toml"))?;
        paper.training.batch = samples;
        let datasets = (0..times).map(|_| Dataset::open(data)).collect::<Result<Vec<_>, _>>()?;
        reading = Some(read(&datasets, Model::Voxel(paper.network.voxel()).seen(paper.training.targets), &paper)?);
        // Once: a judge has a crop in memory for every hand of every dataset.
        let dataset = &datasets[..1];
        let model = Model::of(&architecture(&recipe, dataset, &Device::Host)?, hands_of(dataset));
        judge.reading = Some(read(dataset, model.seen(recipe.training.targets), &recipe)?);
    }
    Ok(BenchReport {
        version: env!("CARGO_PKG_VERSION"),
        profile: if cfg!(debug_assertions) { "dev" } else { "release" },
        batch: samples,
        threads: rayon::current_num_threads(),
        matmul_mac_per_s,
        step_mac: samples as f64 * training_mac(mode),
        step_s,
        step_of_few_scenes_s,
        step_by_graph_s,
        test_s,
        dense_s,
        dense_one_thread_s,
        dense_by_graph_s,
        reading,
        judge,
        memory_bytes,
    })
}

/// Multiply-adds of the matrix products of one sample with a scene of its own: forwards, and twice as many backwards.
/// The first layer's inputs need no gradient.
fn training_mac(mode: Upsampling) -> f64 {
    let sizes = PatchSizes::new(mode);
    let sides = [20, 10, 5, 5, sizes.conv2_out, sizes.conv3_out, 1, 1, 1];
    let macs = LAYERS.iter().zip(sides).map(|(layer, side)| (side.pow(3) * layer.weight_count()) as f64);
    macs.enumerate().map(|(number, mac)| if number == 0 { 2.0 * mac } else { 3.0 * mac }).sum()
}

/// Samples in noise, from so many scenes.
fn batch(samples: usize, scenes: usize) -> Batch {
    let mut draw = Stream::new(0, 0, Purpose::Views, 0);
    let grids = (0..scenes).map(|_| (0..RESOLUTION.pow(3)).map(|_| draw.uniform(0.0, 1.0)).collect::<Vec<f32>>());
    let grids: Vec<Arc<[f32]>> = grids.map(Arc::from).collect();
    let samples = (0..samples).map(|at| Sample {
        grid: at * scenes / samples,
        voxel: [draw.index(RESOLUTION), draw.index(RESOLUTION), draw.index(RESOLUTION)],
        target: Target {
            label: (at % 4 == 0).into(),
            rotation: Quat::IDENTITY,
            width_voxels: 5.0,
            quality_weight: 1.0,
            closings: Closings::Half,
        },
    });
    Batch { samples: samples.collect(), grids, ..Batch::default() }
}

/// The judge's steps, on hands anywhere in noise, high enough to be asked about.
fn judge_steps(recipe: &Config) -> Result<JudgeReport, Failure> {
    let (samples, per_scene) = (recipe.training.batch, recipe.training.samples_per_scene.max(1));
    let crops = [Crop::new(&Gripper::from_toml(Gripper::BUILT_IN[0].1)?, 0.05, &Grid::PAPER)];
    let mut batch = batch(samples, samples.div_ceil(per_scene));
    let mut draw = Stream::new(1, 0, Purpose::Views, 0);
    let hand = |number: usize| Hand {
        crop: 0,
        workspace_from_grasp: Pose::from_parts(
            Vec3::new(draw.uniform(0.05, 0.25), draw.uniform(0.05, 0.25), 0.2),
            draw.rotation(),
        ),
        views: 6,
        mirrored: [false; 2],
        outcome: Outcome::ALL[number % Outcome::ALL.len()],
        hits_table: false,
    };
    batch.hands = (0..samples).map(hand).collect();
    let vector = network::judge::initial_vector(1);
    Ok(JudgeReport {
        batch: samples,
        samples_per_scene: per_scene,
        step_s: median_s(|| drop(judge::step(&vector, &batch, &crops))),
        test_s: median_s(|| drop(judge::evaluate(&vector, &batch, &crops))),
        reading: None,
    })
}

/// Windows of scenes that are read to measure reading.
const WINDOWS: usize = 4;

fn read(datasets: &[Dataset], seen: Seen<'_>, config: &Config) -> Result<Reading, Failure> {
    let began = Instant::now();
    let mut samples = GraspDataset::survey(datasets, seen, &AtomicBool::new(false), &|| {})?;
    let survey_s = began.elapsed().as_secs_f64();
    split(&mut samples.marks, config.seed, &config.split)?;
    let (attempts, scenes) = datasets
        .iter()
        .map(Dataset::info)
        .fold((0, 0), |(attempts, scenes), info| (attempts + info.attempt_count, scenes + info.scene_count));
    let scenes_read = (WINDOWS * config.training.shuffle_scenes) as u64;
    let batches_max =
        (attempts * scenes_read.min(scenes) / scenes.max(1)).div_ceil(config.training.batch as u64) as u32;
    let tour = epoch_tour(&samples.marks, config, 0);
    let steps = epoch_steps(&samples.marks, &tour, config, 0);
    let (began, mut batches) = (Instant::now(), 0);
    for_each_batch(&samples, (&tour, 0), steps, None, |_, _| {
        batches += 1;
        if batches == batches_max { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })?;
    let batch_s = began.elapsed().as_secs_f64() / f64::from(batches.max(1));
    Ok(Reading { attempts, survey_s, batches, batch_s, memory_bytes: peak_memory_bytes() })
}

/// Burn's products in multiply-adds a second, and its times of a step and of the dense network, if the program has its
/// backend for the device.
#[cfg(not(feature = "graph"))]
fn by_burn(_: &[f32], _: &Batch, _: Upsampling, _: &Device) -> [Option<f64>; 3] {
    [None; 3]
}

#[cfg(feature = "graph")]
fn by_burn(vector: &[f32], batch: &Batch, mode: Upsampling, device: &Device) -> [Option<f64>; 3] {
    use burn::tensor::{Tensor, TensorData};
    /// Side of the square matrices whose product gives the machine's rate.
    const MATRIX: usize = 1024;

    let device = &match device {
        #[cfg(feature = "flex")]
        Device::Host => burn::tensor::Device::flex(),
        #[cfg(not(feature = "flex"))]
        Device::Host => return [None; 3],
        Device::Burn(device) => device.clone(),
    };
    let square = || Tensor::<2>::from_data(TensorData::new(vec![0.5_f32; MATRIX * MATRIX], [MATRIX; 2]), device);
    let (a, b) = (square(), square());
    let product_s = median_s(|| drop(a.clone().matmul(b.clone()).into_data()));
    let step_s = median_s(|| drop(step(vector, batch, mode, &Device::Burn(device.clone()))));
    let parameters = crate::graph::to_device(vector, device);
    let dense_s = median_s(|| {
        let grid = TensorData::new(batch.grids[0].to_vec(), [1, 1, RESOLUTION, RESOLUTION, RESOLUTION]);
        drop(crate::graph::dense(&parameters, Tensor::from_data(grid, device), mode).quality_logit.into_data());
    });
    [(MATRIX as f64).powi(3) / product_s, step_s, dense_s].map(Some)
}

/// Median time of doing something, after doing it once.
fn median_s(mut work: impl FnMut()) -> f64 {
    work();
    let mut times: Vec<f64> = (0..TIMES)
        .map(|_| {
            let began = Instant::now();
            work();
            began.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[TIMES / 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand, linear: encoder 16.0, 13.824, 6.912, then 13.824, 11.943936, 4.096 and 0.012 million forwards.
    #[test]
    fn the_arithmetic_of_a_step_is_counted() {
        let forward = 13.824 + 6.912 + 13.824 + 11.943_936 + 4.096 + 0.012;
        assert!((training_mac(Upsampling::Linear) / 1e6 - (3.0 * forward + 2.0 * 16.0)).abs() < 1e-9);
    }
}
