//! ×2 upsampling of tensors: of whole volumes, and of the patches around voxels.
//!
//! Burn's `interpolate` supports only 4-D tensors, so each axis is multiplied with its matrix ([`Upsampling::window`]).

use burn::tensor::{Device, Tensor, TensorData};
use network::receptive_field::{COARSEST, PatchSizes, axis_windows};
use network::upsampling::Upsampling;

/// Doubles the three last axes of `[batch, channels, n, n, n]`.
///
/// Shapes: in `[b, c, n, n, n]`, out `[b, c, 2n, 2n, 2n]`.
#[must_use]
pub fn double(input: Tensor<5>, mode: Upsampling) -> Tensor<5> {
    let [batch, channels, n, _, _] = input.dims();
    let matrix = doubling_matrix(mode, n, &input.device());
    let rows = input.reshape([batch * channels * n * n, n]).matmul(matrix.clone().transpose());
    let columns = matrix.clone().unsqueeze::<3>().matmul(rows.reshape([batch * channels * n, n, 2 * n]));
    let planes = matrix.unsqueeze::<3>().matmul(columns.reshape([batch * channels, n, 4 * n * n]));
    planes.reshape([batch, channels, 2 * n, 2 * n, 2 * n])
}

fn doubling_matrix(mode: Upsampling, n: usize, device: &Device) -> Tensor<2> {
    Tensor::from_data(TensorData::new(mode.window(n, (0, 2 * n), (0, n)), [2 * n, n]), device)
}

/// The doubling matrices of a batch of voxels for one axis: each maps a coarse patch to the fine input patch of the
/// next convolution.
#[derive(Debug, Clone)]
pub struct AxisDoublings {
    /// 5 to 10: `[b, conv2_in, 5]`.
    pub to_10: Tensor<3>,
    /// 10 to 20: `[b, conv3_in, conv2_out]`.
    pub to_20: Tensor<3>,
    /// 20 to 40: `[b, heads_in, conv3_out]`.
    pub to_40: Tensor<3>,
}

/// The doubling matrices of a batch of voxels for x, y and z.
#[must_use]
pub fn doublings(voxels: &[[usize; 3]], mode: Upsampling, device: &Device) -> [AxisDoublings; 3] {
    [0, 1, 2].map(|axis| {
        let mut matrices = [Vec::new(), Vec::new(), Vec::new()];
        for voxel in voxels {
            for (all, one) in matrices.iter_mut().zip(axis_windows(voxel[axis], mode)) {
                all.extend(one);
            }
        }
        let sizes = PatchSizes::new(mode);
        let [to_10, to_20, to_40] = matrices;
        let tensor = |values: Vec<f32>, fine: usize, coarse: usize| {
            Tensor::from_data(TensorData::new(values, [voxels.len(), fine, coarse]), device)
        };
        AxisDoublings {
            to_10: tensor(to_10, sizes.conv2_in, COARSEST),
            to_20: tensor(to_20, sizes.conv3_in, sizes.conv2_out),
            to_40: tensor(to_40, sizes.heads_in, sizes.conv3_out),
        }
    })
}

/// Doubles a batch of patches with a matrix along each axis.
///
/// Shapes: patches `[b, n, n, n, c]`, matrices `[b, m, n]`, out `[b, m, m, m, c]`.
#[must_use]
pub fn double_patches(patches: Tensor<5>, matrices: [Tensor<3>; 3]) -> Tensor<5> {
    let [batch, n, _, _, channels] = patches.dims();
    let [x, y, z] = matrices;
    let m = x.dims()[1];
    let along_x = x.matmul(patches.reshape([batch, n, n * n * channels]));
    let along_y = y.reshape([batch, 1, m, n]).matmul(along_x.reshape([batch, m, n, n * channels]));
    z.reshape([batch, 1, 1, m, n]).matmul(along_y.reshape([batch, m, m, n, channels]))
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
