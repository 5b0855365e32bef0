//! Convolutions as matrix products: gathers inputs into rows.
//!
//! A feature map is a matrix `[positions, channels]`. One output of a convolution is the product of the row of its
//! kernel³ · channels inputs with the weights, so a whole convolution is one gather of rows and one large product.
//! Kernel positions run x slowest, z fastest, channels fastest of all.

use burn::tensor::{Device, Int, Tensor, TensorData};

use network::layers::{LAYERS, LayerShape, positions};
use network::receptive_field::RESOLUTION;

/// The inputs of the first layer, gathered on the host: they need no gradient.
///
/// Shape: `[grids · 20³, 125]`. Each grid has 40³ values, x slowest.
#[must_use]
pub fn first_columns(grids: &[&[f32]], device: &Device) -> Tensor<2> {
    let (layer, all) = (LAYERS[0], grids.concat());
    let rows = rows_of(grids.len(), RESOLUTION, layer, layer.padding());
    let values: Vec<f32> = rows.iter().map(|row| all.get(*row as usize).copied().unwrap_or(0.0)).collect();
    Tensor::from_data(TensorData::new(values, [rows.len() / layer.fan_in(), layer.fan_in()]), device)
}

/// Row indices that gather the inputs of a convolution over cubes of positions.
///
/// Input positions: `cubes` cubes of `n`³ rows, then, if there is padding, one row of zeros for everything outside.
/// Output: (n + 2 · padding − kernel) / stride + 1 positions a side of each cube, each with kernel³ entries.
#[must_use]
pub fn input_rows(cubes: usize, n: usize, layer: LayerShape, padding: usize, device: &Device) -> Tensor<1, Int> {
    let rows = rows_of(cubes, n, layer, padding);
    let count = rows.len();
    Tensor::from_data(TensorData::new(rows, [count]), device)
}

fn rows_of(cubes: usize, n: usize, LayerShape { kernel, stride, .. }: LayerShape, padding: usize) -> Vec<i64> {
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
    rows
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
                assert_eq!(columns[row * 125 + number], expected, "{output:?} {tap:?}");
            }
        }
        assert_eq!(columns.len(), 8_000 * 125);
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
