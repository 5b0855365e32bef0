//! The step as other devices do it, against the host's: on the host itself, and on every device that the program was
//! built for.

use network::VoxelParams;
use network::upsampling::Upsampling;
use schema::Quat;
use trainer::batch::Batch;
use trainer::device::Device::{Burn, Host};
use trainer::voxel::VoxelSample;
use trainer::voxel::loss::Target;
use trainer::voxel::step::step;

use crate::formula::{grid, parameters, relative_error, sample};

/// Grids with six samples each: parts as large as they come.
fn batch(grids: usize) -> Batch<VoxelSample> {
    let voxels = [[0, 0, 0], [20, 11, 33], [39, 39, 39], [5, 30, 17], [12, 0, 39], [21, 22, 23]];
    let target = |at: usize| Target {
        tips_voxels: [0.0; 3],
        label: u8::from(at.is_multiple_of(2)),
        rotation: Quat::IDENTITY,
        width_voxels: 6.0,
        quality_weight: 1.0,
    };
    let sample = |at: usize| sample(at / 6, voxels[at % voxels.len()], target(at));
    Batch {
        grids: (0..grids).map(|number| grid(number as u32).into()).collect(),
        samples: (0..6 * grids).map(sample).collect(),
    }
}

#[test]
fn automatic_differentiation_finds_what_is_written_out() {
    let (vector, batch) = (parameters(), batch(2));
    let flex = Burn(burn::tensor::Device::flex());
    for mode in Upsampling::ALL {
        let (ours, graph) = (
            step(&vector, &batch, &VoxelParams::at_tips(mode), &Host),
            step(&vector, &batch, &VoxelParams::at_tips(mode), &flex),
        );
        let error = relative_error(&graph.gradient, &ours.gradient);
        assert!(error < 1e-5, "{mode:?}: gradient off by {error:e}");
        for (a, b) in ours.samples.iter().zip(&graph.samples) {
            assert!((a.total - b.total).abs() < 1e-5 * a.total.abs().max(1.0), "{mode:?}: {} {}", a.total, b.total);
        }
    }
}

#[cfg(feature = "wgpu")]
#[test]
fn wgpu_computes_what_the_host_does() {
    let name = trainer::device::DeviceName::Wgpu(0);
    let device = name.open().unwrap();
    let (vector, batch) = (parameters(), batch(10));
    for mode in Upsampling::ALL {
        let (ours, theirs) = (
            step(&vector, &batch, &VoxelParams::at_tips(mode), &Host),
            step(&vector, &batch, &VoxelParams::at_tips(mode), &device),
        );
        let error = relative_error(&theirs.gradient, &ours.gradient);
        println!("{name}, {mode:?}: gradient off by {error:e}");
        assert!(error < 1e-4, "{name}, {mode:?}: gradient off by {error:e}");
        let tests = trainer::voxel::step::evaluate(&vector, &batch, &VoxelParams::at_tips(mode), &device);
        for ((a, b), test) in ours.samples.iter().zip(&theirs.samples).zip(&tests) {
            assert!((a.total - b.total).abs() < 1e-4 * a.total.abs().max(1.0), "{name}: loss {} {}", a.total, b.total);
            assert!((a.total - test.total).abs() < 1e-4 * a.total.abs().max(1.0), "{name}: {} {}", a.total, test.total);
        }
    }
}
