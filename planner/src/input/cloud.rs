//! Point clouds from PLY, PCD and NumPy files, distinguished by their first bytes. The declared number of points is
//! checked against the file's length before memory is allocated.

use schema::Vec3;

use crate::input::error::{InputError, refuse};
use crate::input::points::{ReadCloud, check_count};
use crate::input::{npy, pcd, ply};

/// Reads a cloud.
///
/// # Errors
/// [`InputError`] if the format is unknown, the bytes are damaged, or there are no coordinates or too many points.
pub(crate) fn read_cloud(bytes: &[u8]) -> Result<ReadCloud, InputError> {
    if npy::is_npy(bytes) {
        read_array(bytes)
    } else if ply::is_ply(bytes) {
        ply::read_ply(bytes)
    } else if pcd::is_pcd(bytes) {
        pcd::read_pcd(bytes)
    } else {
        Err(InputError::Damaged("a cloud must be a PLY, PCD or NPY file, got other bytes".to_owned()))
    }
}

/// An array of points, one per row or, for an organised cloud, one per pixel; columns after the third are ignored.
fn read_array(bytes: &[u8]) -> Result<ReadCloud, InputError> {
    let (header, data) = npy::split(bytes)?;
    let is_transposed = matches!(header.shape[..], [3 | 4, .., last] if last > 4);
    let (points, columns) = match header.shape[..] {
        [points, columns] if columns >= 3 && !is_transposed => (points, columns),
        [height, width, columns] if columns >= 3 && !is_transposed => (height.saturating_mul(width), columns),
        _ => {
            let (shape, hint) =
                (&header.shape, if is_transposed { ": is it transposed? save its transpose" } else { "" });
            return refuse(format!("a cloud must have the shape [N, 3] or [H, W, 3], got {shape:?}{hint}"));
        }
    };
    check_count(points, data.len(), columns)?;
    let values = header.decode(data);
    let points_m = values.chunks_exact(columns).map(|row| Vec3::new(row[0], row[1], row[2])).collect();
    Ok(ReadCloud::of(points_m, None))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::points::POINTS_MAX;
    use crate::input::tests::npy_of;

    #[test]
    fn arrays_give_their_first_three_columns() {
        let rows = [1.0, 2.0, 3.0, 9.0, 4.0, f32::NAN, 6.0, 9.0, 7.0, 8.0, 9.0, 9.0];
        let wanted =
            ReadCloud { points_m: vec![Vec3::new(1.0, 2.0, 3.0), Vec3::new(7.0, 8.0, 9.0)], eye_m: None, dropped: 1 };
        assert_eq!(read_cloud(&npy_of(&[3, 4], &rows)).unwrap(), wanted);
        assert_eq!(read_cloud(&npy_of(&[1, 3, 4], &rows)).unwrap(), wanted);
    }

    #[test]
    fn other_shapes_and_formats_are_refused() {
        let message = |bytes: &[u8]| read_cloud(bytes).unwrap_err().to_string();
        assert!(message(&npy_of(&[3], &[0.0; 3])).contains("[N, 3] or [H, W, 3], got [3]"));
        assert!(message(&npy_of(&[3, 2], &[0.0; 6])).contains("got [3, 2]"));
        for transposed in [&[3, 5][..], &[4, 6], &[3, 2, 8]] {
            let zeros = vec![0.0; transposed.iter().product()];
            let message = message(&npy_of(transposed, &zeros));
            assert!(message.contains(&format!("got {transposed:?}: is it transposed?")), "{message}");
        }
        assert!(message(b"solid stl").contains("PLY, PCD or NPY"));
    }

    #[test]
    fn too_many_points_are_refused() {
        assert!(check_count(POINTS_MAX, usize::MAX, 12).is_ok());
        assert!(matches!(check_count(POINTS_MAX + 1, usize::MAX, 12), Err(InputError::Value(_))));
        assert!(matches!(check_count(10, 119, 12), Err(InputError::Damaged(_))));
    }
}
