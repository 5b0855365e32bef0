//! NumPy's file format `.npy`: an array after a text header.
//!
//! Implemented here in a dozen lines: version 1.0 of the format, little-endian, C order, with the header padded so that
//! the data begin at a multiple of 64 bytes.

/// Bytes before the header: magic, version 1.0 and the header's length.
const PREAMBLE_BYTES: usize = 10;
/// Alignment of the data.
const ALIGNMENT_BYTES: usize = 64;

/// A `.npy` of single-precision values in C order.
pub(crate) fn f32s(shape: &[usize], values: &[f32]) -> Vec<u8> {
    let mut bytes = header("<f4", shape);
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

#[cfg(test)]
mod tests {
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
}
