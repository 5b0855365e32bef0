//! Files for the readers' tests, and tests of all readers: valid files of every format are damaged at random thousands
//! of times, and a reader must return a result and not panic. The damage is drawn from a fixed sequence, so failures
//! are reproducible.

use png::{BitDepth, ColorType};
use schema::Grid;

use crate::input::assemble::from_json;
use crate::input::cloud::read_cloud;
use crate::input::depth::read_depth;
use crate::input::lens_file::read_intrinsics;
use crate::input::tsdf::read_tsdf;

/// An array file (version 1.0, `<f4`, C order) of these values.
pub(crate) fn npy_of(shape: &[usize], values: &[f32]) -> Vec<u8> {
    let axes: String = shape.iter().map(|axis| format!("{axis}, ")).collect();
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}), }}", axes.trim_end());
    // NumPy aligns the data to 64 bytes; the header ends with a newline.
    let header = format!("{header:<117}\n");
    assert_eq!(header.len(), 118, "the shape must be short");
    let data: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    [b"\x93NUMPY\x01\x00\x76\x00", header.as_bytes(), &data].concat()
}

/// A grey PNG of 16 bits.
pub(crate) fn png_of(width: u32, height: u32, units: &[u16]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(BitDepth::Sixteen);
    let mut writer = encoder.write_header().unwrap();
    let pixels: Vec<u8> = units.iter().flat_map(|unit| unit.to_be_bytes()).collect();
    writer.write_image_data(&pixels).unwrap();
    writer.finish().unwrap();
    bytes
}

/// Reproducible pseudo-random numbers (splitmix64).
struct Draws(u64);

impl Draws {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ (mixed >> 31)) % limit.max(1) as u64) as usize
    }

    /// The file with one to four random changes.
    fn damaged(&mut self, whole: &[u8]) -> Vec<u8> {
        let mut bytes = whole.to_vec();
        for _ in 0..=self.below(4) {
            let at = self.below(bytes.len());
            match self.below(6) {
                0 => bytes.truncate(at),
                1 => bytes.insert(at, self.below(256) as u8),
                2 if at < bytes.len() => bytes[at] ^= 1 << self.below(8),
                3 if at < bytes.len() => bytes[at] = [0, 1, 0x7f, 0x80, 0xff, b'9'][self.below(6)],
                4 if at + 4 <= bytes.len() => bytes[at..at + 4].fill(0xff),
                _ => {
                    let from = self.below(bytes.len());
                    let piece = bytes[from..(from + 16).min(bytes.len())].to_vec();
                    drop(bytes.splice(at..at, piece));
                }
            }
        }
        bytes
    }
}

fn for_each_damage(whole: &[u8], times: u64, read: impl Fn(&[u8])) {
    read(whole);
    for number in 0..times {
        read(&Draws(number).damaged(whole));
    }
}

#[test]
fn damaged_depth_images_are_answered() {
    for file in [png_of(8, 8, &(0..64).map(|i| 500 + i).collect::<Vec<_>>()), npy_of(&[2, 3], &[0.5; 6])] {
        for_each_damage(&file, 700, |bytes| {
            let _ = read_depth(bytes, None, usize::MAX);
        });
    }
}

#[test]
fn damaged_clouds_and_grids_are_answered() {
    for_each_damage(&npy_of(&[4, 3], &[0.5; 12]), 2000, |bytes| {
        let _ = read_cloud(bytes);
    });
    let small = Grid { resolution: 2, ..Grid::PAPER };
    for_each_damage(&npy_of(&[2; 3], &[0.5; 8]), 2000, |bytes| {
        let _ = read_tsdf(bytes, small);
    });
}

#[test]
fn damaged_intrinsics_are_answered() {
    let files = [
        &b"[[5.0, 0.0, 2.0], [0.0, 5.0, 1.5], [0.0, 0.0, 1.0]]"[..],
        &npy_of(&[3, 3], &[0.5; 9]),
        br#"{ "fx_px": 5, "distortion_coefficients": [1, 0, 0] }"#,
        b"fx_px = 1",
    ];
    for file in files {
        for_each_damage(file, 2000, |bytes| {
            let _ = read_intrinsics(bytes);
        });
    }
}

#[test]
fn damaged_requests_are_answered() {
    let request = br#"{ "views": [{ "depth": { "data": "iVBORw0KGgo=" }, "depth_scale_m": 0.001,
        "intrinsics": { "fx_px": 540, "fy_px": 540, "cx_px": 320, "cy_px": 240 },
        "workspace_from_camera": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]] }],
        "base_from_workspace": { "position_m": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1] },
        "policy": "paper", "grasps_max": 10, "explain": true }"#;
    for_each_damage(request, 5000, |bytes| {
        let _ = from_json(bytes, Grid::PAPER);
    });
}
