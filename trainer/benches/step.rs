//! Milliseconds of a training step, forward and backward, at the paper's batch of 48.

use std::sync::Arc;

use network::VoxelParams;
use network::layers::initial_vector;
use network::upsampling::Upsampling;
use schema::{Purpose, Quat, Rule, Stream};
use trainer::batch::{Batch, Sample, SampleId};
use trainer::device::Device;
use trainer::voxel::VoxelSample;
use trainer::voxel::loss::Target;
use trainer::voxel::step::{evaluate, step};

fn main() {
    divan::main();
}

/// A batch of 48 samples from some scenes.
fn batch(scenes: usize) -> Batch<VoxelSample> {
    let mut draw = Stream::new(0, 0, Purpose::Views, 0);
    let grids = (0..scenes).map(|_| (0..64_000).map(|_| draw.uniform(0.0, 1.0)).collect::<Vec<f32>>());
    let grids: Vec<Arc<[f32]>> = grids.map(Arc::from).collect();
    let samples = (0..48).map(|at| {
        let (label, rotation) = ((at % 4 == 0).into(), Quat::IDENTITY);
        let target = Target { tips_voxels: [0.0; 3], label, rotation, width_voxels: 5.0, quality_weight: 1.0 };
        let voxel = [draw.index(40), draw.index(40), draw.index(40)];
        let id = SampleId { scene: 0, attempt: 0, rule: Rule::of_the_paper()[0] };
        Sample { id, grid: at * scenes / 48, data: VoxelSample { voxel, target } }
    });
    Batch { samples: samples.collect(), grids }
}

#[divan::bench(args = [48, 8], sample_count = 8, sample_size = 1)]
fn train(bencher: divan::Bencher<'_, '_>, scenes: usize) {
    let (vector, batch) = (initial_vector(1), batch(scenes));
    bencher.bench_local(|| step(&vector, &batch, &VoxelParams::at_tips(Upsampling::Linear), &Device::Host));
}

#[cfg(feature = "flex")]
#[divan::bench(args = [48, 8], sample_count = 8, sample_size = 1)]
fn train_by_graph(bencher: divan::Bencher<'_, '_>, scenes: usize) {
    let (vector, batch) = (initial_vector(1), batch(scenes));
    let device = Device::Burn(burn::tensor::Device::flex());
    bencher.bench_local(|| step(&vector, &batch, &VoxelParams::at_tips(Upsampling::Linear), &device));
}

#[divan::bench(args = [48, 8], sample_count = 8, sample_size = 1)]
fn test(bencher: divan::Bencher<'_, '_>, scenes: usize) {
    let (vector, batch) = (initial_vector(1), batch(scenes));
    bencher.bench_local(|| evaluate(&vector, &batch, &VoxelParams::at_tips(Upsampling::Linear), &Device::Host));
}
