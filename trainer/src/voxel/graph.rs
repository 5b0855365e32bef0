//! The network in Burn at single voxels, for devices other than the host. Gradients are computed by autodiff.
//!
//! Compiled with the cargo features `wgpu` and `flex` (Burn's backend for the host, which the tests use).

pub mod columns;
pub mod doubling;
pub mod loss;
mod step;

pub(crate) use step::{part_results, part_step};

use burn::tensor::{Device, Tensor, TensorData};
use network::layers::{LAYERS, ParameterSlot, parameter_slots};

/// A flat vector on a device.
#[must_use]
pub fn to_device(vector: &[f32], device: &Device) -> Tensor<1> {
    Tensor::from_data(TensorData::new(vector.to_vec(), [vector.len()]), device)
}

/// The weight `[out, in, k, k, k]` and the bias `[out]` of each layer, cut from the flat vector of all parameters.
#[must_use]
pub fn parameters(vector: &Tensor<1>) -> Vec<(Tensor<5>, Tensor<1>)> {
    let slots = parameter_slots();
    let part = |slot: &ParameterSlot| vector.clone().slice(slot.start..slot.start + slot.len);
    let pairs = slots.as_chunks::<2>().0.iter().zip(LAYERS);
    pairs.map(|([weight, bias], layer)| (part(weight).reshape(layer.weight_shape()), part(bias))).collect()
}
