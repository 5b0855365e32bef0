//! The numbers that `lab/golden_torch.py` computes by formula, recomputed here.

use network::layers::LAYERS;
use schema::Rule;
use trainer::batch::{Sample, SampleId};
use trainer::voxel::VoxelSample;
use trainer::voxel::loss::Target;

/// A sample of no dataset.
pub(crate) fn sample(grid: usize, voxel: [usize; 3], target: Target) -> Sample<VoxelSample> {
    let id = SampleId { scene: 0, attempt: 0, rule: Rule::of_the_paper()[0] };
    Sample { id, grid, data: VoxelSample { voxel, target } }
}

/// Multiples of 2⁻²⁴ in [0, 1): Wellons' lowbias32 hash of the position.
pub(crate) fn noise(count: usize, seed: u32) -> Vec<f64> {
    let start = seed.wrapping_mul(0x9E37_79B9);
    (0..count as u32)
        .map(|at| {
            let mut x = at.wrapping_add(start);
            x = (x ^ (x >> 16)).wrapping_mul(0x7FEB_352D);
            x = (x ^ (x >> 15)).wrapping_mul(0x846C_A68B);
            x ^= x >> 16;
            f64::from(x >> 8) / f64::from(1 << 24)
        })
        .collect()
}

/// Weights and biases U(−b, b) with b = √(6 / fan_in), in the order of the flat vector.
pub(crate) fn parameters() -> Vec<f32> {
    let mut values = Vec::new();
    for (number, layer) in LAYERS.iter().enumerate() {
        let bound = (6.0 / layer.fan_in() as f64).sqrt();
        for (part, count) in [layer.weight_count(), layer.channels_out].into_iter().enumerate() {
            let seed = (2 * number + part) as u32;
            values.extend(noise(count, seed).into_iter().map(|u| ((2.0 * u - 1.0) * bound) as f32));
        }
    }
    values
}

/// A grid of which a quarter of the voxels hold a value.
pub(crate) fn grid(number: u32) -> Vec<f32> {
    let (values, there) = (noise(64_000, 100 + number), noise(64_000, 200 + number));
    values.into_iter().zip(there).map(|(value, there)| if there < 0.25 { value as f32 } else { 0.0 }).collect()
}

/// ‖a − b‖ / ‖b‖.
pub(crate) fn relative_error(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    let square = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
    let apart = square(&mut a.iter().zip(b).map(|(a, b)| f64::from(*a) - f64::from(*b)));
    apart / square(&mut b.iter().map(|b| f64::from(*b))).max(1e-30)
}
