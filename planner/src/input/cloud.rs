//! Point clouds from NumPy files. The shape is checked against the file's length before memory is allocated. The Python
//! package makes such files of others.

use schema::Vec3;

use crate::input::error::{InputError, refuse};
use crate::input::npy;

/// Maximum number of points of a cloud: 16 depth images of 640 x 480.
const POINTS_MAX: usize = 5_000_000;

/// Reads an array of points, in metres: one per row or, for an organised cloud, one per pixel; columns after the third
/// are ignored. Points that are not finite are left out, and counted.
///
/// # Errors
/// [`InputError`] if the bytes are no such array, or there are too many points.
pub(crate) fn read_cloud(bytes: &[u8]) -> Result<(Vec<Vec3>, usize), InputError> {
    if !npy::is_npy(bytes) {
        let others: [&[u8]; 5] = [b"ply\n", b"ply\r", b"# .PCD", b"VERSION", b"FIELDS"];
        let got = if others.iter().any(|begin| bytes.starts_with(begin)) {
            "a PLY or PCD file: the program of the Python package (pip install graspmill) takes it as --cloud"
        } else {
            "other bytes"
        };
        return Err(InputError::Damaged(format!("a cloud must be an NPY file, got {got}")));
    }
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
    if points > POINTS_MAX {
        return refuse(format!("a cloud must have at most {POINTS_MAX} points, got {points}"));
    }
    let values = header.decode(data);
    let rows = values.chunks_exact(columns).map(|row| Vec3::new(row[0], row[1], row[2]));
    let points_m: Vec<Vec3> = rows.filter(|point| point.is_finite()).collect();
    let dropped = points - points_m.len();
    Ok((points_m, dropped))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::tests::npy_of;

    #[test]
    fn arrays_give_their_first_three_columns() {
        let rows = [1.0, 2.0, 3.0, 9.0, 4.0, f32::NAN, 6.0, 9.0, 7.0, 8.0, 9.0, 9.0];
        let wanted = (vec![Vec3::new(1.0, 2.0, 3.0), Vec3::new(7.0, 8.0, 9.0)], 1);
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
        assert_eq!(message(b"solid stl"), "a cloud must be an NPY file, got other bytes");
        for other in [&b"ply\nformat ascii 1.0\n"[..], b"ply\r\n", b"# .PCD v0.7\n", b"VERSION 0.7\n"] {
            assert!(message(other).contains("got a PLY or PCD file: the program of the Python package"));
        }
        let mut many = npy_of(&[POINTS_MAX + 1, 3], &[]);
        let dtype = many.windows(3).position(|word| word == b"<f4").unwrap();
        many[dtype..dtype + 3].copy_from_slice(b"|u1");
        many.resize(many.len() + 3 * (POINTS_MAX + 1), 0);
        assert!(message(&many).contains("at most 5000000 points, got 5000001"));
    }
}
