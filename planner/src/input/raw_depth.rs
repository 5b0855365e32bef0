//! Pixels as a depth image's file stores them, and the limit of its size.

use crate::input::error::{InputError, refuse};

/// Maximum side of a depth image, in pixels.
pub(crate) const SIDE_PX_MAX: usize = 4096;

/// An image as stored, before its unit is applied.
#[derive(Debug)]
pub(crate) struct RawDepth {
    pub(crate) width_px: usize,
    pub(crate) height_px: usize,
    pub(crate) values: Vec<f32>,
    pub(crate) are_whole_numbers: bool,
}

/// Checks the size of an image before decoding.
pub(crate) fn check_size(width_px: usize, height_px: usize, pixels_max: usize) -> Result<(), InputError> {
    let sides = 1..=SIDE_PX_MAX;
    if !sides.contains(&width_px) || !sides.contains(&height_px) {
        return refuse(format!(
            "a depth image must have 1 to {SIDE_PX_MAX} pixels a side, got {width_px} x {height_px}"
        ));
    }
    if width_px * height_px > pixels_max {
        return refuse(format!(
            "the request's depth images have too many pixels: {pixels_max} are left for one of {width_px} x {height_px}"
        ));
    }
    Ok(())
}
