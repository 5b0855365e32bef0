//! The network at one voxel per sample with tensors: every convolution is a gather of rows and a matrix product, every
//! doubling a small matrix product along each axis.

use burn::tensor::activation::relu;
use burn::tensor::{Device, Int, Tensor};
use rayon::prelude::*;

use network::layers::LAYERS;
use network::receptive_field::{COARSEST, PatchSizes};
use network::upsampling::Upsampling;

use super::columns::{FIRST_ROWS, first_columns, padded_rows, valid_rows};
use super::doubling::{double_patches, doublings};
use super::loss::{Prediction, SampleLosses, Targets, normalise, sample_losses};
use super::matrices::Matrices;
use super::{to_device, to_host};
use crate::batch::{Batch, BatchPart};
use crate::loss::SampleResult;
use crate::step::StepResult;

/// Like [`crate::step::step`], with gradients by autodiff.
#[must_use]
pub fn step_by_graph(vector: &[f32], batch: &Batch, mode: Upsampling, device: &Device) -> StepResult {
    let matrices = Matrices::from_vector(&to_device(vector, device));
    let weight = 1.0 / batch.samples.len() as f32;
    let parts = batch.parts();
    let parts = parts.par_iter().map(|part| part_by_graph(&matrices, &batch.part(part.clone()), mode, weight));
    let (mut sum, mut samples) = (None, Vec::with_capacity(batch.samples.len()));
    for (gradient, results) in parts.collect::<Vec<_>>() {
        samples.extend(results);
        sum = Some(match sum {
            None => gradient,
            Some(before) => add(before, gradient),
        });
    }
    let gradient = sum.map_or_else(|| vec![0.0; vector.len()], |sum| to_host(sum.into_vector()));
    StepResult { gradient, samples }
}

/// Like [`crate::step::evaluate`].
#[must_use]
pub fn evaluate_by_graph(vector: &[f32], batch: &Batch, mode: Upsampling, device: &Device) -> Vec<SampleResult> {
    let matrices = Matrices::from_vector(&to_device(vector, device));
    let parts = batch.parts();
    let evaluated = parts.par_iter().map(|part| {
        let part = batch.part(part.clone());
        let (prediction, losses) = part_losses(&matrices, &part, mode);
        results(&part, prediction, losses)
    });
    evaluated.collect::<Vec<_>>().concat()
}

fn part_by_graph(
    matrices: &Matrices,
    part: &BatchPart<'_>,
    mode: Upsampling,
    weight: f32,
) -> (Matrices, Vec<SampleResult>) {
    let leaves = matrices.leaves();
    let (prediction, losses) = part_losses(&leaves, part, mode);
    let mut gradients = (losses.total.clone().sum() * weight).backward();
    let gradient = Matrices {
        weights: leaves
            .weights
            .iter()
            .map(|w| w.grad_remove(&mut gradients).unwrap_or_else(|| w.zeros_like().inner()))
            .collect(),
        biases: leaves
            .biases
            .iter()
            .map(|b| b.grad_remove(&mut gradients).unwrap_or_else(|| b.zeros_like().inner()))
            .collect(),
    };
    (gradient, results(part, prediction, losses))
}

fn add(a: Matrices, b: Matrices) -> Matrices {
    Matrices {
        weights: a.weights.into_iter().zip(b.weights).map(|(a, b)| a + b).collect(),
        biases: a.biases.into_iter().zip(b.biases).map(|(a, b)| a + b).collect(),
    }
}

fn part_losses(matrices: &Matrices, part: &BatchPart<'_>, mode: Upsampling) -> (Prediction, SampleLosses) {
    let device = matrices.biases[0].device().inner();
    let inputs = &part.inputs;
    let prediction = predict(matrices, &inputs.grids, &inputs.grid_of_sample, &inputs.voxels, mode, &device);
    let losses = sample_losses(&prediction, &Targets::new(&part.targets, &device));
    (prediction, losses)
}

