//! The network at one voxel per sample, forward and backward, for training.

use crate::kernels::conv::{Conv, Extent, from_lanes, padded_grids, to_lanes};
use crate::kernels::doubling::Doubling;
use crate::kernels::parameters::{HEAD_COLUMNS, HEADS, Parameters, STAGES, VOXEL};
use crate::kernels::tile::LANES;
use crate::layers::LAYERS;
use crate::receptive_field::{COARSEST, PatchSizes, RESOLUTION};
use crate::upsampling::Upsampling;

/// Outputs of the heads at a voxel: logit of the grasp quality, quaternion xyzw before its normalisation, width in
/// voxels.
pub const HEAD_OUTPUTS: usize = HEAD_COLUMNS;

/// A network, prepared for evaluation at single voxels.
#[derive(Debug)]
pub struct VoxelNetwork {
    mode: Upsampling,
    sizes: PatchSizes,
    parameters: Parameters,
    /// All stages except the heads.
    convs: [Conv; HEADS],
}

/// Samples: grids, and the voxels at which the network is evaluated.
#[derive(Debug, Clone)]
pub struct VoxelInputs<'a> {
    /// TSDFs, 40³ values each, x slowest.
    pub grids: Vec<&'a [f32]>,
    /// For each sample the index of its grid.
    pub grid_of_sample: Vec<usize>,
    /// For each sample its voxel.
    pub voxels: Vec<[usize; 3]>,
}

/// The results of the forward pass that the backward pass needs.
#[derive(Debug)]
pub struct Activations {
    /// The input of each stage, with its padding: grids or patches.
    inputs: [Vec<f32>; STAGES],
    doublings: Vec<[Doubling; 3]>,
    /// The heads' columns, `[samples, LANES]`.
    heads: Vec<f32>,
    /// The output of the three stages before a doubling. (The others' outputs are the next stage's inputs.)
    outputs: [Vec<f32>; 3],
}

impl Activations {
    /// The heads' outputs of each sample.
    pub fn heads(&self) -> impl Iterator<Item = [f32; HEAD_OUTPUTS]> {
        from_lanes(&self.heads)
    }
}

/// The weights in the order of the backward pass.
#[derive(Debug)]
pub struct TransposedWeights(pub(crate) Vec<Vec<f32>>);

impl VoxelNetwork {
    /// `vector` as [`crate::layers::parameter_slots`] lays it out.
    ///
    /// # Panics
    /// If it has another length.
    #[must_use]
    pub fn new(vector: &[f32], mode: Upsampling) -> Self {
        let sizes = PatchSizes::new(mode);
        let conv = |number: usize, n: usize, padding: usize, output_padding: usize| {
            Conv::new(LAYERS[number], Extent::cube(n, padding), output_padding)
        };
        let convs = [
            conv(0, RESOLUTION, 2, 1),
            conv(1, 20, 1, 1),
            conv(2, 10, 1, 1),
            conv(3, COARSEST, 1, 0),
            conv(4, sizes.conv2_in, 0, 0),
            conv(5, sizes.conv3_in, 0, 0),
        ];
        Self { mode, sizes, parameters: Parameters::from_vector(&VOXEL, vector), convs }
    }

    /// The weights for [`Self::gradient`].
    #[must_use]
    pub fn transposed(&self) -> TransposedWeights {
        TransposedWeights(self.parameters.all_transposed())
    }

