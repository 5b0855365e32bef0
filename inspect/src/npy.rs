//! NumPy's file formats: `.npy`, an array after a text header, and `.npz`, a zip of such arrays.
//!
//! Implemented here in a dozen lines: version 1.0 of the format, little-endian, C order, with the header padded so that
//! the data begin at a multiple of 64 bytes.

use std::io::{self, Cursor, Write};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, System, ZipWriter};

/// Bytes before the header: magic, version 1.0 and the header's length.
const PREAMBLE_BYTES: usize = 10;
/// Alignment of the data.
const ALIGNMENT_BYTES: usize = 64;
/// zlib's default compression level.
const DEFLATE_LEVEL: i64 = 6;

/// A `.npy` of single-precision values in C order.
pub(crate) fn f32s(shape: &[usize], values: &[f32]) -> Vec<u8> {
    let mut bytes = header("<f4", shape);
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

/// A `.npy` of double-precision values in C order.
pub(crate) fn f64s(shape: &[usize], values: &[f64]) -> Vec<u8> {
    let mut bytes = header("<f8", shape);
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

fn header(kind: &str, shape: &[usize]) -> Vec<u8> {
    // A tuple of one needs a trailing comma in Python; longer tuples may have one.
    let shape: String = shape.iter().map(|side| format!("{side}, ")).collect();
    let mut text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({}), }}", shape.trim_end());
    let unpadded = PREAMBLE_BYTES + text.len() + 1;
    text.extend(std::iter::repeat_n(' ', unpadded.next_multiple_of(ALIGNMENT_BYTES) - unpadded));
    text.push('\n');
    let length = u16::try_from(text.len()).expect("a shape of a few numbers fits into 64 KiB of header");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(length.to_le_bytes());
    bytes.extend(text.into_bytes());
    bytes
}

/// The rows of a `.npy` of single- or double-precision values with the shape `[N, *shape]`, N at most `rows_max`, in C
/// order.
///
/// # Errors
/// What is wrong with the file.
pub(crate) fn rows(bytes: &[u8], shape: &[usize], rows_max: usize) -> Result<Vec<Vec<f64>>, String> {
    let broken = || "the array must be a whole .npy of version 1.0".to_owned();
    let length: usize = match bytes.get(..PREAMBLE_BYTES).ok_or_else(broken)? {
        [0x93, b'N', b'U', b'M', b'P', b'Y', 1, 0, low, high] => usize::from(u16::from_le_bytes([*low, *high])),
        _ => return Err(broken()),
    };
    let header = bytes.get(PREAMBLE_BYTES..PREAMBLE_BYTES + length).ok_or_else(broken)?;
    let (header, data) = (String::from_utf8_lossy(header).replace(' ', ""), &bytes[PREAMBLE_BYTES + length..]);
    let sides = header.split_once("'shape':(").and_then(|(_, rest)| rest.split_once(')')).map(|(sides, _)| sides);
    let sides: Option<Vec<usize>> = sides.map(|sides| sides.split(',').filter_map(|side| side.parse().ok()).collect());
    let size = [4, 8].into_iter().find(|size| header.contains(&format!("'descr':'<f{size}'")));
    let (Some(size), Some([count, rest @ ..])) = (size, sides.as_deref()) else {
        return Err(format!("the array must have real numbers, got {header}"));
    };
    if rest != shape || *count > rows_max || header.contains("'fortran_order':True") {
        return Err(format!(
            "the array must have the shape [N, {shape:?}], N at most {rows_max}, in C order, got {header}"
        ));
    }
    let width: usize = size * shape.iter().product::<usize>();
    if data.len() != count * width {
        return Err(format!("the array must have {} bytes, got {}", count * width, data.len()));
    }
    let number = |bytes: &[u8]| match bytes {
        [a, b, c, d] => f64::from(f32::from_le_bytes([*a, *b, *c, *d])),
        [a, b, c, d, e, f, g, h] => f64::from_le_bytes([*a, *b, *c, *d, *e, *f, *g, *h]),
        _ => f64::NAN,
    };
    Ok(data.chunks_exact(width).map(|row| row.chunks_exact(size).map(number).collect()).collect())
}

/// A `.npz` with one array, as `numpy.savez_compressed(file, name=array)` makes it. The same array always gives the
/// same bytes, without a clock or the system's name.
///
/// # Errors
/// The zip writer's error.
pub(crate) fn npz(name: &str, npy: &[u8]) -> io::Result<Vec<u8>> {
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .compression_level(Some(DEFLATE_LEVEL))
        .last_modified_time(DateTime::default())
        .system(System::Unix)
        .unix_permissions(0o644);
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    zip.start_file(format!("{name}.npy"), options)?;
    zip.write_all(npy)?;
    Ok(zip.finish()?.into_inner())
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    /// The headers that numpy 2.4 writes for these arrays.
    #[test]
    fn headers_are_numpys() {
        let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes[PREAMBLE_BYTES..]).into_owned();
        let grid = header("<f4", &[1, 40, 40, 40]);
        assert_eq!(grid[..8], *b"\x93NUMPY\x01\x00");
        assert_eq!(usize::from(u16::from_le_bytes([grid[8], grid[9]])), grid.len() - PREAMBLE_BYTES);
        assert_eq!(grid.len() % ALIGNMENT_BYTES, 0);
        let told = text(grid);
        assert!(told.starts_with("{'descr': '<f4', 'fortran_order': False, 'shape': (1, 40, 40, 40,), }"), "{told}");
        assert!(told.ends_with(" \n"), "{told}");
        assert!(text(header("<f4", &[3])).contains("'shape': (3,), "));
    }

    #[test]
    fn an_npz_holds_the_array_and_has_no_clock() {
        let npy = f32s(&[2, 2], &[0.0, 1.0, 2.0, -3.5]);
        let bytes = npz("grid", &npy).unwrap();
        assert_eq!(bytes, npz("grid", &npy).unwrap());
        let mut zip = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
        let mut file = zip.by_name("grid.npy").unwrap();
        let time = file.last_modified().unwrap();
        assert_eq!((time.year(), time.month(), time.day(), time.hour(), time.second()), (1980, 1, 1, 0, 0));
        let mut found = Vec::new();
        file.read_to_end(&mut found).unwrap();
        assert_eq!(found, npy);
    }
}
