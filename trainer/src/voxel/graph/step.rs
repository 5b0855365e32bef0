//! The network at one voxel per sample with tensors: every convolution is a gather of rows and a matrix product, every
//! doubling a small matrix product along each axis.

use burn::tensor::activation::relu;
use burn::tensor::{Device, Int, Tensor};

use network::VoxelInputs;
use network::layers::{LAYERS, LayerShape};
use network::receptive_field::COARSEST;
use network::upsampling::Upsampling;

use super::columns::{first_columns, input_rows};
use super::doubling::{double_patches, doublings};
use super::loss::{Prediction, SampleLosses, Targets, normalise, sample_losses};
use super::{parameters, to_device};
use crate::results::{SampleResult, StepResult};
use crate::voxel::parts::BatchPart;

/// The gradient of `weight` times the losses of a part of a batch, by autodiff. Graphs without a common leaf have no
/// common lock, so each part copies the parameters and runs on its own thread.
pub(crate) fn part_step(
    vector: &[f32],
    part: &BatchPart<'_>,
    mode: Upsampling,
    weight: f32,
    device: &Device,
) -> StepResult {
    let vector = to_device(vector, device).autodiff().require_grad();
    let (prediction, losses) = part_losses(&vector, part, mode);
    let mut gradients = (losses.total.clone().sum() * weight).backward();
    let gradient = vector.grad_remove(&mut gradients).expect("every loss depends on the parameters");
    StepResult { gradient: to_host(gradient), samples: results(part, prediction, losses) }
}

/// Losses and predictions of a part of a batch.
pub(crate) fn part_results(
    vector: &[f32],
    part: &BatchPart<'_>,
    mode: Upsampling,
    device: &Device,
) -> Vec<SampleResult> {
    let (prediction, losses) = part_losses(&to_device(vector, device), part, mode);
    results(part, prediction, losses)
}

fn part_losses(vector: &Tensor<1>, part: &BatchPart<'_>, mode: Upsampling) -> (Prediction, SampleLosses) {
    let device = vector.device().inner();
    let prediction = predict(vector, &part.inputs, mode, &device);
    let losses = sample_losses(&prediction, &Targets::new(&part.targets, &device));
    (prediction, losses)
}

/// A layer with its weights as a matrix for products with gathered rows, `[x · y · z · in, out]`, and its bias.
type Layer = (LayerShape, Tensor<2>, Tensor<1>);

/// The network at one voxel per sample.
fn predict(vector: &Tensor<1>, inputs: &VoxelInputs<'_>, mode: Upsampling, device: &Device) -> Prediction {
    let layers: Vec<Layer> = LAYERS
        .into_iter()
        .zip(parameters(vector))
        .map(|(layer, (weight, bias))| {
            (layer, weight.permute([2, 3, 4, 1, 0]).reshape([layer.fan_in(), layer.channels_out]), bias)
        })
        .collect();
    let coarse = encode(&layers, &inputs.grids, device);
    let (samples, channels) = (inputs.voxels.len(), LAYERS[3].channels_out);
    let coarse = coarse.reshape([inputs.grids.len(), COARSEST.pow(3) * channels]);
    let coarse = if inputs.grids.len() == samples {
        coarse
    } else {
        let numbers: Vec<i64> = inputs.grid_of_sample.iter().map(|grid| *grid as i64).collect();
        coarse.select(0, Tensor::<1, Int>::from_data(numbers.as_slice(), device))
    };
    let [to_10, to_20, to_40] = doublings(&inputs.voxels, mode, device);
    let patches = coarse.reshape([samples, COARSEST, COARSEST, COARSEST, channels]);
    let patches = convolve_patches(&layers[4], double_patches(patches, to_10.each_ref()), device);
    let patches = convolve_patches(&layers[5], double_patches(patches, to_20.each_ref()), device);
    let patches = double_patches(patches, to_40.each_ref());
    // The three heads read the same rows of 5³ · 16 inputs, so they are one product.
    let weights = Tensor::cat(layers[6..].iter().map(|(_, weights, _)| weights.clone()).collect(), 1);
    let biases = Tensor::cat(layers[6..].iter().map(|(.., biases)| biases.clone()).collect(), 0);
    prediction_of(&(patches.reshape([samples, LAYERS[6].fan_in()]).matmul(weights) + biases.unsqueeze()))
}

