//! The network in Burn: in plain form, for comparison with the kernels of the crate `network`, and at single voxels,
//! for devices other than the host. Gradients are computed by autodiff.
//!
//! Compiled with the cargo features `cuda`, `wgpu` and `flex` (Burn's backend for the host, which the tests use).

pub mod columns;
pub mod doubling;
pub mod loss;
pub mod matrices;
pub mod plain;
mod step;

pub use plain::{DenseOutput, Network};
pub use step::{evaluate_by_graph, predict, step_by_graph};

use burn::tensor::{Device, Tensor, TensorData};

/// A flat vector on a device.
#[must_use]
pub fn to_device(vector: &[f32], device: &Device) -> Tensor<1> {
    Tensor::from_data(TensorData::new(vector.to_vec(), [vector.len()]), device)
}

/// A flat vector from a device.
pub fn to_host(vector: Tensor<1>) -> Vec<f32> {
    vector.into_data().iter::<f32>().collect()
}
