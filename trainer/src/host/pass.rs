//! One part of a batch, forwards and backwards.

use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;

use super::conv::{Conv, Side};
use super::doubling::Doubling;
use super::parameters::{HEAD_COLUMNS, HEADS, Parameters, STAGES};
use super::tile::LANES;
use crate::batch::{Batch, Looks};
use crate::layers::LAYERS;
use crate::loss::{Prediction, SampleLosses, Targets, sample_losses};
use crate::receptive_field::{COARSEST, PatchSizes, RESOLUTION};
use crate::step::{SampleResult, prediction_of, results};
use crate::upsampling::Upsampling;

/// A network, made ready for the parts of a batch.
pub(crate) struct Host {
    mode: Upsampling,
    sizes: PatchSizes,
    parameters: Parameters,
    /// Every stage but the heads.
    convs: [Conv; HEADS],
}

/// What the way back needs of the way there.
struct Activations {
    /// What each stage saw, as it saw it: grids or patches with their padding.
    inputs: [Vec<f32>; STAGES],
    doublings: Vec<[Doubling; 3]>,
    /// The heads' columns, `[samples, LANES]`.
    heads: Vec<f32>,
    /// What the three stages before a doubling gave. (The others gave the next one's inputs.)
    outputs: [Vec<f32>; 3],
}

impl Host {
    /// `vector` as [`crate::layers::parameter_slots`] lays it out.
    pub(crate) fn new(vector: &[f32], mode: Upsampling) -> Self {
        let sizes = PatchSizes::new(mode);
        let conv = |number: usize, n: usize, padding: usize, output_padding: usize| {
            Conv::new(LAYERS[number], Side { n, padding }, output_padding)
        };
        let convs = [
            conv(0, RESOLUTION, 2, 1),
            conv(1, 20, 1, 1),
            conv(2, 10, 1, 1),
            conv(3, COARSEST, 1, 0),
            conv(4, sizes.conv2_in, 0, 0),
            conv(5, sizes.conv3_in, 0, 0),
        ];
        Self { mode, sizes, parameters: Parameters::from_vector(vector), convs }
    }

    /// Gradient of the batch's mean loss, and what each sample gave.
    pub(crate) fn step(&self, batch: &Batch) -> (Vec<f32>, Vec<SampleResult>) {
        let mut parts = self.passes(batch).into_iter();
        let Some((mut sum, mut samples)) = parts.next() else {
            return (Parameters::zeros().to_vector(), Vec::new());
        };
        let (others, results): (Vec<Parameters>, Vec<Vec<SampleResult>>) = parts.unzip();
        let chunk = sum.values().len().div_ceil(64);
        sum.values_mut().par_chunks_mut(chunk).enumerate().for_each(|(number, sum)| {
            for other in &others {
                add(sum, &other.values()[number * chunk..][..sum.len()]);
            }
        });
        samples.extend(results.into_iter().flatten());
        (sum.to_vector(), samples)
    }

    /// What each part of a batch gives to [`Self::step`].
    fn passes(&self, batch: &Batch) -> Vec<(Parameters, Vec<SampleResult>)> {
        let weight = 1.0 / batch.samples.len() as f32;
        let transposed: Vec<Vec<f32>> = (0..STAGES)
            .into_par_iter()
            .map(|stage| if stage == 0 { Vec::new() } else { self.parameters.transposed(stage) })
            .collect();
        let pass = |part: &std::ops::Range<usize>| {
            let looks = batch.looks(part.clone());
            let seen = self.forward(&looks);
            let (prediction, losses, d_heads) = loss_gradient(&seen.heads, &looks, weight);
            (self.backward(&transposed, &looks, &seen, &d_heads), results(&looks, prediction, losses))
        };
        batch.parts().par_iter().map(pass).collect()
    }

    /// What each sample of a batch gives.
    pub(crate) fn evaluate(&self, batch: &Batch) -> Vec<SampleResult> {
        let parts = batch.parts();
        let evaluated = parts.par_iter().map(|part| {
            let looks = batch.looks(part.clone());
            let device = Device::flex();
            let prediction = prediction_of(&heads_tensor(&self.forward(&looks).heads, &device));
            let losses = sample_losses(&prediction, &Targets::new(&looks.targets, &device));
            results(&looks, prediction, losses)
        });
        evaluated.collect::<Vec<_>>().concat()
    }