/// Encoder and the first decoder convolution: `[grids · 5³, 64]`.
fn encode(layers: &[Layer], grids: &[&[f32]], device: &Device) -> Tensor<2> {
    let (_, weights, biases) = &layers[0];
    let mut x = relu(first_columns(grids, device).matmul(weights.clone()) + biases.clone().unsqueeze());
    for (layer, n) in layers[1..].iter().zip([20, 10, 5]) {
        let zero_row = Tensor::zeros([1, x.dims()[1]], device);
        let rows = input_rows(grids.len(), n, layer.0, layer.0.padding(), device);
        x = product(layer, Tensor::cat(vec![x, zero_row], 0), rows);
    }
    x
}

/// A convolution and its ReLU: gathers the rows of its inputs and multiplies.
fn product((layer, weights, biases): &Layer, x: Tensor<2>, rows: Tensor<1, Int>) -> Tensor<2> {
    let outputs = rows.dims()[0] / layer.kernel.pow(3);
    let gathered = gather(x, rows).reshape([outputs, layer.fan_in()]);
    relu(gathered.matmul(weights.clone()) + biases.clone().unsqueeze())
}

/// Maximum number of rows per gather. GPUs support at most 65,535 work groups per dimension, and gathering more rows
/// gave wrong gradients (Burn 0.22.1 on Vulkan) without an error.
const ROWS_MAX: usize = 32_768;

fn gather(x: Tensor<2>, rows: Tensor<1, Int>) -> Tensor<2> {
    let count = rows.dims()[0];
    if count <= ROWS_MAX {
        return x.select(0, rows);
    }
    let pieces = (0..count).step_by(ROWS_MAX).map(|start| {
        let end = (start + ROWS_MAX).min(count);
        x.clone().select(0, rows.clone().slice(start..end))
    });
    Tensor::cat(pieces.collect(), 0)
}

/// Shapes: `[b, n, n, n, in]` to `[b, m, m, m, out]`, without padding.
fn convolve_patches(layer: &Layer, patches: Tensor<5>, device: &Device) -> Tensor<5> {
    let [batch, n, _, _, channels] = patches.dims();
    let m = n + 1 - layer.0.kernel;
    let rows = input_rows(batch, n, layer.0, 0, device);
    product(layer, patches.reshape([batch * n.pow(3), channels]), rows).reshape([batch, m, m, m, layer.0.channels_out])
}

/// The prediction of the heads' six outputs, `[b, 6]`.
pub(super) fn prediction_of(out: &Tensor<2>) -> Prediction {
    let column = |at: usize| out.clone().slice([0..out.dims()[0], at..at + 1]).squeeze_dim::<1>(1);
    Prediction {
        quality_logit: column(0),
        rotation: normalise(out.clone().slice([0..out.dims()[0], 1..5]), 1),
        width_voxels: column(5),
    }
}

/// The results of the samples of a part.
fn results(part: &BatchPart<'_>, prediction: Prediction, losses: SampleLosses) -> Vec<SampleResult> {
    let (total, quality) = (to_host(losses.total.inner()), to_host(losses.quality.inner()));
    let (rotation, width) = (to_host(losses.rotation.inner()), to_host(losses.width.inner()));
    let logits = to_host(prediction.quality_logit.inner());
    let samples = part.targets.iter().enumerate();
    samples
        .map(|(at, target)| SampleResult {
            total: total[at],
            quality: quality[at],
            rotation: rotation[at],
            width: width[at],
            quality_logit: logits[at],
            label: target.label,
            robustness: None,
        })
        .collect()
}

fn to_host(vector: Tensor<1>) -> Vec<f32> {
    vector.into_data().iter::<f32>().collect()
}
