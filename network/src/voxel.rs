//! The network at one voxel per sample, forward and backward, for training.

use crate::head::Head;
use crate::kernels::conv::{Conv, Extent, from_lanes, padded_grids, to_lanes};
use crate::kernels::doubling::Doubling;
use crate::kernels::parameters::{HEADS, Parameters, STAGES, voxel_layout};
use crate::kernels::tile::LANES;
use crate::layers::LAYERS;
use crate::receptive_field::{COARSEST, PatchSizes, RESOLUTION, positions_at_10};
use crate::upsampling::Upsampling;

/// A network, prepared for evaluation at single voxels.
#[derive(Debug)]
pub struct VoxelNetwork {
    mode: Upsampling,
    head: Head,
    parameters: Parameters,
    /// All stages except the heads, of which the last is on patches.
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
    doublings: Doublings,
    /// For each grid the stage at 10³, at the positions that its samples depend on. They share many of them.
    convs_10: Vec<Conv>,
    /// The head's columns of each sample, and how many of them are used.
    heads: (Vec<f32>, usize),
    /// The output of the three stages before a doubling. (The others' outputs are the next stage's inputs.)
    outputs: [Vec<f32>; 3],
}

impl Activations {
    /// The head's outputs of each sample ([`Head::outputs`]).
    pub fn heads(&self) -> impl Iterator<Item = &[f32]> {
        let (columns, outputs) = &self.heads;
        from_lanes(columns, *outputs)
    }
}

/// The three doublings: of each grid, and around each sample's voxel.
#[derive(Debug)]
struct Doublings {
    to_10: Doubling,
    to_20: Vec<Doubling>,
    to_40: Vec<Doubling>,
}

/// The weights in the order of the backward pass.
#[derive(Debug)]
pub struct TransposedWeights(pub(crate) Vec<Vec<f32>>);

impl VoxelNetwork {
    /// `vector` as [`crate::layers::slots_of`] lays out the layers of a head.
    ///
    /// # Panics
    /// If it has another length.
    #[must_use]
    pub fn new(vector: &[f32], mode: Upsampling, head: Head) -> Self {
        let sizes = PatchSizes::new(mode);
        let conv = |number: usize, n: usize, padding: usize, output_padding: usize| {
            Conv::new(LAYERS[number], Extent::cube(n, padding), output_padding)
        };
        let convs = [
            conv(0, RESOLUTION, 2, 1),
            conv(1, 20, 1, 1),
            conv(2, 10, 1, 1),
            conv(3, COARSEST, 1, 0),
            conv(4, 2 * COARSEST, 1, 0),
            conv(5, sizes.conv3_in, 0, 0),
        ];
        Self { mode, head, parameters: Parameters::from_vector(voxel_layout(head), vector), convs }
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

        let doublings = self.doublings(samples);
        let coarse_of_grids = coarse.chunks_exact(coarse.len() / samples.grids.len());
        let inputs_10 = coarse_of_grids.map(|coarse| doublings.to_10.double(LAYERS[3].channels_out, coarse));
        let inputs_10 = inputs_10.collect::<Vec<_>>().concat();
        let convs_10 = self.convs_10(samples);
        let (weights, bias) = self.parameters.stage(4);
        let of_grids = convs_10.iter().zip(inputs_10.chunks_exact(inputs_10.len() / samples.grids.len()));
        let decoded_10 = of_grids.map(|(conv, inputs)| conv.forward(weights, bias, true, inputs));
        let decoded_10 = decoded_10.collect::<Vec<_>>().concat();

        // Patches, one per sample.
        let decoded_of = |grid: &usize| part(&decoded_10, samples.grids.len(), *grid);
        let patches_20 =
            double_all(&doublings.to_20, LAYERS[4].channels_out, samples.grid_of_sample.iter().map(decoded_of));
        let decoded_20 = conv(5, &patches_20);
        let patches_40 = double_all(&doublings.to_40, LAYERS[5].channels_out, patches(&decoded_20, samples));
        let (weights, bias) = self.parameters.stage(HEADS);
        let heads = self.heads_conv(samples.voxels.len()).forward(weights, bias, false, &patches_40);
        Activations {
            inputs: [grids, encoded_20, encoded_10, encoded_5, inputs_10, patches_20, patches_40],
            doublings,
            convs_10,
            heads: (heads, self.head.outputs()),
            outputs: [coarse, decoded_10, decoded_20],
        }
    }