    fn forward(&self, part: &Looks<'_>) -> Activations {
        let conv = |number: usize, inputs: &[f32]| {
            let (weights, bias) = self.parameters.stage(number);
            self.convs[number].forward(weights, bias, true, inputs)
        };
        // Grids, whole.
        let grids = padded_grids(&part.grids);
        let encoded_20 = conv(0, &grids);
        let encoded_10 = conv(1, &encoded_20);
        let encoded_5 = conv(2, &encoded_10);
        let coarse = conv(3, &encoded_5);

        // Patches, one a sample.
        let sides = [COARSEST, self.sizes.conv2_out, self.sizes.conv3_out];
        let doublings: Vec<[Doubling; 3]> =
            part.voxels.iter().map(|voxel| Doubling::around(*voxel, self.mode, sides)).collect();
        let coarse_len = coarse.len() / part.grids.len();
        let coarse_of_samples = part.grid_of_sample.iter().map(|grid| &coarse[grid * coarse_len..][..coarse_len]);
        let patches_10 = double_all(&doublings, 0, LAYERS[3].channels_out, coarse_of_samples);
        let decoded_10 = conv(4, &patches_10);
        let patches_20 = double_all(&doublings, 1, LAYERS[4].channels_out, patches(&decoded_10, part));
        let decoded_20 = conv(5, &patches_20);
        let patches_40 = double_all(&doublings, 2, LAYERS[5].channels_out, patches(&decoded_20, part));
        let (weights, bias) = self.parameters.stage(HEADS);
        let heads = heads_conv(part.voxels.len()).forward(weights, bias, false, &patches_40);
        Activations {
            inputs: [grids, encoded_20, encoded_10, encoded_5, patches_10, patches_20, patches_40],
            doublings,
            heads,
            outputs: [coarse, decoded_10, decoded_20],
        }
    }

    /// The gradient of every parameter. `d_heads` is that of the heads' columns.
    fn backward(&self, transposed: &[Vec<f32>], part: &Looks<'_>, seen: &Activations, d_heads: &[f32]) -> Parameters {
        let mut sum = Parameters::zeros();
        let mut through = |number: usize, conv: &Conv, gradients: &[f32]| {
            let (d_weights, d_bias) = sum.stage_mut(number);
            conv.add_parameters(&seen.inputs[number], gradients, d_weights, d_bias);
            if number == 0 { Vec::new() } else { conv.d_inputs(&transposed[number], gradients) }
        };
        let halved = |level: usize, channels: usize, d_patches: &[f32]| -> Vec<f32> {
            let halved = patches(d_patches, part).zip(&seen.doublings).map(|(d, by)| by[level].halve(channels, d));
            halved.collect::<Vec<_>>().concat()
        };
        let masked = |number: usize, outputs: &[f32], d: &[f32]| self.convs[number].through_relu(outputs, d);
        let [coarse, decoded_10, decoded_20] = &seen.outputs;

        let d_patches = through(HEADS, &heads_conv(part.voxels.len()), d_heads);
        let d = halved(2, LAYERS[5].channels_out, &d_patches);
        let d_patches = through(5, &self.convs[5], &masked(5, decoded_20, &d));
        let d = halved(1, LAYERS[4].channels_out, &d_patches);
        let d_patches = through(4, &self.convs[4], &masked(4, decoded_10, &d));
        let d = halved(0, LAYERS[3].channels_out, &d_patches);
        let mut d_coarse = vec![0.0; coarse.len()];
        let coarse_len = coarse.len() / part.grids.len();
        for (d, grid) in d.chunks_exact(coarse_len).zip(&part.grid_of_sample) {
            add(&mut d_coarse[grid * coarse_len..][..coarse_len], d);
        }
        let mut d = through(3, &self.convs[3], &masked(3, coarse, &d_coarse));
        for number in [2, 1, 0] {
            d = through(number, &self.convs[number], &masked(number, &seen.inputs[number + 1], &d));
        }
        sum
    }
}

/// The heads as a product of one row a sample.
fn heads_conv(samples: usize) -> Conv {
    Conv::of_rows(samples, LAYERS[HEADS].fan_in(), LANES)
}

/// The patches of a part's samples, one after the other.
fn patches<'a>(patches: &'a [f32], part: &Looks<'_>) -> impl Iterator<Item = &'a [f32]> {
    patches.chunks_exact(patches.len() / part.voxels.len())
}

