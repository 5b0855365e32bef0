//! The network at one voxel per sample, its loss and its gradient.
//!
//! The encoder and the first decoder convolution (5³) run densely, once per grid; the rest of the decoder and the heads
//! run on the voxel's receptive field only. The host uses the kernels of the crate `network`, other devices use Burn
//! (`graph`). In both cases loss and gradients equal those of the dense network at that voxel; the tests require 1e-4.

use network::upsampling::Upsampling;
use network::{HEAD_OUTPUTS, VoxelNetwork};

use super::VoxelSample;
use super::loss::{loss_gradient, sample_loss};
use crate::batch::Batch;
use crate::device::Device;
use crate::results::{SampleResult, StepResult, sum};

/// Loss and gradient of a batch. Parts of the batch run in parallel; their gradients are added in order, so the result
/// does not depend on the number of threads.
///
/// Shapes: `vector` as [`network::layers::parameter_slots`] lays it out.
#[must_use]
pub fn step(vector: &[f32], batch: &Batch<VoxelSample>, mode: Upsampling, device: &Device) -> StepResult {
    sum(vector.len(), part_steps(vector, batch, mode, device))
}

/// Losses and predictions of a batch, without a gradient.
#[must_use]
pub fn evaluate(vector: &[f32], batch: &Batch<VoxelSample>, mode: Upsampling, device: &Device) -> Vec<SampleResult> {
    let results: Vec<Vec<SampleResult>> = match device {
        Device::Host => {
            let network = VoxelNetwork::new(vector, mode);
            batch.by_parts(|part| {
                let seen = network.forward(&part.inputs);
                seen.heads().zip(&part.targets).map(|(heads, target)| sample_loss(&heads, target)).collect()
            })
        }
        #[cfg(feature = "graph")]
        Device::Burn(device) => batch.by_parts(|part| super::graph::part_results(vector, part, mode, device)),
    };
    results.concat()
}

/// The contribution of each part of a batch to [`step`].
fn part_steps(vector: &[f32], batch: &Batch<VoxelSample>, mode: Upsampling, device: &Device) -> Vec<StepResult> {
    let weight = 1.0 / batch.samples.len() as f32;
    match device {
        Device::Host => {
            let network = VoxelNetwork::new(vector, mode);
            let transposed = network.transposed();
            batch.by_parts(|part| {
                let seen = network.forward(&part.inputs);
                let heads: Vec<[f32; HEAD_OUTPUTS]> = seen.heads().collect();
                let samples = || heads.iter().zip(&part.targets);
                let d_heads: Vec<_> = samples().map(|(heads, target)| loss_gradient(heads, target, weight)).collect();
                StepResult {
                    gradient: network.gradient(&transposed, &part.inputs, &seen, &d_heads),
                    samples: samples().map(|(heads, target)| sample_loss(heads, target)).collect(),
                }
            })
        }
        #[cfg(feature = "graph")]
        Device::Burn(device) => batch.by_parts(|part| super::graph::part_step(vector, part, mode, weight, device)),
    }
}

#[cfg(test)]
mod tests {
    use network::layers::initial_vector;
    use network::receptive_field::RESOLUTION;
    use schema::{Purpose, Quat, Stream};

    use super::*;
    use crate::voxel::loss::{Closings, Target};
    use crate::voxel::tests::sample;

    /// Five grids of noise with six samples each: three parts.
    fn batch() -> Batch<VoxelSample> {
        let mut draw = Stream::new(8, 0, Purpose::Views, 0);
        let grids = (0..5).map(|_| (0..RESOLUTION.pow(3)).map(|_| draw.uniform(0.0, 1.0)).collect::<Vec<f32>>().into());
        let grids = grids.collect();
        let target = |at: usize| Target {
            label: u8::from(at.is_multiple_of(2)),
            rotation: Quat::IDENTITY,
            width_voxels: 6.0,
            quality_weight: 1.0,
            closings: Closings::Half,
        };
        let mut voxel = || [draw.index(RESOLUTION), draw.index(RESOLUTION), draw.index(RESOLUTION)];
        Batch { grids, samples: (0..30).map(|at| sample(at / 6, voxel(), target(at))).collect() }
    }

    #[test]
    fn parts_of_a_step_add_up_to_it_to_the_bit() {
        let (batch, mode) = (batch(), Upsampling::Linear);
        let vector = initial_vector(3);
        let whole = step(&vector, &batch, mode, &Device::Host);
        let parts = part_steps(&vector, &batch, mode, &Device::Host);
        assert!(parts.len() > 2, "{}", parts.len());
        let samples: Vec<_> = parts.iter().flat_map(|part| part.samples.clone()).collect();
        assert_eq!(samples, whole.samples);
        let gradients = parts.into_iter().map(|part| part.gradient);
        let sum = gradients.reduce(|a, b| a.iter().zip(&b).map(|(a, b)| a + b).collect()).unwrap();
        assert!(sum == whole.gradient);
    }
}
