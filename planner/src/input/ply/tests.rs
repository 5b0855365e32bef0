//! Tests of reading PLY files.

use schema::Vec3;

use super::*;

const BEFORE: &str = "element camera 1\nproperty float view_px\nproperty list uchar int parts\n";
const VERTEX: &str = "property uchar red\nproperty double z\nproperty float x\nproperty float y\n";

/// A PLY file with a camera before its vertices, whose columns are out of order.
fn ply(encoding: &str, count: usize, data: &[u8]) -> Vec<u8> {
    let header =
        format!("ply\nformat {encoding} 1.0\ncomment hello\n{BEFORE}element vertex {count}\n{VERTEX}end_header\n");
    [header.as_bytes(), data].concat()
}

fn text() -> Vec<u8> {
    ply("ascii", 3, b"0.5 2 7 8\n255 3.0 1 2e0\r\n0 nan .5 -1.\n1 inf 1 1")
}

/// Two points in the byte order of the closures.
pub(crate) fn binary(encoding: &str, f32_bytes: fn(f32) -> [u8; 4], f64_bytes: fn(f64) -> [u8; 8]) -> Vec<u8> {
    let list = [f32_bytes(0.5).as_slice(), &[1], &[0; 4]].concat();
    let point = |xyz: [f32; 3]| {
        [[9].as_slice(), &f64_bytes(f64::from(xyz[2])), &f32_bytes(xyz[0]), &f32_bytes(xyz[1])].concat()
    };
    let data = [list, point([1.0, 2.0, 3.0]), point([-1.0, 0.25, 0.5])].concat();
    ply(encoding, 2, &data)
}

#[test]
fn text_is_read_with_nan_and_short_numbers() {
    let read = read_ply(&text()).unwrap();
    assert_eq!(read, ReadCloud { points_m: vec![Vec3::new(1.0, 2.0, 3.0)], eye_m: None, dropped: 2 });
}

#[test]
fn both_byte_orders_are_read() {
    let wanted = [Vec3::new(1.0, 2.0, 3.0), Vec3::new(-1.0, 0.25, 0.5)];
    let little = binary("binary_little_endian", f32::to_le_bytes, f64::to_le_bytes);
    let big = binary("binary_big_endian", f32::to_be_bytes, f64::to_be_bytes);
    assert_eq!(read_ply(&little).unwrap().points_m, wanted);
    assert_eq!(read_ply(&big).unwrap().points_m, wanted);
    for end in 4..little.len() {
        assert!(read_ply(&little[..end]).is_err(), "cut at {end}");
    }
}

#[test]
fn counts_that_the_bytes_cannot_hold_are_refused() {
    let of = |text: &str| read_ply(text.as_bytes()).unwrap_err().to_string();
    let promise = |count: &str| format!("ply\nformat ascii 1.0\nelement vertex {count}\n{VERTEX}end_header\n0 0 0 0\n");
    assert!(of(&promise("4999999")).contains("cannot hold its 4999999 points"));
    assert!(of(&promise("18446744073709551615")).contains("at most 5000000 points"));
    let idle = "ply\nformat binary_little_endian 1.0\nelement idle 1000000000000\nend_header\n";
    assert!(of(idle).contains("more rows than there are bytes"));
    let empty = "ply\nformat ascii 1.0\nelement idle 3\nelement vertex 0\nend_header\nabc\n";
    assert!(of(empty).contains("more rows"));
}

#[test]
fn vertices_without_coordinates_are_refused() {
    let of = |vertex: &str| {
        let text = format!("ply\nformat ascii 1.0\n{vertex}end_header\n0 0 0\n");
        read_ply(text.as_bytes()).unwrap_err().to_string()
    };
    assert!(of("element vertex 1\nproperty float x\nproperty float y\n").contains("must have `z`"));
    assert!(of("element vertex 1\nproperty int x\n").contains("must have `x`, a float"));
    assert!(of("element vertex 1\nproperty list int float x\n").contains("no lists"));
    assert!(of("element face 1\nproperty float x\n").contains("an element `vertex`"));
    assert!(of("element vertex many\n").contains("not a whole PLY file"));
}
