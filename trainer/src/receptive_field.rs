//! Which part of the decoder one voxel depends on, and with which weights.
//!
//! A sample supervises one voxel of 40³. The heads see 5³ positions around it; those are made of 4³ positions at 20³
//! (linear upsampling), which the last decoder convolution makes of 8³, which are made of 6³ at 10³, made of 8³, made
//! of the whole 5³. So decoder and heads cost 1/45 of the dense form (30 of 1,349 million multiply-adds a sample), and with the
//! encoder, which is the same in both, the network a twentieth (67 of 1,386).
//!
//! Everything is separable, so a voxel's receptive field is, for each axis and each doubling, one small matrix cut from
//! the doubling matrix of the whole axis ([`Upsampling::window`]). Positions outside the volume have zero rows there:
//! the patch that a convolution sees holds zeros exactly where the dense form pads with zeros. Coarse positions outside
//! the volume have zero columns: a convolution may compute rubbish there, nobody looks at it and no gradient comes
//! back. Hence faces, edges and corners need no special case.

use burn::tensor::{Device, Tensor, TensorData};

use crate::layers::LAYERS;
use crate::upsampling::Upsampling;

/// Voxels along a side of the input and of the output.
pub const RESOLUTION: usize = 40;
/// Positions along a side of the coarsest level, which every sample sees whole.
pub const COARSEST: usize = RESOLUTION / 8;

/// Side lengths of the patches of one voxel, from the heads inwards. The same for every voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PatchSizes {
    /// What the heads see at 40³.
    pub heads_in: usize,
    /// What decoder.conv3 must give at 20³.
    pub conv3_out: usize,
    /// What decoder.conv3 sees at 20³.
    pub conv3_in: usize,
    /// What decoder.conv2 must give at 10³.
    pub conv2_out: usize,
    /// What decoder.conv2 sees at 10³.
    pub conv2_in: usize,
}

impl PatchSizes {
    /// The sizes for an upsampling mode: 5, 4, 8, 6, 8 for linear; 5, 3, 7, 4, 6 for nearest.
    #[must_use]
    pub const fn new(mode: Upsampling) -> Self {
        let heads_in = LAYERS[6].kernel;
        let conv3_out = mode.coarse_len(heads_in);
        let conv3_in = conv3_out + LAYERS[5].kernel - 1;
        let conv2_out = mode.coarse_len(conv3_in);
        let conv2_in = conv2_out + LAYERS[4].kernel - 1;
        Self { heads_in, conv3_out, conv3_in, conv2_out, conv2_in }
    }
}

/// The doubling matrices of a batch of voxels for one axis: each maps a coarse patch to the fine patch that the next
/// convolution sees.
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

/// The three matrices of one voxel coordinate, coarsest first, row by row.
pub(crate) fn axis_windows(coordinate: usize, mode: Upsampling) -> [Vec<f32>; 3] {
    let sizes = PatchSizes::new(mode);
    let heads_start = coordinate as isize - LAYERS[6].padding() as isize;
    let conv3_out_start = mode.first_coarse(heads_start);
    let conv3_in_start = conv3_out_start - LAYERS[5].padding() as isize;
    let conv2_out_start = mode.first_coarse(conv3_in_start);
    let conv2_in_start = conv2_out_start - LAYERS[4].padding() as isize;
    [
        mode.window(COARSEST, (conv2_in_start, sizes.conv2_in), (0, COARSEST)),
        mode.window(2 * COARSEST, (conv3_in_start, sizes.conv3_in), (conv2_out_start, sizes.conv2_out)),
        mode.window(4 * COARSEST, (heads_start, sizes.heads_in), (conv3_out_start, sizes.conv3_out)),
    ]
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
    fn patch_sizes_are_those_worked_out_by_hand() {
        let sizes = |mode| {
            let s = PatchSizes::new(mode);
            [s.heads_in, s.conv3_out, s.conv3_in, s.conv2_out, s.conv2_in]
        };
        assert_eq!(sizes(Upsampling::Linear), [5, 4, 8, 6, 8]);
        assert_eq!(sizes(Upsampling::Nearest), [5, 3, 7, 4, 6]);
    }

    #[test]
    fn every_row_inside_the_volume_keeps_its_whole_weight() {
        for mode in Upsampling::ALL {
            let sizes = PatchSizes::new(mode);
            for coordinate in 0..RESOLUTION {
                let [_, _, to_40] = axis_windows(coordinate, mode);
                for (row, weights) in to_40.chunks(sizes.conv3_out).enumerate() {
                    let inside = (2..RESOLUTION + 2).contains(&(coordinate + row));
                    assert_eq!(weights.iter().sum::<f32>(), f32::from(u8::from(inside)), "{mode:?} {coordinate}");
                }
            }
        }
    }
}
