//! The points of a cloud from a file, and the limit of their number.

use schema::Vec3;

use crate::input::error::InputError;

/// Maximum number of points of a cloud, also after decompression: 16 depth images of 640 x 480.
pub const POINTS_MAX: usize = 5_000_000;

/// A cloud from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadCloud {
    /// Points, in the file's order and frame, in metres; all finite.
    pub points_m: Vec<Vec3>,
    /// Position of the sensor, if the file contains it.
    pub eye_m: Option<Vec3>,
    /// Number of points dropped because a coordinate was not finite.
    pub dropped: usize,
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
        return Err(InputError::Value(format!("a cloud must have at most {POINTS_MAX} points, got {points}")));
    }
    if points.saturating_mul(bytes_min) > bytes {
        return Err(InputError::Damaged(format!("the cloud's {bytes} bytes of data cannot hold its {points} points")));
    }
    Ok(())
}