    /// The network at every sample's voxel.
    #[must_use]
    pub fn forward(&self, samples: &VoxelInputs<'_>) -> Activations {
        let conv = |number: usize, inputs: &[f32]| {
            let (weights, bias) = self.parameters.stage(number);
            self.convs[number].forward(weights, bias, true, inputs)
        };
        // Whole grids.
        let grids = padded_grids(&samples.grids);
        let encoded_20 = conv(0, &grids);
        let encoded_10 = conv(1, &encoded_20);
        let encoded_5 = conv(2, &encoded_10);
        let coarse = conv(3, &encoded_5);

        // Patches, one per sample.
        let sides = [COARSEST, self.sizes.conv2_out, self.sizes.conv3_out];
        let doublings: Vec<[Doubling; 3]> =
            samples.voxels.iter().map(|voxel| Doubling::around(*voxel, self.mode, sides)).collect();
        let coarse_len = coarse.len() / samples.grids.len();
        let coarse_of_samples = samples.grid_of_sample.iter().map(|grid| &coarse[grid * coarse_len..][..coarse_len]);
        let patches_10 = double_all(&doublings, 0, LAYERS[3].channels_out, coarse_of_samples);
        let decoded_10 = conv(4, &patches_10);
        let patches_20 = double_all(&doublings, 1, LAYERS[4].channels_out, patches(&decoded_10, samples));
        let decoded_20 = conv(5, &patches_20);
        let patches_40 = double_all(&doublings, 2, LAYERS[5].channels_out, patches(&decoded_20, samples));
        let (weights, bias) = self.parameters.stage(HEADS);
        let heads = heads_conv(samples.voxels.len()).forward(weights, bias, false, &patches_40);
        Activations {
            inputs: [grids, encoded_20, encoded_10, encoded_5, patches_10, patches_20, patches_40],
            doublings,
            heads,
            outputs: [coarse, decoded_10, decoded_20],
        }
    }

    /// The gradient of every parameter, as the flat vector. `d_heads` is the gradient of each sample's heads.
    #[must_use]
    pub fn gradient(
        &self,
        TransposedWeights(transposed): &TransposedWeights,
        samples: &VoxelInputs<'_>,
        seen: &Activations,
        d_heads: &[[f32; HEAD_OUTPUTS]],
    ) -> Vec<f32> {
        let mut sum = Parameters::zeros(&VOXEL);
        let mut through = |number: usize, conv: &Conv, gradients: &[f32]| {
            let (d_weights, d_bias) = sum.stage_mut(number);
            conv.add_parameters(&seen.inputs[number], gradients, d_weights, d_bias);
            if number == 0 { Vec::new() } else { conv.d_inputs(&transposed[number], gradients) }
        };
        let halved = |level: usize, channels: usize, d_patches: &[f32]| -> Vec<f32> {
            let halved = patches(d_patches, samples).zip(&seen.doublings).map(|(d, by)| by[level].halve(channels, d));
            halved.collect::<Vec<_>>().concat()
        };
        let masked = |number: usize, outputs: &[f32], d: &[f32]| self.convs[number].through_relu(outputs, d);
        let [coarse, decoded_10, decoded_20] = &seen.outputs;

        let d_patches = through(HEADS, &heads_conv(samples.voxels.len()), &to_lanes(d_heads));
        let d = halved(2, LAYERS[5].channels_out, &d_patches);
        let d_patches = through(5, &self.convs[5], &masked(5, decoded_20, &d));
        let d = halved(1, LAYERS[4].channels_out, &d_patches);
        let d_patches = through(4, &self.convs[4], &masked(4, decoded_10, &d));
        let d = halved(0, LAYERS[3].channels_out, &d_patches);
        let mut d_coarse = vec![0.0; coarse.len()];
        let coarse_len = coarse.len() / samples.grids.len();
        for (d, grid) in d.chunks_exact(coarse_len).zip(&samples.grid_of_sample) {
            for (sum, more) in d_coarse[grid * coarse_len..][..coarse_len].iter_mut().zip(d) {
                *sum += more;
            }
        }
        let mut d = through(3, &self.convs[3], &masked(3, coarse, &d_coarse));
        for number in [2, 1, 0] {
            d = through(number, &self.convs[number], &masked(number, &seen.inputs[number + 1], &d));
        }
        sum.to_vector()
    }
}

/// The heads as a product with one row per sample.
fn heads_conv(samples: usize) -> Conv {
    Conv::of_rows(samples, LAYERS[HEADS].fan_in(), LANES)
}

/// The patches of consecutive samples.
fn patches<'a>(patches: &'a [f32], samples: &VoxelInputs<'_>) -> impl Iterator<Item = &'a [f32]> {
    patches.chunks_exact(patches.len() / samples.voxels.len())
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
