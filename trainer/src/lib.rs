//! Training of the volumetric grasp network on Graspmill datasets: from shards to a checkpoint.
//!
//! # Map
//!
//! - The crate [`network`] has the networks, their kernels on the host and their checkpoints.
//! - [`voxel`] is all that only the paper's network needs: its samples, the training step at one voxel per sample, the
//!   loss (the paper's Eq. 1–5), augmentation, and behind cargo features the network in Burn (`voxel::graph`).
//! - [`judge`] is the same for a judge of grasps. [`method`] is what both answer; the rest is written once for it.
//! - [`data`] makes samples from shards, [`batch`] is some of them, [`split`] holds some out, [`order`] shuffles the
//!   rest.
//! - [`mod@fit`] is the training loop, [`adam`] its optimiser, [`schedule`] its step size, [`metrics`] its counts,
//!   [`events`] its progress reports, [`run_folder`] its files.
//! - [`mod@evaluate`] evaluates the result, [`scores`] its predicted qualities.
//!
//! # Determinism
//!
//! On the CPU, weights are a pure function of (code, dataset, configuration, machine's instruction set). A batch is cut
//! into parts by its contents only, each part is computed sequentially, and gradients are added in the order of parts.
//! So neither the number of threads nor stopping and resuming changes a bit. [`device`] lists the other devices; there
//! gradients are computed by autodiff.

pub mod adam;
pub mod batch;
pub mod config;
pub mod data;
pub mod device;
pub mod evaluate;
pub mod events;
pub mod fit;
#[cfg(any(test, fuzzing))]
pub mod fuzzing;
pub mod judge;
pub mod method;
pub mod metrics;
pub mod order;
pub mod results;
pub mod run_folder;
pub mod schedule;
pub mod scores;
pub mod split;
pub mod voxel;
