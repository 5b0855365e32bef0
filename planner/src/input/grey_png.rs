//! PNG files: grey ones, which are depth images and masks, and any.

use std::io::Cursor;

use png::{BitDepth, ColorType, DecodingError, Info, Limits, OutputInfo, Transformations};

use crate::input::error::{InputError, refuse};

/// Memory for decoding besides the pixels, mostly rows.
const BYTES_MAX: usize = 4 << 20;
/// Maximum expansion factor of Deflate.
const DEFLATE_RATIO_MAX: usize = 1032;
const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";

/// Whether these bytes begin with the signature of a PNG.
pub(crate) fn is_png(bytes: &[u8]) -> bool {
    bytes.starts_with(SIGNATURE)
}

/// The size of a grey PNG, and its pixels row by row: two big-endian bytes each at 16 bits, else one. `check` decides
/// on width, height and bits before memory is allocated; `what` names the image.
///
/// # Errors
/// [`InputError`] if the bytes are damaged, the picture is not grey, or `check` refuses it.
pub(crate) fn read_grey(
    bytes: &[u8],
    what: &str,
    check: impl FnOnce([usize; 2], BitDepth) -> Result<(), InputError>,
) -> Result<([usize; 2], Vec<u8>), InputError> {
    let (frame, pixels) = read(bytes, what, |header| {
        if header.color_type != ColorType::Grayscale {
            return refuse(format!("{what} must be a grey PNG, got {:?}: is this a picture of it?", header.color_type));
        }
        check(size_of(header), header.bit_depth)?;
        let is_packed = (header.bit_depth as u8) < 8;
        Ok(if is_packed { Transformations::EXPAND } else { Transformations::IDENTITY })
    })?;
    Ok(([frame.width, frame.height].map(|px| px as usize), pixels))
}

/// A PNG's pixels row by row, as `choose` wants them; it decides on the header before memory is allocated. `what` names
/// the image.
///
/// # Errors
/// [`InputError`] if the bytes are damaged, or `choose` refuses the header.
pub(crate) fn read(
    bytes: &[u8],
    what: &str,
    choose: impl FnOnce(&Info<'_>) -> Result<Transformations, InputError>,
) -> Result<(OutputInfo, Vec<u8>), InputError> {
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: BYTES_MAX });
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let header = decoder.read_header_info().map_err(damaged)?;
    let transformations = choose(header)?;
    let [width, height] = size_of(header);
    if width * height / 8 * header.bits_per_pixel() / DEFLATE_RATIO_MAX > bytes.len() {
        let got = bytes.len();
        return Err(InputError::Damaged(format!(
            "a PNG of {got} bytes cannot hold the {width} x {height} pixels of its header"
        )));
    }
    decoder.set_transformations(transformations);
    let mut reader = decoder.read_info().map_err(damaged)?;
    let mut pixels = vec![0; reader.output_buffer_size().unwrap_or_default()];
    let frame = reader.next_frame(&mut pixels).map_err(damaged)?;
    if [frame.width, frame.height].map(|px| px as usize) != [width, height] {
        return Err(InputError::Damaged(format!("{what} must not be an animated PNG")));
    }
    reader.finish().map_err(damaged)?;
    Ok((frame, pixels))
}

fn size_of(header: &Info<'_>) -> [usize; 2] {
    [header.width, header.height].map(|px| px as usize)
}

fn damaged(error: DecodingError) -> InputError {
    InputError::Damaged(match error {
        DecodingError::IoError(_) => "the PNG ends too early".to_owned(),
        DecodingError::LimitsExceeded => "the PNG takes too much memory".to_owned(),
        error => format!("not a whole PNG: {error}"),
    })
}
