//! One part of a batch, forwards and backwards.

use burn::tensor::{Device, Tensor, TensorData};

use super::cube::Cube;
use super::doubling::Doubling;
use crate::batch::Looks;
use crate::layers::LAYERS;
use crate::loss::{Prediction, SampleLosses, Targets, sample_losses};
use crate::matrices::Matrices;
use crate::receptive_field::{COARSEST, PatchSizes, RESOLUTION};
use crate::step::prediction_of;
use crate::upsampling::Upsampling;

/// Gathered rows and what came of them, kept for the way back.
struct Layer {
    cube: Cube,
    cubes: usize,
    rows: Tensor<2>,
    /// After ReLU, `[rows, channels out]`.
    output: Vec<f32>,
}

/// Gradient of `weight` times the sum of a part's losses, with the prediction and the losses.
pub(crate) fn part_gradient(
    matrices: &Matrices,
    part: &Looks<'_>,
    mode: Upsampling,
    weight: f32,
) -> (Matrices, Prediction, SampleLosses) {
    let device = matrices.biases[0].device();
    let sizes = PatchSizes::new(mode);
    let cube = |layer: usize, n: usize, padding: usize| Cube {
        n,
        channels: LAYERS[layer].channels_in,
        kernel: LAYERS[layer].kernel,
        stride: LAYERS[layer].stride,
        padding,
    };

    // Grids, whole.
    let grids = part.grids.concat();
    let encoder = [cube(0, RESOLUTION, 2), cube(1, 20, 1), cube(2, 10, 1), cube(3, COARSEST, 1)];
    let mut layers: Vec<Layer> = Vec::with_capacity(6);
    for (number, cube) in encoder.into_iter().enumerate() {
        let input = layers.last().map_or(&grids, |layer| &layer.output);
        let layer = forward(matrices, number, cube, input, &device);
        layers.push(layer);
    }

    // Patches, one a sample.
    let doublings: Vec<[Doubling; 3]> = part
        .voxels
        .iter()
        .map(|voxel| Doubling::around(*voxel, mode, [COARSEST, sizes.conv2_out, sizes.conv3_out]))
        .collect();
    let coarse_len = COARSEST.pow(3) * LAYERS[3].channels_out;
    let coarse = |sample: usize| &layers[3].output[part.grid_of_sample[sample] * coarse_len..][..coarse_len];
    let doubled: Vec<Vec<f32>> =
        doublings.iter().enumerate().map(|(s, d)| d[0].double(LAYERS[3].channels_out, coarse(s))).collect();
    let doubled = doubled.concat();
    let conv2 = forward(matrices, 4, cube(4, sizes.conv2_in, 0), &doubled, &device);
    let conv3_input = double_all(&doublings, 1, LAYERS[4].channels_out, &conv2.output);
    let conv3 = forward(matrices, 5, cube(5, sizes.conv3_in, 0), &conv3_input, &device);
    let heads_input = double_all(&doublings, 2, LAYERS[5].channels_out, &conv3.output);
    let heads_rows = matrix(heads_input, LAYERS[6].fan_in(), &device);

    // The heads and the loss, differentiated by Burn.
    let head_weights = Tensor::cat(matrices.weights[6..].to_vec(), 1);
    let head_biases = Tensor::cat(matrices.biases[6..].to_vec(), 0);
    let out = heads_rows.clone().matmul(head_weights.clone()) + head_biases.unsqueeze();
    let leaf = out.autodiff().require_grad();
    let prediction = prediction_of(&leaf);
    let losses = sample_losses(&prediction, &Targets::new(&part.targets, &device));
    let mut gradients = (losses.total.clone().sum() * weight).backward();
    let d_out = leaf.grad_remove(&mut gradients).unwrap_or_else(|| leaf.zeros_like().inner());

    // And back.
    let mut back = Backward { matrices, weights: vec![None; LAYERS.len()], biases: vec![None; LAYERS.len()] };
    let d_heads = heads_rows.transpose().matmul(d_out.clone());
    let d_head_biases = d_out.clone().sum_dim(0).squeeze_dim::<1>(0);
    for (number, column) in [(6, 0..1), (7, 1..5), (8, 5..6)] {
        back.weights[number] = Some(d_heads.clone().slice([0..d_heads.dims()[0], column.clone()]));
        back.biases[number] = Some(d_head_biases.clone().slice([column]));
    }
    let d_patches = values(d_out.matmul(head_weights.transpose()));
    let d_conv3 = halve_all(&doublings, 2, LAYERS[5].channels_out, &d_patches);
    let d_patches = back.through(5, &conv3, d_conv3, &device);
    let d_conv2 = halve_all(&doublings, 1, LAYERS[4].channels_out, &d_patches);
    let d_patches = back.through(4, &conv2, d_conv2, &device);
    let mut gradient = vec![0.0; part.grids.len() * coarse_len];
    let patch_len = d_patches.len() / part.voxels.len();
    for (sample, (d_patch, doubling)) in d_patches.chunks_exact(patch_len).zip(&doublings).enumerate() {
        let d_coarse = doubling[0].halve(LAYERS[3].channels_out, d_patch);
        add(&mut gradient[part.grid_of_sample[sample] * coarse_len..][..coarse_len], &d_coarse);
    }
    for number in [3, 2, 1] {
        gradient = back.through(number, &layers[number], gradient, &device);
    }
    back.parameters(0, &layers[0], gradient, &device);
    (back.into_matrices(), prediction, losses)
}

