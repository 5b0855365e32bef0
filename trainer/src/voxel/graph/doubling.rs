//! ×2 upsampling of tensors: of whole volumes, and of the patches around voxels.
//!
//! Burn's `interpolate` supports only 4-D tensors, so each axis is multiplied with its matrix ([`Upsampling::window`]).

use std::array;

use burn::tensor::{Device, Tensor, TensorData};
use network::receptive_field::{COARSEST, PatchSizes, axis_windows};
use network::upsampling::Upsampling;

/// Doubles the three last axes of `[batch, channels, n, n, n]`.
///
/// Shapes: in `[b, c, n, n, n]`, out `[b, c, 2n, 2n, 2n]`.
#[must_use]
pub fn double(input: Tensor<5>, mode: Upsampling) -> Tensor<5> {
    let n = input.dims()[2];
    let window = TensorData::new(mode.window(n, 0, 2 * n, 0, n), [1, 2 * n, n]);
    let matrix = Tensor::from_data(window, &input.device());
    double_patches(input.permute([0, 2, 3, 4, 1]), [&matrix; 3]).permute([0, 4, 1, 2, 3])
}

/// The doubling matrices of a batch of voxels, coarsest level first, for x, y and z: each maps a coarse patch to the
/// fine input patch of the next convolution.
///
/// Shapes: `[b, conv2_in, 5]`, `[b, conv3_in, conv2_out]` and `[b, heads_in, conv3_out]`.
#[must_use]
pub fn doublings(voxels: &[[usize; 3]], mode: Upsampling, device: &Device) -> [[Tensor<3>; 3]; 3] {
    let sizes = PatchSizes::new(mode);
    let coarse = [COARSEST, sizes.conv2_out, sizes.conv3_out];
    let windows: Vec<_> = voxels.iter().map(|voxel| voxel.map(|coordinate| axis_windows(coordinate, mode))).collect();
    array::from_fn(|level| {
        array::from_fn(|axis| {
            let values: Vec<f32> = windows.iter().flat_map(|windows| &windows[axis][level]).copied().collect();
            let fine = values.len() / (voxels.len() * coarse[level]);
            Tensor::from_data(TensorData::new(values, [voxels.len(), fine, coarse[level]]), device)
        })
    })
}

/// Doubles a batch of patches with a matrix along each axis.
///
/// Shapes: patches `[b, n, n, n, c]`, matrices `[b, m, n]` or `[1, m, n]`, out `[b, m, m, m, c]`.
#[must_use]
pub fn double_patches(patches: Tensor<5>, [x, y, z]: [&Tensor<3>; 3]) -> Tensor<5> {
    let [batch, n, _, _, channels] = patches.dims();
    let m = x.dims()[1];
    let along_x = x.clone().matmul(patches.reshape([batch, n, n * n * channels]));
    let along_y = y.clone().unsqueeze_dim::<4>(1).matmul(along_x.reshape([batch, m, n, n * channels]));
    z.clone().unsqueeze_dims::<5>(&[1, 1]).matmul(along_y.reshape([batch, m, m, n, channels]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_doubling_repeats_each_value_eight_times() {
        let input = Tensor::<1>::from_data(TensorData::new((0..8).map(|v| v as f32).collect(), [8]), &Device::flex());
        let output = double(input.reshape([1, 1, 2, 2, 2]), Upsampling::Nearest);
        let values = output.into_data().try_to_vec::<f32>().unwrap();
        for (at, value) in values.iter().enumerate() {
            let (x, y, z) = (at / 16, at / 4 % 4, at % 4);
            assert_eq!(*value, (x / 2 * 4 + y / 2 * 2 + z / 2) as f32);
        }
    }
}