    /// The gradient of every parameter, as the flat vector. `d_heads` is the gradient of each sample's outputs, one
    /// sample after the other.
    #[must_use]
    pub fn gradient(
        &self,
        TransposedWeights(transposed): &TransposedWeights,
        samples: &VoxelInputs<'_>,
        seen: &Activations,
        d_heads: &[f32],
    ) -> Vec<f32> {
        let mut sum = Parameters::zeros(voxel_layout(self.head));
        let mut through = |number: usize, conv: &Conv, inputs: &[f32], gradients: &[f32]| {
            let (d_weights, d_bias) = sum.stage_mut(number);
            conv.add_parameters(inputs, gradients, d_weights, d_bias);
            if number == 0 { Vec::new() } else { conv.d_inputs(&transposed[number], gradients) }
        };
        let masked = |number: usize, outputs: &[f32], d: &[f32]| self.convs[number].through_relu(outputs, d);
        let (Doublings { to_10, to_20, to_40 }, grids) = (&seen.doublings, samples.grids.len());
        let [coarse, decoded_10, decoded_20] = &seen.outputs;

        let d_heads = to_lanes(d_heads, self.head.outputs());
        let d_patches = through(HEADS, &self.heads_conv(samples.voxels.len()), &seen.inputs[HEADS], &d_heads);
        let d = patches(&d_patches, samples).zip(to_40).map(|(d, by)| by.halve(LAYERS[5].channels_out, d));
        let d = masked(5, decoded_20, &d.collect::<Vec<_>>().concat());
        let d_patches = through(5, &self.convs[5], &seen.inputs[5], &d);
        let mut d_decoded = vec![0.0; decoded_10.len()];
        for ((d, by), grid) in patches(&d_patches, samples).zip(to_20).zip(&samples.grid_of_sample) {
            let sums = part_mut(&mut d_decoded, grids, *grid).iter_mut();
            sums.zip(by.halve(LAYERS[4].channels_out, d)).for_each(|(sum, more)| *sum += more);
        }
        let mut d_coarse = Vec::with_capacity(coarse.len());
        for (grid, conv) in seen.convs_10.iter().enumerate() {
            let d = conv.through_relu(part(decoded_10, grids, grid), part(&d_decoded, grids, grid));
            let d_inputs = through(4, conv, part(&seen.inputs[4], grids, grid), &d);
            d_coarse.extend(to_10.halve(LAYERS[3].channels_out, &d_inputs));
        }
        let mut d = through(3, &self.convs[3], &seen.inputs[3], &masked(3, coarse, &d_coarse));
        for number in [2, 1, 0] {
            let outputs = masked(number, &seen.inputs[number + 1], &d);
            d = through(number, &self.convs[number], &seen.inputs[number], &outputs);
        }
        sum.to_vector()
    }

    fn doublings(&self, samples: &VoxelInputs<'_>) -> Doublings {
        let around = samples.voxels.iter().map(|voxel| Doubling::around(*voxel, self.mode));
        let (to_20, to_40) = around.map(|[to_20, to_40]| (to_20, to_40)).unzip();
        Doublings { to_10: Doubling::of_volume(COARSEST, LAYERS[4].padding(), self.mode), to_20, to_40 }
    }

    /// For each grid the stage at 10³, at the positions that its samples depend on.
    fn convs_10(&self, samples: &VoxelInputs<'_>) -> Vec<Conv> {
        const N: usize = 2 * COARSEST;
        let mut is_needed = vec![false; samples.grids.len() * N.pow(3)];
        for (voxel, grid) in samples.voxels.iter().zip(&samples.grid_of_sample) {
            let [x, y, z] = voxel.map(|coordinate| positions_at_10(coordinate, self.mode));
            for (x, y) in x.flat_map(|x| y.clone().map(move |y| (x, y))) {
                part_mut(&mut is_needed, samples.grids.len(), *grid)[(x * N + y) * N..][z.clone()].fill(true);
            }
        }
        let needed = |grid: &[bool]| -> Vec<usize> { (0..N.pow(3)).filter(|at| grid[*at]).collect() };
        is_needed.chunks_exact(N.pow(3)).map(|grid| self.convs[4].at(&needed(grid))).collect()
    }

