//! Training of the volumetric grasp network on Graspmill datasets: from shards to a checkpoint.
//!
//! # The map
//!
//! - [`network`] is the network on the whole volume, as plainly as Burn lets one write it; [`layers`] its shape as a table;
//!   [`upsampling`] its ×2 stages; [`loss`] the paper's Eq. 1–5. [`DenseNetwork`] is the same for inference, quicker.
//! - [`step`] is the same function evaluated for training, at one voxel a sample: [`receptive_field`] says which part
//!   of the decoder that voxel needs, [`columns`] and [`matrices`] turn convolutions into products, [`batch`] cuts a
//!   batch into parts that run on different threads.
//! - [`data`] makes samples of shards, [`split`] holds some out, [`order`] shuffles the rest, [`augmentation`] turns and
//!   shifts their scenes.
//! - [`mod@fit`] is the recipe, [`adam`] its optimiser, [`schedule`] its step size, [`patience`] its early end, [`metrics`]
//!   what it counts, [`events`] what it tells, [`run_folder`], [`checkpoint`] and [`progress`] what it leaves behind, [`curves`] and TensorBoard's
//!   events what people watch meanwhile.
//! - [`mod@evaluate`] looks at the result, [`scores`] at its qualities, [`evaluate::report`] writes it down, [`page`] shows a run and
//!   its result together.
//! - [`interchange`] takes weights from other programs and gives them to others.
//!
//! # Determinism
//!
//! On the CPU, weights are a pure function of (code, dataset, configuration, machine's instruction set). A batch is cut
//! into parts by its contents alone, each part runs on one thread's worth of order, and gradients are added in the order
//! of parts; so neither the number of threads nor being stopped and resumed changes a bit.
//! [`device`] names what else can compute; there gradients are computed by automatic differentiation.

pub mod adam;
pub mod augmentation;
pub mod batch;
pub mod bench;
pub mod checkpoint;
pub mod columns;
pub mod config;
pub mod curves;
pub mod data;
pub mod device;
pub mod evaluate;
pub mod events;

pub mod fit;
#[cfg(any(test, fuzzing))]
pub mod fuzzing;
mod host;
pub mod interchange;
pub mod layers;
pub mod loss;
pub mod matrices;
pub mod metrics;
pub mod network;
pub mod order;
pub mod page;
pub mod patience;
pub mod progress;
pub mod receptive_field;
pub mod run_folder;
pub mod schedule;
pub mod scores;
pub mod split;
pub mod step;
mod tensorboard;
pub mod upsampling;
mod watch;

pub use host::{DenseGrids, DenseNetwork};
