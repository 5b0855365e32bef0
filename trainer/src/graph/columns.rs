//! Convolutions as matrix products: gathers inputs into rows.
//!
//! A feature map is a matrix `[positions, channels]`. One output of a convolution is the product of the row of its
//! kernel³ · channels inputs with the weights, so a whole convolution is one gather of rows and one large product.
//! Kernel positions run x slowest, z fastest, channels fastest of all; [`super::matrices`] has the same order of
//! weights.

use burn::tensor::{Device, Int, Tensor, TensorData};
use rayon::prelude::*;

use network::layers::{LAYERS, positions};
use network::receptive_field::RESOLUTION;

/// Columns of the first layer's gathered input: 5³ voxels, and a one that multiplies the bias.
pub const FIRST_COLUMNS: usize = LAYERS[0].kernel.pow(3) + 1;
/// Positions of the first layer's output in one grid: 20³.
pub const FIRST_ROWS: usize = (RESOLUTION / 2).pow(3);

/// The inputs of the first layer, gathered on the host: they need no gradient.
///
/// The last column is one, and a row of zeros follows the grids' rows: its product is 0 for any bias, and after ReLU it
/// is the zero padding of the second layer.
///
/// Shape: `[grids · 20³ + 1, 126]`. Each grid has 40³ values, x slowest.
#[must_use]
pub fn first_columns(grids: &[&[f32]], device: &Device) -> Tensor<2> {
    let rows = grids.len() * FIRST_ROWS + 1;
    let mut values = vec![0.0; rows * FIRST_COLUMNS];
    let plane = (RESOLUTION / 2).pow(2) * FIRST_COLUMNS;
    let (body, _zero_row) = values.split_at_mut(grids.len() * FIRST_ROWS * FIRST_COLUMNS);
    body.par_chunks_mut(plane).enumerate().for_each(|(number, rows)| {
        gather_plane(grids[number / (RESOLUTION / 2)], number % (RESOLUTION / 2), rows);
    });
    Tensor::from_data(TensorData::new(values, [rows, FIRST_COLUMNS]), device)
}

/// The rows of the outputs with x = `plane` of one grid.
fn gather_plane(grid: &[f32], plane: usize, rows: &mut [f32]) {
    const N: usize = RESOLUTION;
    const K: usize = LAYERS[0].kernel;
    let first = |output: usize| (2 * output) as isize - LAYERS[0].padding() as isize;
    for (at, row) in rows.chunks_exact_mut(FIRST_COLUMNS).enumerate() {
        let (y, z) = (at / (N / 2), at % (N / 2));
        row[FIRST_COLUMNS - 1] = 1.0;
        for (number, run) in row[..FIRST_COLUMNS - 1].chunks_exact_mut(K).enumerate() {
            let (ix, iy) = (first(plane) + (number / K) as isize, first(y) + (number % K) as isize);
            if !(0..N as isize).contains(&ix) || !(0..N as isize).contains(&iy) {
                continue;
            }
            let line = &grid[(ix as usize * N + iy as usize) * N..][..N];
            let start = first(z);
            let (skip, from) = if start < 0 { ((-start) as usize, 0) } else { (0, start as usize) };
            let count = (K - skip).min(N - from);
            run[skip..skip + count].copy_from_slice(&line[from..from + count]);
        }
    }
}

/// Row indices that gather the inputs of a padded convolution over whole grids.
///
/// Input positions: `grids` cubes of `n`³ rows, then one row of zeros for everything outside. Output:
/// (n / stride)³ positions a grid, each with kernel³ entries.
#[must_use]
pub fn padded_rows(grids: usize, n: usize, kernel: usize, stride: usize, device: &Device) -> Tensor<1, Int> {
    let (outputs, padding) = (n.div_ceil(stride), kernel / 2);
    let zero_row = (grids * n.pow(3)) as i64;
    let mut rows = Vec::with_capacity(grids * outputs.pow(3) * kernel.pow(3));
    for grid in 0..grids {
        for output in positions(outputs) {
            for tap in positions(kernel) {
                let place = |axis: usize| (output[axis] * stride + tap[axis]).checked_sub(padding).filter(|p| *p < n);
                rows.push(match (place(0), place(1), place(2)) {
                    (Some(x), Some(y), Some(z)) => (((grid * n + x) * n + y) * n + z) as i64,
                    _ => zero_row,
                });
            }
        }
    }
    index_tensor(rows, device)
}

/// Row indices that gather the inputs of an unpadded convolution of stride 1 over patches.
///
/// Input positions: `patches` cubes of `n`³ rows. Output: (n − kernel + 1)³ positions a patch, each with kernel³
/// entries.
#[must_use]
pub fn valid_rows(patches: usize, n: usize, kernel: usize, device: &Device) -> Tensor<1, Int> {
    let outputs = n + 1 - kernel;
    let mut rows = Vec::with_capacity(patches * outputs.pow(3) * kernel.pow(3));
    for patch in 0..patches {
        for output in positions(outputs) {
            for tap in positions(kernel) {
                let at = |axis: usize| output[axis] + tap[axis];
                rows.push((((patch * n + at(0)) * n + at(1)) * n + at(2)) as i64);
            }
        }
    }
    index_tensor(rows, device)
}

fn index_tensor(rows: Vec<i64>, device: &Device) -> Tensor<1, Int> {
    let count = rows.len();
    Tensor::from_data(TensorData::new(rows, [count]), device)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_layers_rows_hold_the_voxels_under_the_kernel() {
        let grid: Vec<f32> = (0..RESOLUTION.pow(3)).map(|v| v as f32 + 1.0).collect();
        let columns = first_columns(&[&grid], &Device::flex()).into_data().try_to_vec::<f32>().unwrap();
        for output in [[0, 0, 0], [19, 19, 19], [0, 7, 19], [11, 3, 5]] {
            let row = (output[0] * 20 + output[1]) * 20 + output[2];
            for (number, tap) in positions(5).enumerate() {
                let voxel = [0, 1, 2].map(|axis| (2 * output[axis] + tap[axis]) as isize - 2);
                let inside = voxel.iter().all(|v| (0..40).contains(v));
                let expected = if inside { ((voxel[0] * 40 + voxel[1]) * 40 + voxel[2]) as f32 + 1.0 } else { 0.0 };
                assert_eq!(columns[row * FIRST_COLUMNS + number], expected, "{output:?} {tap:?}");
            }
            assert_eq!(columns[row * FIRST_COLUMNS + 125], 1.0);
        }
        assert!(columns[8_000 * FIRST_COLUMNS..].iter().all(|v| *v == 0.0));
    }

    #[test]
    fn padded_rows_point_at_the_zero_row_outside() {
        let rows = padded_rows(2, 4, 3, 2, &Device::flex()).into_data().iter::<i64>().collect::<Vec<_>>();
        assert_eq!(rows.len(), 2 * 8 * 27);
        assert_eq!(rows.iter().filter(|r| **r == 128).count(), 2 * (8 * 27 - 5_usize.pow(3)));
        assert_eq!(rows[13], 0, "the middle of the first output's kernel is the first voxel");
        assert_eq!(*rows.last().unwrap(), 127);
    }
}
