//! Tests of reading PCD files.

use super::*;

const HEADER: &str = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS rgb y x _ z\n\
                      SIZE 4 4 4 1 8\nTYPE U F F U F\nCOUNT 1 1 1 3 1\n";

fn points() -> [Vec3; 3] {
    [Vec3::new(1.0, 2.0, 3.0), Vec3::new(-1.0, 0.5, 0.25), Vec3::new(7.0, 8.0, 9.0)]
}

fn with(viewpoint: &str, data: &str, rows: &[u8]) -> Vec<u8> {
    let text = format!("{HEADER}WIDTH 3\nHEIGHT 1\nVIEWPOINT {viewpoint}\nPOINTS 3\nDATA {data}\n");
    [text.as_bytes(), rows].concat()
}

const UNKNOWN: &str = "0 0 0 1 0 0 0";

pub(crate) fn binary() -> Vec<u8> {
    let row = |p: Vec3| {
        let z = f64::from(p.z).to_le_bytes();
        [[1; 4].as_slice(), &p.y.to_le_bytes(), &p.x.to_le_bytes(), &[0; 3], &z].concat()
    };
    with(UNKNOWN, "binary", &points().map(row).concat())
}

pub(crate) fn compressed() -> Vec<u8> {
    let all = points();
    let ys: Vec<u8> = all.iter().flat_map(|p| p.y.to_le_bytes()).collect();
    let xs: Vec<u8> = all.iter().flat_map(|p| p.x.to_le_bytes()).collect();
    let zs: Vec<u8> = all.iter().flat_map(|p| f64::from(p.z).to_le_bytes()).collect();
    let fields = [vec![1; 12], ys, xs, vec![0; 9], zs].concat();
    let packed = lzf::tests::compress(&fields);
    let sizes = [(packed.len() as u32).to_le_bytes(), (fields.len() as u32).to_le_bytes()].concat();
    with(UNKNOWN, "binary_compressed", &[sizes, packed].concat())
}

#[test]
fn the_three_storages_give_the_same_points() {
    let text = with(UNKNOWN, "ascii", b"1 2 1 0 0 0 3\n1 0.5 -1 0 0 0 .25\n1 8 7 0 0 0 9");
    for bytes in [text, binary(), compressed()] {
        let read = read_pcd(&bytes).unwrap();
        assert_eq!(read, ReadCloud { points_m: points().to_vec(), eye_m: None, dropped: 0 });
    }
}

#[test]
fn the_viewpoint_is_the_eye_and_nan_is_dropped() {
    let bytes = with("0.1 0.2 0.7 0 1 0 0", "ascii", b"1 2 1 0 0 0 3\n1 nan nan 0 0 0 nan\n1 8 7 0 0 0 9\n");
    let read = read_pcd(&bytes).unwrap();
    assert_eq!((read.eye_m, read.dropped, read.points_m.len()), (Some(Vec3::new(0.1, 0.2, 0.7)), 1, 2));
}

#[test]
fn files_cut_anywhere_are_damaged() {
    for whole in [binary(), compressed()] {
        for end in 7..whole.len() {
            assert!(read_pcd(&whole[..end]).is_err(), "cut at {end}");
        }
    }
}

#[test]
fn headers_that_lie_are_refused() {
    let of = |from: &str, to: &str| {
        let text = String::from_utf8(with(UNKNOWN, "ascii", b"1 2 1 0 0 0 3\n")).unwrap();
        assert!(text.contains(from));
        read_pcd(text.replace(from, to).as_bytes()).unwrap_err().to_string()
    };
    assert!(of("POINTS 3", "POINTS 4").contains("WIDTH times HEIGHT, 3, got 4"));
    assert!(of("WIDTH 3\nHEIGHT 1", "").contains("cannot hold its 3 points"));
    let many = "WIDTH 4294967295\nHEIGHT 4294967295\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 18446744065119617025";
    assert!(of("WIDTH 3\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3", many).contains("at most 5000000 points"));
    assert!(of("SIZE 4 4 4 1 8", "SIZE 4 4 4 1").contains("equally long"));
    assert!(of("SIZE 4 4 4 1 8", "SIZE 4 4 3 1 8").contains("SIZE must be"));
    assert!(of("COUNT 1 1 1 3 1", "COUNT 1 1 1 4096 1").contains("at most 4096 bytes"));
    assert!(of("TYPE U F F U F", "TYPE U F I U F").contains("fields `x`, `y` and `z` of TYPE F"));
    assert!(of("0 0 0 1 0 0 0", "0 0 nan 1 0 0 0").contains("seven numbers"));
    assert!(of("DATA ascii", "DATA secret").contains("got `secret`"));
    assert!(of("DATA ascii", "").contains("header"));
}
