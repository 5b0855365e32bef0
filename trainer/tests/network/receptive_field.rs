//! Compares the receptive-field step with the dense network: same loss, same gradient of every parameter, for any
//! voxel.

use std::sync::Arc;

use crate::formula::{grid, noise, parameters, relative_error, sample};
use crate::plain;
use burn::tensor::{Device, Tensor, TensorData};
use network::VoxelParams;
use network::layers::parameter_slots;
use network::upsampling::Upsampling;
use schema::Quat;
use trainer::batch::Batch;
use trainer::device::Device::Host;
use trainer::voxel::VoxelSample;
use trainer::voxel::graph::loss::{Prediction, Targets, sample_losses};
use trainer::voxel::graph::to_device;
use trainer::voxel::loss::Target;
use trainer::voxel::step::step;

const TOLERANCE: f64 = 1e-4;

/// Positive and negative targets at some voxels of one grid.
fn batch(voxels: &[[usize; 3]]) -> Batch<VoxelSample> {
    let draws = noise(6 * voxels.len(), 700);
    let samples = voxels.iter().zip(draws.chunks(6)).enumerate().map(|(at, (voxel, draw))| {
        let part = |number: usize| 2.0 * draw[number] as f32 - 1.0;
        let rotation = Quat::from_xyzw(part(0), part(1), part(2), part(3)).normalize();
        let (width_voxels, quality_weight) = (5.0 + 4.0 * part(4), [1.0, 0.7, 1.9][at % 3]);
        let target =
            Target { tips_voxels: [0.0; 3], label: u8::from(at % 3 != 1), rotation, width_voxels, quality_weight };
        sample(0, *voxel, target)
    });
    Batch { grids: vec![Arc::from(grid(0))], samples: samples.collect() }
}

/// Per-sample losses and the gradient of their mean, by the dense network and Burn's own convolutions.
fn dense(vector: &[f32], batch: &Batch<VoxelSample>, mode: Upsampling) -> (Vec<f32>, Vec<f32>) {
    let device = Device::flex();
    let vector = to_device(vector, &device).autodiff().require_grad();
    let tsdf = TensorData::new(batch.grids[0].to_vec(), [1, 1, 40, 40, 40]);
    let output = plain::dense(&vector, Tensor::from_data(tsdf, &device).autodiff(), mode);
    let at = |map: &Tensor<5>, [x, y, z]: [usize; 3]| {
        let channels = map.dims()[1];
        map.clone().slice([0..1, 0..channels, x..x + 1, y..y + 1, z..z + 1]).reshape([1, channels])
    };
    let rows = |map: &Tensor<5>| Tensor::cat(batch.samples.iter().map(|s| at(map, s.data.voxel)).collect(), 0);
    let prediction = Prediction {
        quality_logit: rows(&output.quality_logit).squeeze_dim(1),
        rotation: rows(&output.rotation),
        width_voxels: rows(&output.width_voxels).squeeze_dim(1),
    };
    let targets: Vec<Target> = batch.samples.iter().map(|sample| sample.data.target).collect();
    let losses = sample_losses(&prediction, &Targets::new(&targets, &device));
    let gradients = losses.total.clone().mean().backward();
    let gradient = vector.grad(&gradients).unwrap().into_data().try_to_vec().unwrap();
    (losses.total.inner().into_data().try_to_vec().unwrap(), gradient)
}

/// Compares each voxel's loss, and the gradient of their mean, with the dense network's.
fn check(voxels: &[[usize; 3]]) {
    for mode in Upsampling::ALL {
        let (vector, batch) = (parameters(), batch(voxels));
        let (dense_losses, dense_gradient) = dense(&vector, &batch, mode);
        let result = step(&vector, &batch, &VoxelParams::at_tips(mode), &Host);
        for ((sample, expected), voxel) in result.samples.iter().zip(&dense_losses).zip(voxels) {
            let error = f64::from((sample.total - expected).abs() / expected.abs());
            assert!(error <= TOLERANCE, "{mode:?}, voxel {voxel:?}: loss {} against {expected}", sample.total);
        }
        let mut worst = 0.0_f64;
        for slot in parameter_slots() {
            let range = slot.start..slot.start + slot.len;
            let error = relative_error(&result.gradient[range.clone()], &dense_gradient[range]);
            assert!(error <= TOLERANCE, "{mode:?}, voxels {voxels:?}: gradient of {} off by {error:e}", slot.name);
            worst = worst.max(error);
        }
        println!("{mode:?}: worst relative error of a parameter's gradient {worst:e}");
    }
}

/// Voxels of which each coordinate is one of three.
fn crossed(coordinates: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..27).map(move |at| [coordinates[at / 9], coordinates[at / 3 % 3], coordinates[at % 3]])
}

#[test]
fn at_every_corner_edge_and_face() {
    let voxels: Vec<_> = crossed([0, 17, 39]).collect();
    check(&voxels);
}

#[test]
fn inside_and_one_to_three_voxels_from_the_border() {
    let voxels: Vec<_> = crossed([1, 20, 37]).chain(crossed([2, 13, 38])).chain(crossed([3, 26, 36])).collect();
    check(&voxels);
}

/// The voxel alone, so that no other one can hide an error.
#[test]
fn an_odd_place_alone() {
    check(&[[39, 38, 25]]);
}
