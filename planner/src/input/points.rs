//! What the readers of clouds share: the points of a file, the limit of their number, and rows of text.

use schema::Vec3;

use crate::input::error::{InputError, refuse};

/// Maximum number of points of a cloud, also after decompression: 16 depth images of 640 x 480.
pub(crate) const POINTS_MAX: usize = 5_000_000;

/// The names of a point's coordinates.
const AXES: [&str; 3] = ["x", "y", "z"];

/// A cloud from a file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ReadCloud {
    /// Points, in the file's order and frame, in metres; all finite.
    pub(crate) points_m: Vec<Vec3>,
    /// Position of the sensor, if the file contains it.
    pub(crate) eye_m: Option<Vec3>,
    /// Number of points dropped because a coordinate was not finite.
    pub(crate) dropped: usize,
}

impl ReadCloud {
    /// Drops the points that are not finite.
    pub(crate) fn of(points_m: Vec<Vec3>, eye_m: Option<Vec3>) -> Self {
        let (all, mut points_m) = (points_m.len(), points_m);
        points_m.retain(|point| point.is_finite());
        Self { dropped: all - points_m.len(), points_m, eye_m }
    }
}

/// Refuses a number of points that is too large, or larger than `bytes` can hold at `bytes_min` each.
pub(crate) fn check_count(points: usize, bytes: usize, bytes_min: usize) -> Result<(), InputError> {
    if points > POINTS_MAX {
        return refuse(format!("a cloud must have at most {POINTS_MAX} points, got {points}"));
    }
    if points.saturating_mul(bytes_min) > bytes {
        return Err(InputError::Damaged(format!("the cloud's {bytes} bytes of data cannot hold its {points} points")));
    }
    Ok(())
}

/// A column of a cloud's rows, or several of one name.
#[derive(Debug)]
pub(crate) struct Field<'a> {
    pub(crate) name: &'a str,
    pub(crate) is_float: bool,
    pub(crate) size_bytes: usize,
    pub(crate) count: usize,
}

/// The position of a coordinate: its column in text, its first byte in a row, and its number of bytes (4 or 8).
#[derive(Debug, Clone, Copy)]
struct Place {
    column: usize,
    offset_bytes: usize,
    size_bytes: usize,
}

/// How a file has its points: in so many rows of so many bytes, with x, y and z at these places.
#[derive(Debug)]
pub(crate) struct Rows {
    pub(crate) count: usize,
    pub(crate) row_bytes: usize,
    places: [Place; 3],
}

impl Rows {
    /// Rows of these fields, or the first coordinate that they lack.
    pub(crate) fn new(count: usize, fields: &[Field<'_>]) -> Result<Self, &'static str> {
        let mut places = [None; 3];
        let (mut column, mut row_bytes) = (0, 0);
        for Field { name, is_float, size_bytes, count } in fields {
            let is_coordinate = *is_float && [4, 8].contains(size_bytes) && *count == 1;
            if let Some(axis) = AXES.iter().position(|axis| axis == name).filter(|_| is_coordinate) {
                places[axis].get_or_insert(Place { column, offset_bytes: row_bytes, size_bytes: *size_bytes });
            }
            column += count;
            row_bytes += size_bytes * count;
        }
        let [x, y, z] = [0, 1, 2].map(|axis| places[axis].ok_or(AXES[axis]));
        Ok(Self { count, row_bytes, places: [x?, y?, z?] })
    }

    /// The points of lines of text. `damaged` makes the error of the format.
    pub(crate) fn of_text(&self, mut rest: &[u8], damaged: fn(&str) -> InputError) -> Result<Vec<Vec3>, InputError> {
        // Three digits and their separators; the last line may lack its newline.
        check_count(self.count, rest.len() + 1, 6)?;
        let mut points_m = Vec::with_capacity(self.count);
        for number in 0..self.count {
            let line = next_line(&mut rest).ok_or_else(|| damaged("it ends too early"))?;
            let point_m = text_point(line, self.places);
            points_m.push(point_m.ok_or_else(|| damaged(&format!("its point {number} has no x, y, z")))?);
        }
        Ok(points_m)
    }

    /// The points of bytes, row by row.
    pub(crate) fn of_bytes(&self, data: &[u8], is_big_endian: bool) -> Result<Vec<Vec3>, InputError> {
        check_count(self.count, data.len(), self.row_bytes)?;
        Ok(self.points(data, is_big_endian, |place| (place.offset_bytes, self.row_bytes)))
    }

    /// The points of little-endian bytes, field by field.
    pub(crate) fn of_fields(&self, data: &[u8]) -> Vec<Vec3> {
        self.points(data, false, |place| (place.offset_bytes * self.count, place.size_bytes))
    }

    /// The points whose coordinates have this first byte and distance to the next point's; NaN where the data end.
    fn points(&self, data: &[u8], is_big_endian: bool, stride: impl Fn(Place) -> (usize, usize)) -> Vec<Vec3> {
        let coordinate = |place: Place, number: usize| {
            let (first, stride) = stride(place);
            let bytes = data.get(first + number * stride..).unwrap_or_default();
            match (place.size_bytes, is_big_endian) {
                (4, false) => bytes.first_chunk().map(|bytes| f32::from_le_bytes(*bytes)),
                (4, true) => bytes.first_chunk().map(|bytes| f32::from_be_bytes(*bytes)),
                (_, false) => bytes.first_chunk().map(|bytes| f64::from_le_bytes(*bytes) as f32),
                (_, true) => bytes.first_chunk().map(|bytes| f64::from_be_bytes(*bytes) as f32),
            }
        };
        let point = |number| self.places.map(|place| coordinate(place, number).unwrap_or(f32::NAN));
        (0..self.count).map(|number| Vec3::from_array(point(number))).collect()
    }
}

/// The coordinates in a line of numbers separated by blanks.
fn text_point(line: &[u8], places: [Place; 3]) -> Option<Vec3> {
    let words: Vec<&str> = std::str::from_utf8(line).ok()?.split_ascii_whitespace().collect();
    let [x, y, z] = places.map(|place| words.get(place.column)?.parse::<f64>().ok());
    Some(Vec3::new(x? as f32, y? as f32, z? as f32))
}

/// The next line without its newline; `None` after the last.
pub(crate) fn next_line<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let mut parts = rest.splitn(2, |byte| *byte == b'\n');
    let line = parts.next().filter(|_| !rest.is_empty());
    *rest = parts.next().unwrap_or_default();
    line
}
