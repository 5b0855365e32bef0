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
pub(crate) mod tests {
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
}
