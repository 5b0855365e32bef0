//! Points of PLY files. The `ply-rs-bw` crate reads the header and what stands before the vertices. Vertices as text
//! are parsed here, because that crate supports neither `nan`, which drivers of depth cameras write, nor `.5`.

use std::fmt::Display;

use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, ElementDef, Encoding, PropertyType, ScalarType};

use crate::input::error::{InputError, refuse, shown};
use crate::input::points::{Field, ReadCloud, Rows, next_line};

/// Whether these bytes begin like a PLY file.
pub(crate) fn is_ply(bytes: &[u8]) -> bool {
    bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r")
}

/// Reads the vertices.
pub(crate) fn read_ply(bytes: &[u8]) -> Result<ReadCloud, InputError> {
    let parser = Parser::<DefaultElement>::new();
    let mut reader = Reader::new(bytes);
    let header = parser.read_header(&mut reader).map_err(damaged)?;
    let mut rest = reader.into_inner();
    for (name, element) in &header.elements {
        if name == "vertex" {
            let rows = rows_of(element)?;
            let points_m = match header.encoding {
                Encoding::Ascii => rows.of_text(rest, |what| damaged(what)),
                encoding => rows.of_bytes(rest, encoding == Encoding::BinaryBigEndian),
            }?;
            return Ok(ReadCloud::of(points_m, None));
        }
        skip(&parser, &mut rest, element, header.encoding)?;
    }
    refuse("a PLY file must have an element `vertex`")
}

fn damaged(what: impl Display) -> InputError {
    InputError::Damaged(format!("not a whole PLY file: {}", shown(&what.to_string())))
}

fn rows_of(vertex: &ElementDef) -> Result<Rows, InputError> {
    let fields = vertex.properties.iter().map(|(name, property)| field(name, &property.data_type));
    let Some(fields) = fields.collect::<Option<Vec<Field<'_>>>>() else {
        return refuse("a PLY file's vertices must have no lists");
    };
    let missing = |axis| refuse(format!("a PLY file's vertices must have `{axis}`, a float or double"));
    Rows::new(vertex.count, &fields).or_else(missing)
}

/// A property as a column, unless it is a list.
fn field<'a>(name: &'a str, kind: &PropertyType) -> Option<Field<'a>> {
    let PropertyType::Scalar(kind) = kind else { return None };
    let (size_bytes, is_float) = match kind {
        ScalarType::Char | ScalarType::UChar => (1, false),
        ScalarType::Short | ScalarType::UShort => (2, false),
        ScalarType::Int | ScalarType::UInt => (4, false),
        ScalarType::Float => (4, true),
        ScalarType::Double => (8, true),
    };
    Some(Field { name, is_float, size_bytes, count: 1 })
}

/// Skips an element before the vertices.
fn skip(
    parser: &Parser<DefaultElement>,
    rest: &mut &[u8],
    element: &ElementDef,
    encoding: Encoding,
) -> Result<(), InputError> {
    // Each row takes at least one byte; otherwise a file of a hundred bytes could declare endless rows.
    if element.count > rest.len() || (element.properties.is_empty() && element.count > 0) {
        return Err(damaged(format_args!("its element `{}` has more rows than there are bytes", element.name)));
    }
    for _ in 0..element.count {
        match encoding {
            Encoding::Ascii => drop(next_line(rest).ok_or_else(|| damaged("it ends too early"))?),
            Encoding::BinaryBigEndian => drop(parser.read_big_endian_element(rest, element).map_err(damaged)?),
            Encoding::BinaryLittleEndian => drop(parser.read_little_endian_element(rest, element).map_err(damaged)?),
        }
    }
    Ok(())
}

#[cfg(test)]
pub(crate) mod tests;