    /// The head as a product with one row per sample.
    fn heads_conv(&self, samples: usize) -> Conv {
        Conv::of_rows(samples, LAYERS[HEADS].fan_in(), self.head.outputs().next_multiple_of(LANES))
    }
}

/// One of `count` parts of equal length.
fn part<T>(all: &[T], count: usize, number: usize) -> &[T] {
    let len = all.len() / count;
    &all[number * len..][..len]
}

fn part_mut<T>(all: &mut [T], count: usize, number: usize) -> &mut [T] {
    let len = all.len() / count;
    &mut all[number * len..][..len]
}

/// The patches of consecutive samples.
fn patches<'a>(patches: &'a [f32], samples: &VoxelInputs<'_>) -> impl Iterator<Item = &'a [f32]> {
    patches.chunks_exact(patches.len() / samples.voxels.len())
}

fn double_all<'a>(doublings: &[Doubling], channels: usize, patches: impl Iterator<Item = &'a [f32]>) -> Vec<f32> {
    let doubled = doublings.iter().zip(patches).map(|(by, patch)| by.double(channels, patch));
    doubled.collect::<Vec<_>>().concat()
}

#[cfg(test)]
mod tests {
    use schema::{Purpose, Stream};

    use super::*;
    use crate::DenseNetwork;
    use crate::layers::initial_of;

    /// Voxels in the middle, at faces and in corners; some alone in their grid, some with others.
    #[test]
    fn the_network_at_a_voxel_is_the_dense_one_with_every_head() {
        let mut draw = Stream::new(5, 0, Purpose::Views, 0);
        let grids: Vec<Vec<f32>> =
            (0..2).map(|_| (0..RESOLUTION.pow(3)).map(|_| draw.uniform(0.0, 1.0)).collect()).collect();
        let alone = [[0, 39, 20]];
        let together = [[0, 0, 0], [39, 39, 39], [20, 21, 22], [20, 20, 20], [3, 38, 11], [12, 7, 30], [21, 0, 39]];
        let samples = VoxelInputs {
            grids: grids.iter().map(|grid| &grid[..]).collect(),
            grid_of_sample: [vec![0; alone.len()], vec![1; together.len()]].concat(),
            voxels: [&alone[..], &together[..]].concat(),
        };
        for (head, mode) in Head::ALL.into_iter().flat_map(|head| Upsampling::ALL.map(|mode| (head, mode))) {
            let vector = initial_of(head.layers(), 6);
            let (network, dense) = (VoxelNetwork::new(&vector, mode, head), DenseNetwork::new(&vector, mode, head));
            let volumes: Vec<_> = grids.iter().map(|grid| dense.infer(grid)).collect();
            let seen = network.forward(&samples);
            let of_samples = seen.heads().zip(&samples.voxels).zip(&samples.grid_of_sample);
            for ((outputs, [x, y, z]), grid) in of_samples {
                let (own, volume, count) = (head.answer(outputs), &volumes[*grid], RESOLUTION.pow(3));
                let flat = (x * RESOLUTION + y) * RESOLUTION + z;
                let context = format!("{head:?} {mode:?} {x} {y} {z}");
                assert!((own.quality_logit - volume.quality_logit[flat]).abs() < 1e-4, "{context}");
                assert!((own.width_voxels - volume.width_voxels[flat]).abs() < 1e-4, "{context}");
                let turned: f32 = (0..4).map(|part| own.rotation[part] * volume.rotation[part * count + flat]).sum();
                assert!(turned.abs() > 1.0 - 1e-4, "{context}: {turned}");
                for (part, tips) in own.tips_voxels.iter().flatten().enumerate() {
                    assert!((tips - volume.tips_voxels[part * count + flat]).abs() < 1e-4, "{context}");
                }
            }
        }
    }
}
