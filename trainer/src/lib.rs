//! Training of the volumetric grasp network on Graspmill datasets: from shards to a checkpoint.
//!
//! # Map
//!
//! - The crate [`network`] has the network, its kernels on the host and its checkpoints. `graph`, behind cargo
//!   features, has the network in Burn: for other devices, and for comparison in tests.
//! - [`step`] is a training step: the network at one voxel per sample, and the [`loss`], the paper's Eq. 1–5. [`batch`]
//!   cuts a batch into parts that run on different threads.
//! - [`judge`] is the step of the other network, the judge of hands.
//! - [`data`] makes samples from shards, [`split`] holds some out, [`order`] shuffles the rest, [`augmentation`]
//!   rotates and shifts their scenes.
//! - [`mod@fit`] is the training loop, [`adam`] its optimiser, [`schedule`] its step size, [`patience`] its early
//!   stopping, [`metrics`] its counts, [`events`] its progress reports, [`run_folder`] its files,
//!   curves and TensorBoard events its monitoring.
//! - [`mod@evaluate`] evaluates the result, [`scores`] its predicted qualities, [`evaluate::report`] writes the report,
//!   and [`page`] shows a run and its result together.
//!
//! # Determinism
//!
//! On the CPU, weights are a pure function of (code, dataset, configuration, machine's instruction set). A batch is cut
//! into parts by its contents only, each part is computed sequentially, and gradients are added in the order of parts.
//! So neither the number of threads nor stopping and resuming changes a bit. [`device`] lists the other devices; there
//! gradients are computed by autodiff.

pub mod adam;
pub mod augmentation;
pub mod batch;
pub mod bench;
pub mod config;
mod curves;
pub mod data;
pub mod device;
pub mod evaluate;
pub mod events;
pub mod fit;
#[cfg(any(test, fuzzing))]
pub mod fuzzing;
#[cfg(feature = "graph")]
pub mod graph;
pub mod judge;
pub mod loss;
pub mod metrics;
pub mod model;
pub mod order;
pub mod page;
pub mod patience;
pub mod run_folder;
pub mod schedule;
pub mod scores;
pub mod split;
pub mod step;
mod tensorboard;
mod watch;
