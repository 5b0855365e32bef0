//! Which part of the decoder one voxel depends on, and with which weights.
//!
//! A sample supervises one voxel of 40³. The heads see 5³ positions around it; those are made of 4³ positions at 20³
//! (linear upsampling), which the last decoder convolution makes of 8³, which are made of 6³ at 10³, made of 8³, made
//! of the whole 5³. So decoder and heads cost 1/45 of the dense form (30 of 1,349 million multiply-adds a sample), and
//! with the encoder, which is the same in both, the network a twentieth (67 of 1,386).
//!
//! Everything is separable, so a voxel's receptive field is, for each axis and each doubling, one small matrix cut from
//! the doubling matrix of the whole axis ([`Upsampling::window`]). Positions outside the volume have zero rows there:
//! the patch that a convolution sees holds zeros exactly where the dense form pads with zeros. Coarse positions outside
//! the volume have zero columns: a convolution may compute rubbish there, nobody looks at it and no gradient comes
//! back. Hence faces, edges and corners need no special case.
//!
//! The samples of a grid depend on many of the same positions at 10³, 216 each of 1,000, so on the host the layer there
//! is evaluated once at each position that any of them needs ([`positions_at_10`]).

use core::ops::Range;

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

/// The three matrices of one voxel coordinate, coarsest first, row by row.
#[must_use]
pub fn axis_windows(coordinate: usize, mode: Upsampling) -> [Vec<f32>; 3] {
    let sizes = PatchSizes::new(mode);
    let heads_start = coordinate as isize - LAYERS[6].padding() as isize;
    let conv3_out_start = mode.first_coarse(heads_start);
    let conv3_in_start = conv3_out_start - LAYERS[5].padding() as isize;
    let conv2_out_start = mode.first_coarse(conv3_in_start);
    let conv2_in_start = conv2_out_start - LAYERS[4].padding() as isize;
    [
        mode.window(COARSEST, conv2_in_start, sizes.conv2_in, 0, COARSEST),
        mode.window(2 * COARSEST, conv3_in_start, sizes.conv3_in, conv2_out_start, sizes.conv2_out),
        mode.window(4 * COARSEST, heads_start, sizes.heads_in, conv3_out_start, sizes.conv3_out),
    ]
}

/// The second matrix of [`axis_windows`] with columns for all ten positions, of which it needs [`positions_at_10`].
#[must_use]
pub fn window_from_whole_10(coordinate: usize, mode: Upsampling) -> Vec<f32> {
    let sizes = PatchSizes::new(mode);
    mode.window(2 * COARSEST, conv3_in_start(coordinate, mode), sizes.conv3_in, 0, 2 * COARSEST)
}

/// The positions at 10³ that one voxel coordinate depends on.
#[must_use]
pub fn positions_at_10(coordinate: usize, mode: Upsampling) -> Range<usize> {
    let start = mode.first_coarse(conv3_in_start(coordinate, mode));
    let end = start + PatchSizes::new(mode).conv2_out as isize;
    start.max(0) as usize..(end as usize).min(2 * COARSEST)
}

/// First position at 20³, inside or outside the volume, that decoder.conv3 sees.
fn conv3_in_start(coordinate: usize, mode: Upsampling) -> isize {
    let heads_start = coordinate as isize - LAYERS[6].padding() as isize;
    mode.first_coarse(heads_start) - LAYERS[5].padding() as isize
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
