//! Colour images from PNG and JPEG files.

use std::panic::catch_unwind;

use png::Transformations;
use schema::ColorImage;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use crate::input::error::{InputError, refuse};
use crate::input::grey_png;

/// Maximum side of an image, in pixels.
const SIDE_PX_MAX: usize = 16_384;
/// Maximum number of its pixels.
const PIXELS_MAX: usize = 1 << 26;
/// Of every JPEG.
const JPEG_START: &[u8] = b"\xff\xd8\xff";

/// Reads a PNG, grey or coloured, or a JPEG. Opacity is ignored.
///
/// # Errors
/// [`InputError`] if it is neither, damaged, or larger than 16384 pixels a side or 2²⁶ pixels.
pub fn read_color(bytes: &[u8]) -> Result<ColorImage, InputError> {
    if grey_png::is_png(bytes) {
        return read_png(bytes);
    }
    if !bytes.starts_with(JPEG_START) {
        return Err(InputError::Damaged("a colour image must be a PNG or JPEG file, got other bytes".to_owned()));
    }
    catch_unwind(|| read_jpeg(bytes)).unwrap_or_else(|_| Err(damaged(&"its decoder failed")))
}

fn read_png(bytes: &[u8]) -> Result<ColorImage, InputError> {
    let (frame, values) = grey_png::read(bytes, "a colour image", |header| {
        check_size([header.width, header.height].map(|px| px as usize))?;
        Ok(Transformations::EXPAND | Transformations::STRIP_16)
    })?;
    let rgb = |pixel: &[u8]| if let [red, green, blue, ..] = *pixel { [red, green, blue] } else { [pixel[0]; 3] };
    let pixels = values.chunks_exact(frame.color_type.samples()).map(rgb).collect();
    Ok(ColorImage { width_px: frame.width as usize, height_px: frame.height as usize, pixels })
}

fn read_jpeg(bytes: &[u8]) -> Result<ColorImage, InputError> {
    let options = DecoderOptions::default()
        .set_max_width(SIDE_PX_MAX)
        .set_max_height(SIDE_PX_MAX)
        .set_strict_mode(true)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|error| damaged(&error))?;
    let size = decoder.info().map_or([0; 2], |info| [info.width, info.height].map(usize::from));
    check_size(size)?;
    let values = decoder.decode().map_err(|error| damaged(&error))?;
    let [width_px, height_px] = size;
    let pixels = values.as_chunks::<3>().0.to_vec();
    if pixels.len() != width_px * height_px {
        return Err(damaged(&"it has fewer pixels than its header says"));
    }
    Ok(ColorImage { width_px, height_px, pixels })
}

fn check_size([width_px, height_px]: [usize; 2]) -> Result<(), InputError> {
    let is_good = |side_px: usize| (1..=SIDE_PX_MAX).contains(&side_px);
    if is_good(width_px) && is_good(height_px) && width_px * height_px <= PIXELS_MAX {
        return Ok(());
    }
    refuse(format!(
        "a colour image must have 1 to {SIDE_PX_MAX} pixels a side and at most {PIXELS_MAX}, \
         got {width_px} x {height_px}"
    ))
}

fn damaged(reason: &dyn std::fmt::Display) -> InputError {
    InputError::Damaged(format!("not a whole JPEG: {reason}"))
}

#[cfg(test)]
mod tests {
    use base64::Engine as _;
    use base64::engine::general_purpose::STANDARD;
    use png::{BitDepth, ColorType};

    use super::*;

    /// 16 × 8 pixels by Pillow, the left half (220, 30, 20), the right one (20, 40, 200).
    const JPEG: &str = "\
        /9j/4AAQSkZJRgABAQAAAQABAAD/2wBDAA0JCgsKCA0LCgsODg0PEyAVExISEyccHhcgLikxMC4pLSwzOko+MzZGNywtQFdBRkxO\
        UlNSMj5aYVpQYEpRUk//2wBDAQ4ODhMREyYVFSZPNS01T09PT09PT09PT09PT09PT09PT09PT09PT09PT09PT09PT09PT09PT09P\
        T09PT09PT0//wAARCAAIABADAREAAhEBAxEB/8QAFAABAAAAAAAAAAAAAAAAAAAABf/EABQQAQAAAAAAAAAAAAAAAAAAAAD/xAAW\
        AQEBAQAAAAAAAAAAAAAAAAAHBQb/xAAUEQEAAAAAAAAAAAAAAAAAAAAA/9oADAMBAAIRAxEAPwAVKbcURB2//9k=";

