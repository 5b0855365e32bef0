//! The volumetric grasp network (paper Fig. 1; VGN, `networks.py`): its layers, its products on the host, its files.
//!
//! # The map
//!
//! - [`layers`] is the network's shape as a table, and the flat vector of all parameters; [`upsampling`] its ×2 stages.
//! - [`DenseNetwork`] evaluates the whole volume, for inference. [`VoxelNetwork`] evaluates one voxel a sample and computes the
//!   gradient of every parameter, for training; [`receptive_field`] says which part of the decoder that voxel needs.
//! - [`checkpoint`] is the file of a network and of its training's state; [`interchange`] reads weights of other programs and writes
//!   weights for them.
//!
//! Parameters are a flat `[f32]` everywhere. The crate `trainer` has the same network written plainly with Burn; its tests hold the
//! products here against that one, and PyTorch's against both.

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
