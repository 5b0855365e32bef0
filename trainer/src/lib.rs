//! Training of the volumetric grasp network on Graspmill datasets: from shards to a checkpoint.
//!
//! # The map
//!
//! - The crate [`network`] has the network, its products on the host and its checkpoints. `graph`, behind cargo features, has it
//!   again with Burn: for other devices, and for tests to compare with.
//! - [`step`] is a training step: the network at one voxel a sample, and the [`loss`], the paper's Eq. 1–5. [`batch`] cuts a batch
//!   into parts that run on different threads.
//! - [`data`] makes samples of shards, [`split`] holds some out, [`order`] shuffles the rest, [`augmentation`] turns and
//!   shifts their scenes.
//! - [`mod@fit`] is the recipe, [`adam`] its optimiser, [`schedule`] its step size, [`patience`] its early end, [`metrics`]
//!   what it counts, [`events`] what it reports, [`run_folder`] and [`progress`] what it leaves behind, [`curves`] and TensorBoard's
//!   events what people watch meanwhile.
//! - [`mod@evaluate`] looks at the result, [`scores`] at its qualities, [`evaluate::report`] writes it down, [`page`] shows a run and
//!   its result together.
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
pub mod config;
pub mod curves;
pub mod data;
pub mod device;
pub mod evaluate;
pub mod events;
pub mod fit;
#[cfg(any(test, fuzzing))]
pub mod fuzzing;
#[cfg(feature = "graph")]
pub mod graph;
pub mod loss;
pub mod metrics;
pub mod order;
pub mod page;
pub mod patience;
pub mod progress;
pub mod run_folder;
pub mod schedule;
pub mod scores;
pub mod split;
pub mod step;
mod tensorboard;
mod watch;