fn double_all<'a>(
    doublings: &[[Doubling; 3]],
    level: usize,
    channels: usize,
    patches: impl Iterator<Item = &'a [f32]>,
) -> Vec<f32> {
    let doubled = doublings.iter().zip(patches).map(|(by, patch)| by[level].double(channels, patch));
    doubled.collect::<Vec<_>>().concat()
}

/// Grids with the zeros that the first convolution pads with.
pub(crate) fn padded_grids(grids: &[&[f32]]) -> Vec<f32> {
    let side = Side { n: RESOLUTION, padding: LAYERS[0].padding() };
    let len = side.whole().pow(3);
    let mut padded = vec![0.0; grids.len() * len];
    for (grid, padded) in grids.iter().zip(padded.chunks_exact_mut(len)) {
        for (line, values) in grid.chunks_exact(RESOLUTION).enumerate() {
            let place = side.place([line / RESOLUTION, line % RESOLUTION, 0]);
            padded[place..][..RESOLUTION].copy_from_slice(values);
        }
    }
    padded
}

/// The heads' used columns, `[samples, 6]`.
fn heads_tensor(heads: &[f32], device: &Device) -> Tensor<2> {
    let columns: Vec<f32> = heads.chunks_exact(LANES).flat_map(|row| row[..HEAD_COLUMNS].to_vec()).collect();
    Tensor::from_data(TensorData::new(columns, [heads.len() / LANES, HEAD_COLUMNS]), device)
}

/// The losses of a part and the gradient of `weight` times their sum at the heads' columns; by Burn, where the loss is
/// defined.
fn loss_gradient(heads: &[f32], part: &Looks<'_>, weight: f32) -> (Prediction, SampleLosses, Vec<f32>) {
    let device = Device::flex();
    let leaf = heads_tensor(heads, &device).autodiff().require_grad();
    let prediction = prediction_of(&leaf);
    let losses = sample_losses(&prediction, &Targets::new(&part.targets, &device));
    let mut gradients = (losses.total.clone().sum() * weight).backward();
    let gradient = leaf.grad_remove(&mut gradients).unwrap_or_else(|| leaf.zeros_like().inner());
    let mut d_heads = vec![0.0; heads.len()];
    for (number, value) in gradient.into_data().iter::<f32>().enumerate() {
        d_heads[number / HEAD_COLUMNS * LANES + number % HEAD_COLUMNS] = value;
    }
    (prediction, losses, d_heads)
}

fn add(sum: &mut [f32], more: &[f32]) {
    for (sum, more) in sum.iter_mut().zip(more) {
        *sum += more;
    }
}

#[cfg(test)]
mod tests {
    use schema::{Purpose, Quat, Stream};

    use super::*;
    use crate::batch::Sample;
    use crate::loss::Target;
    use crate::network::initial_vector;

    /// Five grids of noise with six samples each: three parts.
    fn batch() -> Batch {
        let mut draw = Stream::new(8, 0, Purpose::Views, 0);
        let grids = (0..5).map(|_| (0..RESOLUTION.pow(3)).map(|_| draw.uniform(0.0, 1.0)).collect::<Vec<f32>>().into());
        let grids = grids.collect();
        let sample = |at: usize| Sample {
            grid: at / 6,
            voxel: [draw.index(RESOLUTION), draw.index(RESOLUTION), draw.index(RESOLUTION)],
            target: Target {
                label: u8::from(at.is_multiple_of(2)),
                rotation: Quat::IDENTITY,
                width_voxels: 6.0,
                quality_weight: 1.0,
            },
        };
        Batch { grids, samples: (0..30).map(sample).collect() }
    }

    #[test]
    fn parts_of_a_step_add_up_to_it_to_the_bit() {
        let (batch, mode) = (batch(), Upsampling::Linear);
        let vector: Vec<f32> = initial_vector(3, &Device::flex()).into_data().iter().collect();
        let host = Host::new(&vector, mode);
        let (whole, whole_samples) = host.step(&batch);
        let parts = host.passes(&batch);
        assert!(parts.len() > 2, "{}", parts.len());
        let samples: Vec<_> = parts.iter().flat_map(|(_, samples)| samples.clone()).collect();
        assert_eq!(samples, whole_samples);
        let gradients = parts.into_iter().map(|(gradient, _)| gradient.to_vector());
        let sum = gradients.reduce(|a, b| a.iter().zip(&b).map(|(a, b)| a + b).collect()).unwrap();
        assert!(sum == whole);
    }
}