fn forward(matrices: &Matrices, number: usize, cube: Cube, input: &[f32], device: &Device) -> Layer {
    let rows = matrix(cube.gather(input), cube.row_len(), device);
    let mut output = values(rows.clone().matmul(matrices.weights[number].clone()));
    let bias = values(matrices.biases[number].clone());
    for row in output.chunks_exact_mut(bias.len()) {
        for (value, bias) in row.iter_mut().zip(&bias) {
            *value = (*value + bias).max(0.0);
        }
    }
    Layer { cube, cubes: input.len() / cube.len(), rows, output }
}

fn double_all(doublings: &[[Doubling; 3]], level: usize, channels: usize, patches: &[f32]) -> Vec<f32> {
    let patches = patches.chunks_exact(patches.len() / doublings.len());
    let doubled = patches.zip(doublings).map(|(patch, doubling)| doubling[level].double(channels, patch));
    doubled.collect::<Vec<_>>().concat()
}

fn halve_all(doublings: &[[Doubling; 3]], level: usize, channels: usize, patches: &[f32]) -> Vec<f32> {
    let patches = patches.chunks_exact(patches.len() / doublings.len());
    let halved = patches.zip(doublings).map(|(patch, doubling)| doubling[level].halve(channels, patch));
    halved.collect::<Vec<_>>().concat()
}

/// Gradients of the parameters, as far as the way back has come.
struct Backward<'a> {
    matrices: &'a Matrices,
    weights: Vec<Option<Tensor<2>>>,
    biases: Vec<Option<Tensor<1>>>,
}

impl Backward<'_> {
    /// From the gradient of a layer's output, after ReLU, to that of its input.
    fn through(&mut self, number: usize, layer: &Layer, gradient: Vec<f32>, device: &Device) -> Vec<f32> {
        let gradient = self.parameters(number, layer, gradient, device);
        let rows = values(gradient.matmul(self.matrices.weights[number].clone().transpose()));
        let mut input = vec![0.0; layer.cubes * layer.cube.len()];
        let rows_len = rows.len() / layer.cubes;
        for (rows, cube) in rows.chunks_exact(rows_len).zip(input.chunks_exact_mut(layer.cube.len())) {
            layer.cube.scatter(rows, cube);
        }
        input
    }

    /// The gradients of a layer's parameters; gives that of its output before ReLU, `[rows, channels out]`.
    fn parameters(&mut self, number: usize, layer: &Layer, mut gradient: Vec<f32>, device: &Device) -> Tensor<2> {
        for (gradient, output) in gradient.iter_mut().zip(&layer.output) {
            *gradient = if *output > 0.0 { *gradient } else { 0.0 };
        }
        let channels = LAYERS[number].channels_out;
        let mut bias = vec![0.0; channels];
        for row in gradient.chunks_exact(channels) {
            add(&mut bias, row);
        }
        let gradient = matrix(gradient, channels, device);
        self.biases[number] = Some(Tensor::from_data(TensorData::new(bias, [channels]), device));
        self.weights[number] = Some(layer.rows.clone().transpose().matmul(gradient.clone()));
        gradient
    }

    fn into_matrices(self) -> Matrices {
        let whole = "the way back passes every layer";
        Matrices {
            weights: self.weights.into_iter().map(|weight| weight.expect(whole)).collect(),
            biases: self.biases.into_iter().map(|bias| bias.expect(whole)).collect(),
        }
    }
}

fn add(sum: &mut [f32], more: &[f32]) {
    for (sum, more) in sum.iter_mut().zip(more) {
        *sum += more;
    }
}

/// A matrix of that many columns; takes the values over without a copy.
fn matrix(values: Vec<f32>, columns: usize, device: &Device) -> Tensor<2> {
    let rows = values.len() / columns;
    Tensor::from_data(TensorData::new(values, [rows, columns]), device)
}

/// The values of a tensor that nobody else holds, without a copy; in row-major order.
fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_into_vec().expect("parameters and activations are f32")
}