    fn jpeg() -> Vec<u8> {
        STANDARD.decode(JPEG).unwrap()
    }

    fn png(color: ColorType, depth: BitDepth, [width, height]: [u32; 2], values: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(color);
        encoder.set_depth(depth);
        if color == ColorType::Indexed {
            encoder.set_palette(vec![1, 2, 3, 250, 251, 252]);
            encoder.set_trns(vec![255, 7]);
        }
        encoder.write_header().unwrap().write_image_data(values).unwrap();
        bytes
    }

    #[test]
    fn pngs_of_all_kinds_become_8_bit_colours() {
        let expected = [[1, 2, 3], [250, 251, 252]];
        let greys = [[1; 3], [250; 3]];
        for (color, depth, values, expected) in [
            (ColorType::Rgb, BitDepth::Eight, &[1, 2, 3, 250, 251, 252][..], expected),
            (ColorType::Rgb, BitDepth::Sixteen, &[1, 9, 2, 9, 3, 9, 250, 9, 251, 9, 252, 9], expected),
            (ColorType::Rgba, BitDepth::Eight, &[1, 2, 3, 0, 250, 251, 252, 9], expected),
            (ColorType::Indexed, BitDepth::One, &[0b0100_0000], expected),
            (ColorType::Grayscale, BitDepth::Eight, &[1, 250], greys),
            (ColorType::Grayscale, BitDepth::Sixteen, &[1, 9, 250, 9], greys),
            (ColorType::GrayscaleAlpha, BitDepth::Eight, &[1, 0, 250, 9], greys),
        ] {
            let read = read_color(&png(color, depth, [2, 1], values)).unwrap();
            assert_eq!(
                read,
                ColorImage { width_px: 2, height_px: 1, pixels: expected.to_vec() },
                "{color:?} {depth:?}"
            );
        }
    }

    #[test]
    fn a_jpeg_has_its_colours() {
        let read = read_color(&jpeg()).unwrap();
        assert_eq!((read.width_px, read.height_px), (16, 8));
        for (at, pixel) in read.pixels.iter().enumerate() {
            let expected = if at % 16 < 8 { [220, 30, 20] } else { [20, 40, 200] };
            assert!(pixel.iter().zip(expected).all(|(got, wanted)| got.abs_diff(wanted) <= 3), "{at}: {pixel:?}");
        }
    }

    #[test]
    fn damaged_and_foreign_bytes_are_refused() {
        let whole = png(ColorType::Rgb, BitDepth::Eight, [4, 4], &[7; 48]);
        for end in 0..whole.len() {
            assert!(matches!(read_color(&whole[..end]), Err(InputError::Damaged(_))), "PNG cut at {end}");
        }
        let whole = jpeg();
        for end in 0..whole.len() - 20 {
            assert!(matches!(read_color(&whole[..end]), Err(InputError::Damaged(_))), "JPEG cut at {end}");
        }
        for at in 0..whole.len() {
            for value in [0, 1, 0x7f, 0xff] {
                let mut other = whole.clone();
                other[at] = value;
                let _ = read_color(&other); // does not panic
            }
        }
        assert!(read_color(b"GIF89a").unwrap_err().to_string().contains("PNG or JPEG"));
    }

    #[test]
    fn what_is_too_large_is_refused_by_its_header() {
        let mut large = jpeg();
        let at = large.windows(2).position(|marker| marker == [0xff, 0xc0]).unwrap() + 5;
        for (height, width, side) in [(0x3f_u8, 0x3f_u8, "at most 67108864, got 16144 x 16136"), (0x50, 0, "limit")] {
            (large[at], large[at + 2]) = (height, width);
            let message = read_color(&large).unwrap_err().to_string();
            assert!(message.contains(side), "{message}");
        }
        let empty_row = png(ColorType::Grayscale, BitDepth::One, [16_385, 1], &[0; 2049]);
        assert!(read_color(&empty_row).unwrap_err().to_string().contains("got 16385 x 1"));
    }
}
