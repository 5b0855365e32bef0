//! Tests of reading LZF.

use super::*;

/// A simple compressor: at each position the longest reference, found by trying all.
pub(crate) fn compress(data: &[u8]) -> Vec<u8> {
    let (mut out, mut at) = (Vec::new(), 0);
    while at < data.len() {
        let same = |from: usize| (0..264.min(data.len() - at)).take_while(|i| data[from + i] == data[at + i]).count();
        let best = (at.saturating_sub(8192)..at).map(|from| (same(from), from)).max();
        match best {
            Some((length, from)) if length >= 3 => {
                let (back, code) = (at - from - 1, length - 2);
                out.push(((code.min(7) << 5) | (back >> 8)) as u8);
                if code >= 7 {
                    out.push((code - 7) as u8);
                }
                out.push((back & 255) as u8);
                at += length;
            }
            _ => {
                out.extend([0, data[at]]);
                at += 1;
            }
        }
    }
    out
}

#[test]
fn what_was_compressed_comes_back() {
    let noise: Vec<u8> = (0..3000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let waves: Vec<u8> = (0..3000_u32).map(|i| (i % 97 / 3) as u8).collect();
    for data in [vec![], vec![7], vec![0; 2000], noise, waves] {
        assert_eq!(decompress(&compress(&data), data.len()), Some(data));
    }
    assert_eq!(decompress(&[2, b'a', b'b', b'c', 0x20, 2], 6), Some(b"abcabc".to_vec()), "written by hand");
}

#[test]
fn nonsense_is_refused() {
    assert_eq!(decompress(&[5, 1, 2], 6), None, "too few literals");
    assert_eq!(decompress(&[0x20, 0], 3), None, "a reference to before the beginning");
    assert_eq!(decompress(&[0, 7, 0xe0, 255], 400), None, "a reference cut short");
    assert_eq!(decompress(&[0, 7, 0xe0, 255, 0], 100), None, "more than promised");
    assert_eq!(decompress(&[0, 7], 2), None, "less than promised");
    assert_eq!(decompress(&[0, 7], usize::MAX), None, "far less than promised");
}
