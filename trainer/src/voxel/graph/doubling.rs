//! ×2 upsampling of tensors around voxels: each axis is multiplied with its matrix ([`Upsampling::window`]).

use std::array;

use burn::tensor::{Device, Tensor, TensorData};
use network::receptive_field::{COARSEST, PatchSizes, axis_windows};
use network::upsampling::Upsampling;

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
