//! The network at one voxel per sample, its loss and its gradient.
//!
//! The encoder and the first decoder convolution (5³) run densely, once per grid; the rest of the decoder and the heads
//! run on the voxel's receptive field only. The host uses the kernels of the crate `network`, other devices use Burn
//! (`graph`). In both cases loss and gradients equal those of the dense network at that voxel; the tests require 1e-4.

use network::head::{ClosingsHead, Head};
use network::{VoxelNetwork, VoxelParams};

use super::loss::Target;
use super::{VoxelSample, closing_loss, loss};
use crate::batch::Batch;
use crate::device::Device;
use crate::results::{SampleResult, StepResult, sum};

/// Loss and gradient of a batch. Parts of the batch run in parallel; their gradients are added in order, so the result
/// does not depend on the number of threads.
///
/// Shapes: `vector` as [`network::layers::slots_of`] lays out the layers of the head.
#[must_use]
pub fn step(vector: &[f32], batch: &Batch<VoxelSample>, params: &VoxelParams, device: &Device) -> StepResult {
    sum(vector.len(), part_steps(vector, batch, params, device))
}

/// Losses and predictions of a batch, without a gradient.
#[must_use]
pub fn evaluate(
    vector: &[f32],
    batch: &Batch<VoxelSample>,
    params: &VoxelParams,
    device: &Device,
) -> Vec<SampleResult> {
    let VoxelParams { head, upsampling, .. } = *params;
    let results: Vec<Vec<SampleResult>> = match device {
        Device::Host => {
            let network = VoxelNetwork::new(vector, upsampling, head);
            batch.by_parts(|part| {
                let seen = network.forward(&part.inputs);
                seen.heads().zip(&part.targets).map(|(outputs, target)| sample_loss(head, outputs, target)).collect()
            })
        }
        #[cfg(feature = "graph")]
        Device::Burn(device) => batch.by_parts(|part| super::graph::part_results(vector, part, upsampling, device)),
    };
    results.concat()
}

fn sample_loss(head: Head, outputs: &[f32], target: &Target) -> SampleResult {
    match head {
        Head::Quaternion => loss::sample_loss(of_the_paper(outputs), target),
        Head::Closings => closing_loss::sample_loss(&ClosingsHead::new(outputs), target),
    }
}

fn loss_gradient(head: Head, outputs: &[f32], target: &Target, weight: f32) -> Vec<f32> {
    match head {
        Head::Quaternion => loss::loss_gradient(of_the_paper(outputs), target, weight).to_vec(),
        Head::Closings => closing_loss::loss_gradient(&ClosingsHead::new(outputs), target, weight).to_vec(),
    }
}

fn of_the_paper(outputs: &[f32]) -> &loss::Outputs {
    outputs.first_chunk().expect("as many as the head has")
}

/// The contribution of each part of a batch to [`step`].
fn part_steps(vector: &[f32], batch: &Batch<VoxelSample>, params: &VoxelParams, device: &Device) -> Vec<StepResult> {
    let VoxelParams { head, upsampling, .. } = *params;
    let weight = 1.0 / batch.samples.len() as f32;
    match device {
        Device::Host => {
            let network = VoxelNetwork::new(vector, upsampling, head);
            let transposed = network.transposed();
            batch.by_parts(|part| {
                let seen = network.forward(&part.inputs);
                let samples = || seen.heads().zip(&part.targets);
                let gradients = samples().flat_map(|(own, target)| loss_gradient(head, own, target, weight));
                let d_heads: Vec<f32> = gradients.collect();
                StepResult {
                    gradient: network.gradient(&transposed, &part.inputs, &seen, &d_heads),
                    samples: samples().map(|(own, target)| sample_loss(head, own, target)).collect(),
                }
            })
        }
        #[cfg(feature = "graph")]
        Device::Burn(device) => {
            batch.by_parts(|part| super::graph::part_step(vector, part, upsampling, weight, device))
        }
    }
}

#[cfg(test)]
mod tests {
    use network::layers::initial_vector;
    use network::receptive_field::RESOLUTION;
    use network::upsampling::Upsampling;
    use schema::{Purpose, Quat, Stream};

    use super::*;
    use crate::voxel::loss::Target;
    use crate::voxel::tests::sample;

    /// Five grids of noise with six samples each: three parts.
    fn batch() -> Batch<VoxelSample> {
        let mut draw = Stream::new(8, 0, Purpose::Views, 0);
        let grids = (0..5).map(|_| (0..RESOLUTION.pow(3)).map(|_| draw.uniform(0.0, 1.0)).collect::<Vec<f32>>().into());
        let grids = grids.collect();
        let target = |at: usize| Target {
            tips_voxels: [0.0; 3],
            label: u8::from(at.is_multiple_of(2)),
            rotation: Quat::IDENTITY,
            width_voxels: 6.0,
            quality_weight: 1.0,
        };
        let mut voxel = || [draw.index(RESOLUTION), draw.index(RESOLUTION), draw.index(RESOLUTION)];
        Batch { grids, samples: (0..30).map(|at| sample(at / 6, voxel(), target(at))).collect() }
    }

    #[test]
    fn parts_of_a_step_add_up_to_it_to_the_bit() {
        let (batch, mode) = (batch(), VoxelParams::at_tips(Upsampling::Linear));
        let vector = initial_vector(3);
        let whole = step(&vector, &batch, &mode, &Device::Host);
        let parts = part_steps(&vector, &batch, &mode, &Device::Host);
        assert!(parts.len() > 2, "{}", parts.len());
        let samples: Vec<_> = parts.iter().flat_map(|part| part.samples.clone()).collect();
        assert_eq!(samples, whole.samples);
        let gradients = parts.into_iter().map(|part| part.gradient);
        let sum = gradients.reduce(|a, b| a.iter().zip(&b).map(|(a, b)| a + b).collect()).unwrap();
        assert!(sum == whole.gradient);
    }

    /// The slope of a batch's mean loss along a direction, by the gradient and by two losses.
    #[test]
    fn the_gradient_of_every_head_is_the_slope_of_the_loss() {
        let batch = batch();
        for head in Head::ALL {
            let params = VoxelParams { head, ..VoxelParams::at_tips(Upsampling::Linear) };
            let vector = network::Architecture::Voxel(params).initial_vector(3);
            let mut draw = Stream::new(9, 0, Purpose::Weights, 0);
            let direction: Vec<f32> = vector.iter().map(|_| draw.uniform(-1.0, 1.0)).collect();
            let loss = |by: f32| {
                let moved: Vec<f32> = vector.iter().zip(&direction).map(|(value, along)| value + by * along).collect();
                let results = evaluate(&moved, &batch, &params, &Device::Host);
                results.iter().map(|result| f64::from(result.total)).sum::<f64>() / results.len() as f64
            };
            let slope = (loss(1e-4) - loss(-1e-4)) / 2e-4;
            let gradient = step(&vector, &batch, &params, &Device::Host).gradient;
            let along: f64 = gradient.iter().zip(&direction).map(|(a, b)| f64::from(a * b)).sum();
            assert!((slope - along).abs() < 0.02 * along.abs() + 1e-3, "{head:?}: {slope} against {along}");
        }
    }
}
