//! A doubling and the convolution after it as one convolution at the coarse level.
//!
//! Of the 5³ fine positions around a fine voxel, linear upsampling makes 4³ coarse ones, so their weights can be folded
//! into coarse ones once and for all. The eight fine voxels of a coarse cell (its phases) see 5³ coarse positions
//! together: one product with eight times the columns gives them all, at half the arithmetic of doubling first, and the
//! fine volume is never written. Fine neighbours outside the volume are the zeros that the convolution pads with, so
//! the first and the last cell of an axis have weights of their own: 3³ sets. (Coarse neighbours just outside must be
//! those just inside, on which the doubling holds.)

use rayon::prelude::*;

use crate::layers::LAYERS;
use crate::upsampling::Upsampling;

use super::parameters::HEADS;
use super::tile::LANES;

/// Side of the kernel, at the fine level and at the coarse one.
pub(crate) const KERNEL: usize = LAYERS[HEADS].kernel;
/// Fine voxels of a coarse cell.
pub(crate) const PHASES: usize = 8;
/// First, inner and last cells of an axis.
const CLASSES: usize = 3;

const CHANNELS: usize = LAYERS[HEADS].channels_in;

/// The heads at the coarse level.
#[derive(Debug, Clone)]
pub(crate) struct FoldedHeads {
    /// For each class of cells `[kernel x, kernel y, kernel z, channels, columns]`: each phase's outputs, padded to a
    /// multiple of [`LANES`].
    weights: Vec<Vec<f32>>,
    bias: Vec<f32>,
}

/// What one fine coordinate of a cell takes from the coarse positions around it: `[fine tap][coarse tap]`.
type Fold = Vec<f32>;

impl FoldedHeads {
    /// From the heads' stage, `[fan in, columns]` and `[columns]`, of which the first `outputs` are used, for a volume
    /// of `n` coarse cells a side.
    pub(crate) fn new(weights: &[f32], bias: &[f32], outputs: usize, n: usize, mode: Upsampling) -> Self {
        let columns = (PHASES * outputs).next_multiple_of(LANES);
        let padding = LAYERS[HEADS].padding() as isize;
        let fold = |cell: usize, phase: usize| -> Fold {
            let (cell, phase) = (cell as isize, phase as isize);
            mode.window(n, 2 * cell + phase - padding, KERNEL, cell - padding, KERNEL)
        };
        let folds: Vec<[Fold; 2]> = [0, n / 2, n - 1].map(|cell| [fold(cell, 0), fold(cell, 1)]).to_vec();
        let used: Vec<f32> = weights.chunks_exact(bias.len()).flat_map(|row| row[..outputs].to_vec()).collect();
        let classes = (0..CLASSES.pow(3)).into_par_iter().map(|class| {
            let axes = [class / (CLASSES * CLASSES), class / CLASSES % CLASSES, class % CLASSES];
            let mut folded = vec![0.0; KERNEL.pow(3) * CHANNELS * columns];
            for phase in 0..PHASES {
                let [x, y, z] = [0, 1, 2].map(|axis| &folds[axes[axis]][phase >> (2 - axis) & 1]);
                let along_z = contract(&used, KERNEL.pow(2), z);
                let along_y = contract(&along_z, KERNEL, y);
                let of_phase = contract(&along_y, 1, x);
                for (from, to) in of_phase.chunks_exact(outputs).zip(folded.chunks_exact_mut(columns)) {
                    to[phase * outputs..][..outputs].copy_from_slice(from);
                }
            }
            folded
        });
        let mut of_phases = bias[..outputs].repeat(PHASES);
        of_phases.resize(columns, 0.0);
        Self { weights: classes.collect(), bias: of_phases }
    }

    /// The class of a cell's coordinate in a volume of `n` cells a side.
    pub(crate) const fn class(cell: usize, n: usize) -> usize {
        if cell == 0 {
            0
        } else if cell + 1 == n {
            2
        } else {
            1
        }
    }

    /// The weights of the cells of three classes, `[kernel³ · channels, columns]`.
    pub(crate) fn weights(&self, [x, y, z]: [usize; 3]) -> &[f32] {
        &self.weights[(x * CLASSES + y) * CLASSES + z]
    }

    /// What each column begins with.
    pub(crate) fn bias(&self) -> &[f32] {
        &self.bias
    }
}

/// `[outer, fine taps, inner]` and `[fine taps, coarse taps]` to `[outer, coarse taps, inner]`.
fn contract(weights: &[f32], outer: usize, fold: &Fold) -> Vec<f32> {
    let inner = weights.len() / (outer * KERNEL);
    let mut folded = vec![0.0; weights.len()];
    for (from, to) in weights.chunks_exact(KERNEL * inner).zip(folded.chunks_exact_mut(KERNEL * inner)) {
        for (from, row) in from.chunks_exact(inner).zip(fold.chunks_exact(KERNEL)) {
            for (to, share) in to.chunks_exact_mut(inner).zip(row) {
                for (to, from) in to.iter_mut().zip(from) {
                    *to += share * from;
                }
            }
        }
    }
    folded
}
