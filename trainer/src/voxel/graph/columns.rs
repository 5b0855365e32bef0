//! Convolutions as matrix products: gathers inputs into rows.
//!
//! A feature map is a matrix `[positions, channels]`. One output of a convolution is the product of the row of its
//! kernel³ · channels inputs with the weights, so a whole convolution is one gather of rows and one large product.
//! Kernel positions run x slowest, z fastest, channels fastest of all.

use burn::tensor::{Device, Int, Tensor, TensorData};
use rayon::prelude::*;

use network::layers::{LAYERS, LayerShape, positions};
use network::receptive_field::RESOLUTION;

/// Columns of the first layer's gathered input: 5³ voxels.
const FIRST_COLUMNS: usize = LAYERS[0].kernel.pow(3);
/// Positions along a side of the first layer's output.
const FIRST_SIDE: usize = RESOLUTION / 2;

/// The inputs of the first layer, gathered on the host: they need no gradient.
///
/// Shape: `[grids · 20³, 125]`. Each grid has 40³ values, x slowest.
#[must_use]
pub fn first_columns(grids: &[&[f32]], device: &Device) -> Tensor<2> {
    let rows = grids.len() * FIRST_SIDE.pow(3);
    let mut values = vec![0.0; rows * FIRST_COLUMNS];
    let planes = values.par_chunks_mut(FIRST_SIDE.pow(2) * FIRST_COLUMNS);
    planes.enumerate().for_each(|(number, rows)| {
        gather_plane(grids[number / FIRST_SIDE], number % FIRST_SIDE, rows);
    });
    Tensor::from_data(TensorData::new(values, [rows, FIRST_COLUMNS]), device)
}

/// The rows of the outputs with x = `plane` of one grid.
fn gather_plane(grid: &[f32], plane: usize, rows: &mut [f32]) {
    const N: usize = RESOLUTION;
    const K: usize = LAYERS[0].kernel;
    let first = |output: usize| (2 * output) as isize - LAYERS[0].padding() as isize;
    for (at, row) in rows.chunks_exact_mut(FIRST_COLUMNS).enumerate() {
        let (y, z) = (at / FIRST_SIDE, at % FIRST_SIDE);
        for (number, run) in row.chunks_exact_mut(K).enumerate() {
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

/// Row indices that gather the inputs of a convolution over cubes of positions.
///
/// Input positions: `cubes` cubes of `n`³ rows, then, if there is padding, one row of zeros for everything outside.
/// Output: (n + 2 · padding − kernel) / stride + 1 positions a side of each cube, each with kernel³ entries.
#[must_use]
pub fn input_rows(
    cubes: usize,
    n: usize,
    LayerShape { kernel, stride, .. }: LayerShape,
    padding: usize,
    device: &Device,
) -> Tensor<1, Int> {
    let outputs = (n + 2 * padding - kernel) / stride + 1;
    let zero_row = (cubes * n.pow(3)) as i64;
    let mut rows = Vec::with_capacity(cubes * outputs.pow(3) * kernel.pow(3));
    for cube in 0..cubes {
        for output in positions(outputs) {
            for tap in positions(kernel) {
                let place = |axis: usize| (output[axis] * stride + tap[axis]).checked_sub(padding).filter(|p| *p < n);
                rows.push(match (place(0), place(1), place(2)) {
                    (Some(x), Some(y), Some(z)) => (((cube * n + x) * n + y) * n + z) as i64,
                    _ => zero_row,
                });
            }
        }
    }
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
        }
        assert_eq!(columns.len(), 8_000 * FIRST_COLUMNS);
    }

    #[test]
    fn padded_rows_point_at_the_zero_row_outside() {
        let layer = LAYERS[1];
        assert_eq!((layer.kernel, layer.stride), (3, 2));
        let rows = input_rows(2, 4, layer, 1, &Device::flex()).into_data().iter::<i64>().collect::<Vec<_>>();
        assert_eq!(rows.len(), 2 * 8 * 27);
        assert_eq!(rows.iter().filter(|r| **r == 128).count(), 2 * (8 * 27 - 5_usize.pow(3)));
        assert_eq!(rows[13], 0, "the middle of the first output's kernel is the first voxel");
        assert_eq!(*rows.last().unwrap(), 127);
    }
}
