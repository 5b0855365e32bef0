//! A TSDF as a NumPy array, in VGN's values and VGN's shapes.

use schema::{Grid, VoxelGrid};

use crate::input::error::{InputError, refuse};
use crate::input::npy;

/// Reads the voxels of `grid` from an array of shape `[r, r, r]` or, as VGN stores it, `[1, r, r, r]`.
///
/// # Errors
/// [`InputError`] if the bytes are not an array, its shape differs, or values are outside [0, 1].
pub fn read_tsdf(bytes: &[u8], grid: Grid) -> Result<VoxelGrid, InputError> {
    let (header, data) = npy::split(bytes)?;
    let side = grid.resolution;
    if header.shape != [side; 3] && header.shape != [1, side, side, side] {
        let rule = format!("a TSDF must have the shape [{side}, {side}, {side}] or [1, {side}, {side}, {side}]");
        return refuse(format!("{rule}, got {:?}", header.shape));
    }
    let values = header.decode(data);
    check_values(&values, side)?;
    VoxelGrid::new(grid, values).map_err(InputError::Value)
}

fn check_values(values: &[f32], side: usize) -> Result<(), InputError> {
    let is_wrong = |value: &&f32| !(0.0..=1.0).contains(*value);
    let wrong = values.iter().filter(is_wrong).count();
    let Some(first) = values.iter().position(|value| is_wrong(&value)) else { return Ok(()) };
    let voxel = [first / (side * side), first / side % side, first % side];
    let hint = if values.iter().all(|value| (-1.0..=1.0).contains(value)) {
        ": these look like signed distances; VGN's values are (tsdf + 1) / 2 where a voxel was observed, else 0"
    } else {
        ""
    };
    let got = values[first];
    refuse(format!("a TSDF's values must be between 0 and 1, {wrong} are not, first {got} at voxel {voxel:?}{hint}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::tests::npy_of;

    fn read(shape: &[usize], values: &[f32]) -> Result<VoxelGrid, InputError> {
        read_tsdf(&npy_of(shape, values), Grid::PAPER)
    }

    #[test]
    fn both_of_vgns_shapes_are_read() {
        let mut values = vec![0.0; 64_000];
        values[Grid::PAPER.flat([3, 17, 25])] = 0.5;
        for shape in [vec![40; 3], vec![1, 40, 40, 40]] {
            let voxels = read(&shape, &values).unwrap();
            assert_eq!(voxels.values[(3 * 40 + 17) * 40 + 25], 0.5);
        }
        assert!(read(&[40; 3], &[0.0; 64_000]).is_ok(), "an empty one is for the planner to judge");
    }

    #[test]
    fn other_shapes_are_refused() {
        let message = read(&[20; 3], &[0.0; 8000]).unwrap_err().to_string();
        assert!(message.contains("[40, 40, 40]") && message.ends_with("got [20, 20, 20]"), "{message}");
        assert!(read(&[64_000], &[0.0; 64_000]).is_err());
    }

    #[test]
    fn the_first_wrong_voxel_is_named() {
        let mut values = vec![0.0; 64_000];
        values[Grid::PAPER.flat([3, 17, 25])] = f32::NAN;
        values[Grid::PAPER.flat([3, 17, 26])] = 2.0;
        let message = read(&[40; 3], &values).unwrap_err().to_string();
        assert!(message.contains("2 are not, first NaN at voxel [3, 17, 25]"), "{message}");
        assert!(!message.contains("signed distances"));
        let message = read(&[40; 3], &[-0.5; 64_000]).unwrap_err().to_string();
        assert!(message.contains("64000 are not") && message.contains("signed distances"), "{message}");
    }
}
