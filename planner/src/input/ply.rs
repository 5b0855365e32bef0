//! Points of PLY files. The `ply-rs-bw` crate reads the header and binary rows. Text rows are parsed here, because that
//! crate supports neither `nan`, which drivers of depth cameras write, nor `.5`.

use std::io::Read;

use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType};
use schema::Vec3;

use crate::input::error::{InputError, refuse, shown};
use crate::input::points::{AXES, ReadCloud, check_count, next_line, text_points};

/// The coordinates of a row; NaN until read. Rows of other elements are read as this type, too, and discarded.
#[derive(Debug)]
struct Row {
    xyz: [f64; 3],
}

impl Row {
    fn put(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        let Some(axis) = AXES.iter().position(|axis| *axis == name) else { return PropertyAccessResult::Ignored };
        self.xyz[axis] = value;
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Row {
    fn new() -> Self {
        Self { xyz: [f64::NAN; 3] }
    }

    fn set_float(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        self.put(name, f64::from(value))
    }

    fn set_double(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        self.put(name, value)
    }
}

/// Whether these bytes begin like a PLY file.
pub(crate) fn is_ply(bytes: &[u8]) -> bool {
    bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r")
}

/// Reads the vertices.
pub(crate) fn read_ply(bytes: &[u8]) -> Result<ReadCloud, InputError> {
    let parser = Parser::<Row>::new();
    let mut reader = Reader::new(bytes);
    let header = parser.read_header(&mut reader).map_err(|error| damaged(&error.to_string()))?;
    let mut rest = reader.into_inner();
    for (name, element) in &header.elements {
        if name == "vertex" {
            let columns = columns_of(element)?;
            let points_m = match header.encoding {
                Encoding::Ascii => text_points(rest, element.count, columns, damaged),
                encoding => binary_vertices(&parser, rest, element, encoding),
            }?;
            return Ok(ReadCloud::of(points_m, None));
        }
        skip(&parser, &mut rest, element, header.encoding)?;
    }
    refuse("a PLY file must have an element `vertex`")
}

fn damaged(what: &str) -> InputError {
    InputError::Damaged(format!("not a whole PLY file: {}", shown(what)))
}

/// The columns of the coordinates.
fn columns_of(vertex: &ElementDef) -> Result<[usize; 3], InputError> {
    let is_number = |kind: &PropertyType| matches!(kind, PropertyType::Scalar(_));
    if !vertex.properties.values().all(|property| is_number(&property.data_type)) {
        return refuse("a PLY file's vertices must have no lists");
    }
    let mut columns = [0; 3];
    for (axis, column) in AXES.iter().zip(&mut columns) {
        let found = vertex.properties.get_full(*axis).filter(|(_, _, property)| {
            matches!(property.data_type, PropertyType::Scalar(ScalarType::Float | ScalarType::Double))
        });
        let missing = || InputError::Value(format!("a PLY file's vertices must have `{axis}`, a float or double"));
        *column = found.ok_or_else(missing)?.0;
    }
    Ok(columns)
}

/// Skips an element before the vertices.
fn skip(parser: &Parser<Row>, rest: &mut &[u8], element: &ElementDef, encoding: Encoding) -> Result<(), InputError> {
    // Each row takes at least one byte; otherwise a file of a hundred bytes could declare endless rows.
    if element.count > rest.len() || (element.properties.is_empty() && element.count > 0) {
        return Err(damaged(&format!("its element `{}` has more rows than there are bytes", element.name)));
    }
    for _ in 0..element.count {
        if encoding == Encoding::Ascii {
            next_line(rest).ok_or_else(|| damaged("it ends too early"))?;
        } else {
            read_row(parser, rest, element, encoding)?;
        }
    }
    Ok(())
}

fn read_row<R: Read>(
    parser: &Parser<Row>,
    source: &mut R,
    element: &ElementDef,
    encoding: Encoding,
) -> Result<Row, InputError> {
    let row = match encoding {
        Encoding::BinaryBigEndian => parser.read_big_endian_element(source, element),
        _ => parser.read_little_endian_element(source, element),
    };
    row.map_err(|error| damaged(&error.to_string()))
}

fn binary_vertices(
    parser: &Parser<Row>,
    mut rest: &[u8],
    vertex: &ElementDef,
    encoding: Encoding,
) -> Result<Vec<Vec3>, InputError> {
    let row_bytes = vertex.properties.values().map(|property| size_bytes(&property.data_type)).sum();
    check_count(vertex.count, rest.len(), row_bytes)?;
    let mut points_m = Vec::with_capacity(vertex.count);
    for _ in 0..vertex.count {
        let row = read_row(parser, &mut rest, vertex, encoding)?;
        points_m.push(Vec3::from_array(row.xyz.map(|metres| metres as f32)));
    }
    Ok(points_m)
}

fn size_bytes(kind: &PropertyType) -> usize {
    match kind {
        PropertyType::Scalar(ScalarType::Char | ScalarType::UChar) => 1,
        PropertyType::Scalar(ScalarType::Short | ScalarType::UShort) => 2,
        PropertyType::Scalar(ScalarType::Int | ScalarType::UInt | ScalarType::Float) => 4,
        PropertyType::Scalar(ScalarType::Double) => 8,
        PropertyType::List(..) => 1,
    }
}

#[cfg(test)]
pub(crate) mod tests {
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
        let promise =
            |count: &str| format!("ply\nformat ascii 1.0\nelement vertex {count}\n{VERTEX}end_header\n0 0 0 0\n");
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
}