/// The network at one voxel per sample.
///
/// `grids` have 40³ values each; sample i uses grid `grid_of_sample[i]` and voxel `voxels[i]`.
#[must_use]
pub fn predict(
    matrices: &Matrices,
    grids: &[&[f32]],
    grid_of_sample: &[usize],
    voxels: &[[usize; 3]],
    mode: Upsampling,
    device: &Device,
) -> Prediction {
    let coarse = encode(matrices, grids, device);
    let (samples, sizes) = (voxels.len(), PatchSizes::new(mode));
    let coarse = coarse.reshape([grids.len(), COARSEST.pow(3) * 64]);
    let coarse = if grids.len() == samples {
        coarse
    } else {
        let numbers: Vec<i64> = grid_of_sample.iter().map(|grid| *grid as i64).collect();
        coarse.select(0, Tensor::<1, Int>::from_data(numbers.as_slice(), device))
    };
    let [x, y, z] = doublings(voxels, mode, device);
    let patches = coarse.reshape([samples, COARSEST, COARSEST, COARSEST, 64]);
    let patches = double_patches(patches, [x.to_10, y.to_10, z.to_10]);
    let patches = convolve_patches(matrices, 4, patches, sizes.conv2_out, device);
    let patches = double_patches(patches, [x.to_20, y.to_20, z.to_20]);
    let patches = convolve_patches(matrices, 5, patches, sizes.conv3_out, device);
    let patches = double_patches(patches, [x.to_40, y.to_40, z.to_40]);
    heads(matrices, patches.reshape([samples, LAYERS[6].fan_in()]))
}

/// Encoder and the first decoder convolution: `[grids · 5³, 64]`.
fn encode(matrices: &Matrices, grids: &[&[f32]], device: &Device) -> Tensor<2> {
    let count = grids.len();
    let first = Tensor::cat(vec![matrices.weights[0].clone(), matrices.biases[0].clone().unsqueeze()], 0);
    // [count · 20³ + 1, 16], the last row zero.
    let x = relu(first_columns(grids, device).matmul(first));
    debug_assert_eq!(x.dims()[0], count * FIRST_ROWS + 1);
    let x = product(matrices, 1, x, padded_rows(count, 20, 3, 2, device));
    let x = product(matrices, 2, with_zero_row(x), padded_rows(count, 10, 3, 2, device));
    product(matrices, 3, with_zero_row(x), padded_rows(count, 5, 3, 1, device))
}

fn with_zero_row(x: Tensor<2>) -> Tensor<2> {
    let zero = Tensor::zeros([1, x.dims()[1]], &x.device().inner());
    Tensor::cat(vec![x, zero], 0)
}

/// A convolution and its ReLU: gathers the rows of its inputs and multiplies.
fn product(matrices: &Matrices, layer: usize, x: Tensor<2>, rows: Tensor<1, Int>) -> Tensor<2> {
    let fan_in = LAYERS[layer].fan_in();
    let outputs = rows.dims()[0] * LAYERS[layer].channels_in / fan_in;
    let gathered = gather(x, rows).reshape([outputs, fan_in]);
    relu(gathered.matmul(matrices.weights[layer].clone()) + matrices.biases[layer].clone().unsqueeze())
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

/// Shapes: `[b, n, n, n, in]` to `[b, m, m, m, out]`.
fn convolve_patches(matrices: &Matrices, layer: usize, patches: Tensor<5>, m: usize, device: &Device) -> Tensor<5> {
    let [batch, n, _, _, channels] = patches.dims();
    let rows = valid_rows(batch, n, LAYERS[layer].kernel, device);
    let x = product(matrices, layer, patches.reshape([batch * n.pow(3), channels]), rows);
    x.reshape([batch, m, m, m, LAYERS[layer].channels_out])
}

/// The three heads on rows of 5³ · 16 inputs.
fn heads(matrices: &Matrices, rows: Tensor<2>) -> Prediction {
    let weights = Tensor::cat(matrices.weights[6..].to_vec(), 1);
    let biases = Tensor::cat(matrices.biases[6..].to_vec(), 0);
    prediction_of(&(rows.matmul(weights) + biases.unsqueeze()))
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
    let values = |tensor: Tensor<1>| tensor.inner().into_data().iter::<f32>().collect::<Vec<_>>();
    let (total, quality) = (values(losses.total), values(losses.quality));
    let (rotation, width) = (values(losses.rotation), values(losses.width));
    let logits = values(prediction.quality_logit);
    let samples = part.targets.iter().enumerate();
    samples
        .map(|(at, target)| SampleResult {
            total: total[at],
            quality: quality[at],
            rotation: rotation[at],
            width: width[at],
            quality_logit: logits[at],
            label: target.label,
        })
        .collect()
}
