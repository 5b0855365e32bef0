//! What the readers of clouds share: the points of a file, the limit of their number, and rows of text.

use schema::Vec3;

use crate::input::error::{InputError, refuse};

/// Maximum number of points of a cloud, also after decompression: 16 depth images of 640 x 480.
pub(crate) const POINTS_MAX: usize = 5_000_000;

/// The names of a point's coordinates.
pub(crate) const AXES: [&str; 3] = ["x", "y", "z"];

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

/// The points of `count` lines, with x, y and z in these columns. `damaged` makes the error of the format.
pub(crate) fn text_points(
    mut rest: &[u8],
    count: usize,
    columns: [usize; 3],
    damaged: fn(&str) -> InputError,
) -> Result<Vec<Vec3>, InputError> {
    // Three digits and their separators; the last line may lack its newline.
    check_count(count, rest.len() + 1, 6)?;
    let mut points_m = Vec::with_capacity(count);
    for number in 0..count {
        let line = next_line(&mut rest).ok_or_else(|| damaged("it ends too early"))?;
        points_m.push(text_point(line, columns).ok_or_else(|| damaged(&format!("its point {number} has no x, y, z")))?);
    }
    Ok(points_m)
}

/// The coordinates in a line of numbers separated by blanks.
fn text_point(line: &[u8], columns: [usize; 3]) -> Option<Vec3> {
    let words: Vec<&str> = std::str::from_utf8(line).ok()?.split_ascii_whitespace().collect();
    let [x, y, z] = columns.map(|column| words.get(column)?.parse::<f64>().ok());
    Some(Vec3::new(x? as f32, y? as f32, z? as f32))
}

/// The next line without its newline; `None` after the last.
pub(crate) fn next_line<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    if rest.is_empty() {
        return None;
    }
    let end = rest.iter().position(|byte| *byte == b'\n');
    let (line, behind) = rest.split_at(end.unwrap_or(rest.len()));
    *rest = behind.get(1..).unwrap_or_default();
    Some(line)
}
