//! The volumetric grasp network (paper Fig. 1; VGN, `networks.py`): its layers, its kernels on the host, its files.
//!
//! # Map
//!
//! - [`layers`] has the architecture as a table, and the flat vector of all parameters; [`upsampling`] has the ×2
//!   stages.
//! - [`DenseNetwork`] evaluates the whole volume, for inference. [`VoxelNetwork`] evaluates one voxel per sample and
//!   computes the gradient of every parameter, for training; [`receptive_field`] determines the part of the decoder
//!   that a voxel needs.
//! - [`checkpoint`] is the file format of a network and its training state; [`interchange`] reads and writes weights of
//!   other programs.
//!
//! Parameters are a flat `[f32]` everywhere. The crate `trainer` has the same network in plain form with Burn. Its
//! tests compare both implementations with each other and with PyTorch.

pub mod checkpoint;
mod dense;
pub mod interchange;
mod kernels;
pub mod layers;
pub mod receptive_field;
pub mod upsampling;
mod voxel;

pub use dense::{DenseGrids, DenseNetwork};
pub use voxel::{Activations, HEAD_OUTPUTS, VoxelInputs, VoxelNetwork};
