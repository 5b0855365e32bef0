//! Points of PCD files, the format of the Point Cloud Library: a text header, then rows as text, as bytes, or
//! compressed by field.

use schema::Vec3;

use crate::input::error::{InputError, refuse, shown};
use crate::input::lzf;
use crate::input::points::{Field, ReadCloud, Rows, check_count, next_line};

const HEADER_LINES_MAX: usize = 100;
const HEADER_LINE_BYTES_MAX: usize = 4096;
const FIELDS_MAX: usize = 64;
const POINT_BYTES_MAX: usize = 4096;
/// Maximum decompressed size: the maximum number of points with 53 bytes each.
const BYTES_MAX: usize = 256 << 20;

/// Whether these bytes begin like a PCD file.
pub(crate) fn is_pcd(bytes: &[u8]) -> bool {
    bytes.starts_with(b"# .PCD") || bytes.starts_with(b"VERSION") || bytes.starts_with(b"FIELDS")
}

/// Reads the points.
pub(crate) fn read_pcd(bytes: &[u8]) -> Result<ReadCloud, InputError> {
    let mut rest = bytes;
    let lines = header_lines(&mut rest)?;
    let (rows, eye_m) = (rows_of(&lines)?, eye_of(&lines)?);
    let points_m = match lines.required("DATA")?.first().copied() {
        Some("ascii") => rows.of_text(rest, damaged),
        Some("binary") => rows.of_bytes(rest, false),
        Some("binary_compressed") => compressed_points(rest, &rows),
        other => {
            let got = shown(other.unwrap_or_default());
            Err(damaged(&format!("DATA must be ascii, binary or binary_compressed, got `{got}`")))
        }
    }?;
    Ok(ReadCloud::of(points_m, eye_m))
}

fn damaged(what: &str) -> InputError {
    InputError::Damaged(format!("not a whole PCD file: {what}"))
}

/// The header's lines by their first word.
struct Words<'a>(Vec<Vec<&'a str>>);

impl<'a> Words<'a> {
    fn of(&self, key: &str) -> Option<&[&'a str]> {
        self.0.iter().find(|words| words[0] == key).map(|words| &words[1..])
    }

    fn required(&self, key: &str) -> Result<&[&'a str], InputError> {
        self.of(key).ok_or_else(|| damaged(&format!("its header lacks {key}")))
    }

    fn number(&self, key: &str) -> Result<Option<usize>, InputError> {
        self.of(key).map(|words| whole_number(key, words.first().copied().unwrap_or_default())).transpose()
    }
}

fn whole_number(key: &str, word: &str) -> Result<usize, InputError> {
    word.parse().map_err(|_| damaged(&format!("{key} must be a whole number, got `{}`", shown(word))))
}

/// The lines up to DATA.
fn header_lines<'a>(rest: &mut &'a [u8]) -> Result<Words<'a>, InputError> {
    let mut lines = Words(Vec::new());
    for _ in 0..HEADER_LINES_MAX {
        let line = next_line(rest).ok_or_else(|| damaged("it ends within its header"))?;
        if line.len() > HEADER_LINE_BYTES_MAX {
            return Err(damaged(&format!("its header's lines must have at most {HEADER_LINE_BYTES_MAX} bytes")));
        }
        let line = std::str::from_utf8(line).map_err(|_| damaged("its header is no text"))?;
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        let Some(key) = words.first().copied().filter(|key| !key.starts_with('#')) else { continue };
        lines.0.push(words);
        if key == "DATA" {
            return Ok(lines);
        }
    }
    Err(damaged(&format!("its header must end with DATA within {HEADER_LINES_MAX} lines")))
}

/// The number of points, and the fields of each.
fn rows_of(lines: &Words<'_>) -> Result<Rows, InputError> {
    let area = match (lines.number("WIDTH")?, lines.number("HEIGHT")?) {
        (Some(width), height) => Some(width.saturating_mul(height.unwrap_or(1))),
        (None, _) => None,
    };
    let points = lines.number("POINTS")?.or(area).ok_or_else(|| damaged("its header lacks POINTS"))?;
    if let Some(area) = area.filter(|area| *area != points) {
        return Err(damaged(&format!("POINTS must be WIDTH times HEIGHT, {area}, got {points}")));
    }
    let names = lines.required("FIELDS")?;
    let sizes = lines.required("SIZE")?;
    let types = lines.required("TYPE")?;
    let ones = vec!["1"; names.len()];
    let counts = lines.of("COUNT").unwrap_or(&ones);
    if names.len() > FIELDS_MAX || [sizes.len(), types.len(), counts.len()] != [names.len(); 3] {
        return Err(damaged(&format!("FIELDS, SIZE, TYPE and COUNT must be equally long, at most {FIELDS_MAX}")));
    }
    let mut fields = Vec::with_capacity(names.len());
    for (at, name) in names.iter().enumerate() {
        let (size_bytes, count) = (whole_number("SIZE", sizes[at])?, whole_number("COUNT", counts[at])?);
        if ![1, 2, 4, 8].contains(&size_bytes) || count > POINT_BYTES_MAX {
            return Err(damaged(&format!("SIZE must be 1, 2, 4 or 8, and COUNT at most {POINT_BYTES_MAX}")));
        }
        fields.push(Field { name, is_float: types[at] == "F", size_bytes, count });
    }
    let missing = |_| refuse("a PCD file must have fields `x`, `y` and `z` of TYPE F and SIZE 4 or 8");
    let rows = Rows::new(points, &fields).or_else(missing)?;
    if rows.row_bytes > POINT_BYTES_MAX {
        let got = rows.row_bytes;
        return Err(damaged(&format!("a point must have at most {POINT_BYTES_MAX} bytes, got {got}")));
    }
    Ok(rows)
}

/// Position of the sensor; `None` if it is the origin looking along z, which writers use for unknown.
fn eye_of(lines: &Words<'_>) -> Result<Option<Vec3>, InputError> {
    let Some(words) = lines.of("VIEWPOINT") else { return Ok(None) };
    let numbers: Vec<f32> = words.iter().filter_map(|word| word.parse().ok()).filter(|n: &f32| n.is_finite()).collect();
    match numbers[..] {
        [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0] => Ok(None),
        [x, y, z, _, _, _, _] if words.len() == 7 => Ok(Some(Vec3::new(x, y, z))),
        _ => Err(damaged("VIEWPOINT must be seven numbers: x y z, then qw qx qy qz")),
    }
}

fn compressed_points(rest: &[u8], rows: &Rows) -> Result<Vec<Vec3>, InputError> {
    let Rows { count, row_bytes, .. } = *rows;
    let short = || damaged("it ends too early");
    let (packed, rest) = rest.split_first_chunk::<4>().ok_or_else(short)?;
    let (unpacked, rest) = rest.split_first_chunk::<4>().ok_or_else(short)?;
    let (packed, unpacked) = (u32::from_le_bytes(*packed) as usize, u32::from_le_bytes(*unpacked) as usize);
    check_count(count, usize::MAX, 1)?;
    if unpacked != count * row_bytes {
        return Err(damaged(&format!("{count} points of {row_bytes} bytes cannot make {unpacked} bytes")));
    }
    if unpacked > BYTES_MAX {
        return refuse(format!("a PCD file must unpack to at most {BYTES_MAX} bytes, got {unpacked}"));
    }
    let data = lzf::decompress(rest.get(..packed).ok_or_else(short)?, unpacked);
    let data = data.ok_or_else(|| damaged("its compressed data are wrong"))?;
    Ok(rows.of_fields(&data))
}

#[cfg(test)]
pub(crate) mod tests;
