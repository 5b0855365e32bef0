//! The networks: their layers, their kernels on the host, their files. One is the paper's volumetric grasp network
//! (Fig. 1; VGN, `networks.py`), which answers for every voxel; the other is the judge, which answers for a grasp.
//!
//! # Map
//!
//! - [`layers`] has the architecture as a table, and the flat vector of all parameters; [`upsampling`] has the ×2
//!   stages; [`head`] what a voxel answers.
//! - [`DenseNetwork`] evaluates the whole volume, for inference. [`VoxelNetwork`] evaluates one voxel per sample and
//!   computes the gradient of every parameter, for training; [`receptive_field`] determines the part of the decoder
//!   that a voxel needs.
//! - [`judge`] is the judge: what it sees of a grasp, its layers, its answers and their gradient.
//! - [`checkpoint`] is the file format of a network and its training state, which PyTorch reads, too.
//!
//! Parameters are a flat `[f32]` everywhere. The tests of the crate `trainer` have the same network in plain form with
//! Burn, and compare both implementations with each other and with PyTorch.

mod architecture;
pub mod checkpoint;
mod dense;
pub mod head;
pub mod judge;
mod kernels;
pub mod layers;
pub mod receptive_field;
pub mod upsampling;
mod voxel;

pub use architecture::{Architecture, BEHIND_TIPS_M_MAX, GraspOrigin, Kind, VoxelParams};
pub use dense::{DenseGrids, DenseNetwork};
pub use voxel::{Activations, TransposedWeights, VoxelInputs, VoxelNetwork};
