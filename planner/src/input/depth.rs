//! Depth images from PNG, NumPy and OpenEXR files. The first bytes determine the format, never the name, and the size
//! is checked before a pixel is decoded. Values that are not finite and positive become 0, "nothing seen".

use std::io::Cursor;

use png::{BitDepth, ColorType, DecodingError};
use schema::DepthImage;

use crate::input::error::{InputError, refuse};
use crate::input::exr_image::read_exr;
use crate::input::npy;
use crate::input::raw_depth::{RawDepth, check_size};

/// Default metres per unit of an integer image: millimetres, as cameras deliver.
const WHOLE_NUMBER_SCALE_M: f32 = 0.001;
/// Limits of `depth_scale_m`.
const SCALE_M_MIN: f32 = 1e-6;
const SCALE_M_MAX: f32 = 1.0;
/// Limits of the median depth of a scene on a table in front of a robot.
const MEDIAN_M_MIN: f32 = 0.02;
const MEDIAN_M_MAX: f32 = 20.0;
/// A smaller share of valid pixels causes a warning.
const SEEN_SHARE_MIN: f64 = 0.1;
/// Memory for decoding a PNG besides its pixels, mostly rows.
const PNG_BYTES_MAX: usize = 4 << 20;
/// Maximum expansion factor of Deflate.
const DEFLATE_RATIO_MAX: usize = 1032;
pub(crate) const PNG_SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
const EXR_SIGNATURE: &[u8] = b"\x76\x2f\x31\x01";

/// A depth image with statistics for warnings.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ReadDepth {
    /// The image; 0 where nothing was seen.
    pub(crate) image: DepthImage,
    /// Metres per stored unit that were used.
    pub(crate) scale_m: f32,
    /// Pixels that were not finite numbers.
    pub(crate) not_finite: usize,
    /// Pixels below 0.
    pub(crate) negative: usize,
}

/// Reads a depth image of at most `pixels_max` pixels. `scale_m` is metres per stored unit; by default integers are
/// millimetres and floats metres.
///
/// # Errors
/// [`InputError`] if the format is unknown, the bytes are damaged, or the image is not a depth image of at most
/// `SIDE_PX_MAX` pixels a side.
pub(crate) fn read_depth(bytes: &[u8], scale_m: Option<f32>, pixels_max: usize) -> Result<ReadDepth, InputError> {
    if let Some(scale_m) = scale_m.filter(|scale_m| !(SCALE_M_MIN..=SCALE_M_MAX).contains(scale_m)) {
        return refuse(format!("depth_scale_m must be between {SCALE_M_MIN:e} and {SCALE_M_MAX}, got {scale_m}"));
    }
    let raw = if bytes.starts_with(PNG_SIGNATURE) {
        read_png(bytes, pixels_max)
    } else if npy::is_npy(bytes) {
        read_array(bytes, pixels_max)
    } else if bytes.starts_with(EXR_SIGNATURE) {
        read_exr(bytes, pixels_max)
    } else {
        Err(InputError::Damaged("a depth image must be a PNG, NPY or EXR file, got other bytes".to_owned()))
    }?;
    let by_default = if raw.are_whole_numbers { WHOLE_NUMBER_SCALE_M } else { 1.0 };
    Ok(in_metres(raw, scale_m.unwrap_or(by_default)))
}

/// Warnings about a readable image.
///
/// # Errors
/// [`InputError::Value`] if no pixel has a depth, or the median depth is implausible for a table in front of a robot,
/// which mostly means a wrong unit.
pub(crate) fn judge_depth(depth: &ReadDepth) -> Result<Vec<String>, InputError> {
    let mut seen: Vec<f32> = depth.image.depth_m.iter().copied().filter(|depth_m| *depth_m > 0.0).collect();
    let pixels = depth.image.depth_m.len();
    if seen.is_empty() {
        return refuse(format!("no pixel has a depth{}", odd_pixels(depth)));
    }
    let middle = seen.len() / 2;
    let median_m = *seen.select_nth_unstable_by(middle, f32::total_cmp).1;
    if !(MEDIAN_M_MIN..=MEDIAN_M_MAX).contains(&median_m) {
        let hint = scale_hint(depth.scale_m, median_m);
        return refuse(format!(
            "the median depth must be between {MEDIAN_M_MIN} and {MEDIAN_M_MAX} m, got {median_m} m: {hint}"
        ));
    }
    let mut warnings = Vec::new();
    let seen_share = seen.len() as f64 / pixels as f64;
    if seen_share < SEEN_SHARE_MIN {
        warnings.push(format!("only {:.1} % of the pixels have a depth{}", 100.0 * seen_share, odd_pixels(depth)));
    }
    if depth.negative > 0 {
        warnings.push(format!("{} pixels with a negative depth count as not seen", depth.negative));
    }
    Ok(warnings)
}

fn odd_pixels(depth: &ReadDepth) -> String {
    match (depth.not_finite, depth.negative) {
        (0, 0) => String::new(),
        (odd, negative) => format!(" ({odd} are not finite, {negative} negative)"),
    }
}

/// The likely cause of such a median.
fn scale_hint(scale_m: f32, median_m: f32) -> String {
    let plausible = 0.05..=5.0;
    if scale_m == 1.0 && plausible.contains(&(median_m * 0.001)) {
        "are these millimetres? set depth_scale_m = 0.001".to_owned()
    } else if plausible.contains(&(median_m / scale_m)) {
        "are these metres? set depth_scale_m = 1".to_owned()
    } else {
        format!("check depth_scale_m, which is {scale_m}")
    }
}

fn in_metres(raw: RawDepth, scale_m: f32) -> ReadDepth {
    let (mut not_finite, mut negative) = (0, 0);
    let mut depth_m = raw.values;
    for depth in &mut depth_m {
        let scaled = *depth * scale_m;
        not_finite += usize::from(!scaled.is_finite());
        negative += usize::from(scaled.is_finite() && scaled < 0.0);
        *depth = if scaled.is_finite() && scaled > 0.0 { scaled } else { 0.0 };
    }
    let image = DepthImage { width_px: raw.width_px, height_px: raw.height_px, depth_m };
    ReadDepth { image, scale_m, not_finite, negative }
}

fn read_array(bytes: &[u8], pixels_max: usize) -> Result<RawDepth, InputError> {
    let (header, data) = npy::split(bytes)?;
    let (height_px, width_px) = match header.shape[..] {
        [height, width] | [height, width, 1] => (height, width),
        _ => return refuse(format!("a depth array must have the shape [H, W], got {:?}", header.shape)),
    };
    check_size(width_px, height_px, pixels_max)?;
    if header.number.is_byte() {
        return refuse("a depth array must not be of 8 bits: 256 depths are a coloured picture of them");
    }
    Ok(RawDepth { width_px, height_px, values: header.decode(data), are_whole_numbers: !header.number.is_float() })
}

/// A decoder that takes little memory besides the pixels.
pub(crate) fn png_decoder(bytes: Cursor<&[u8]>) -> png::Decoder<Cursor<&[u8]>> {
    let mut decoder = png::Decoder::new_with_limits(bytes, png::Limits { bytes: PNG_BYTES_MAX });
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    decoder
}

fn read_png(bytes: &[u8], pixels_max: usize) -> Result<RawDepth, InputError> {
    let mut decoder = png_decoder(Cursor::new(bytes));
    let header = decoder.read_header_info().map_err(damaged_png)?;
    let (width_px, height_px) = (header.width as usize, header.height as usize);
    check_grey(header.color_type, header.bit_depth)?;
    check_size(width_px, height_px, pixels_max)?;
    let size_bytes = 2 * width_px * height_px;
    if size_bytes / DEFLATE_RATIO_MAX > bytes.len() {
        return Err(InputError::Damaged(format!(
            "a PNG of {} bytes cannot hold the {width_px} x {height_px} pixels of its header",
            bytes.len()
        )));
    }
    let mut reader = decoder.read_info().map_err(damaged_png)?;
    let mut pixels = vec![0; size_bytes];
    let frame = reader.next_frame(&mut pixels).map_err(damaged_png)?;
    if (frame.width as usize, frame.height as usize) != (width_px, height_px) {
        return Err(InputError::Damaged("a depth image must not be an animated PNG".to_owned()));
    }
    reader.finish().map_err(damaged_png)?;
    let values = pixels.as_chunks::<2>().0.iter().map(|unit| f32::from(u16::from_be_bytes(*unit))).collect();
    Ok(RawDepth { width_px, height_px, values, are_whole_numbers: true })
}

fn check_grey(color: ColorType, depth: BitDepth) -> Result<(), InputError> {
    match (color, depth) {
        (ColorType::Grayscale, BitDepth::Sixteen) => Ok(()),
        (ColorType::Grayscale, depth) => {
            let got = depth as u8;
            refuse(format!("a depth PNG must have 16 bits a pixel, got {got}: fewer cannot tell millimetres apart"))
        }
        (color, _) => {
            refuse(format!("a depth PNG must be grey, got {color:?}: is this the colour image, or a rendered one?"))
        }
    }
}

pub(crate) fn damaged_png(error: DecodingError) -> InputError {
    match error {
        DecodingError::IoError(_) => InputError::Damaged("the PNG ends too early".to_owned()),
        DecodingError::LimitsExceeded => InputError::Damaged("the PNG takes too much memory".to_owned()),
        error => InputError::Damaged(format!("not a whole PNG: {error}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::tests::{npy_of, png_of};

    fn read_whole(bytes: &[u8], scale_m: Option<f32>) -> Result<ReadDepth, InputError> {
        read_depth(bytes, scale_m, usize::MAX)
    }

    fn message(result: Result<ReadDepth, InputError>) -> String {
        result.unwrap_err().to_string()
    }

    #[test]
    fn a_png_is_millimetres_row_by_row() {
        let bytes = png_of(3, 2, &[0, 500, 1000, 65535, 1, 2]);
        let read = read_whole(&bytes, None).unwrap();
        assert_eq!((read.image.width_px, read.image.height_px), (3, 2));
        assert_eq!(read.image.at([0, 0]), None);
        assert_eq!(read.image.at([1, 0]), Some(0.5));
        assert!((read.image.at([0, 1]).unwrap() - 65.535).abs() < 1e-4);
        let scaled = read_whole(&bytes, Some(0.0002)).unwrap();
        assert!((scaled.image.at([1, 0]).unwrap() - 0.1).abs() < 1e-6, "5000 units a metre, as TUM's datasets have");
    }

    #[test]
    fn arrays_of_each_kind_are_read() {
        let floats = npy_of(&[2, 2, 1], &[0.5, f32::NAN, -1.0, f32::INFINITY]);
        let read = read_whole(&floats, None).unwrap();
        assert_eq!(read.image.depth_m, [0.5, 0.0, 0.0, 0.0]);
        assert_eq!((read.not_finite, read.negative, read.scale_m), (2, 1, 1.0));
        let mut whole = b"\x93NUMPY\x01\x00\x3b\x00".to_vec();
        whole.extend(format!("{:<59}", "{'descr': '<u2', 'fortran_order': True, 'shape': (1, 2)}").bytes());
        whole.extend([0xf4, 0x01, 0xe8, 0x03]);
        assert_eq!(read_whole(&whole, None).unwrap().image.depth_m, [0.5, 1.0]);
    }

    #[test]
    fn what_is_no_depth_is_refused() {
        let mut grey8 = Vec::new();
        png::Encoder::new(&mut grey8, 1, 1).write_header().unwrap().write_image_data(&[7]).unwrap();
        assert!(message(read_whole(&grey8, None)).contains("16 bits a pixel, got 8"));
        let mut rgb = Vec::new();
        let mut encoder = png::Encoder::new(&mut rgb, 1, 1);
        encoder.set_color(ColorType::Rgb);
        encoder.write_header().unwrap().write_image_data(&[7; 3]).unwrap();
        assert!(message(read_whole(&rgb, None)).contains("must be grey, got Rgb"));
        assert!(message(read_whole(b"GIF89a", None)).contains("PNG, NPY or EXR"));
        assert!(message(read_whole(&npy_of(&[4], &[1.0; 4]), None)).contains("shape [H, W], got [4]"));
        assert!(message(read_whole(&npy_of(&[0, 4], &[]), None)).contains("got 4 x 0"));
        let good = png_of(1, 1, &[500]);
        for scale_m in [5.0, 0.0, -1.0, f32::NAN] {
            assert!(message(read_whole(&good, Some(scale_m))).contains("between 1e-6 and 1, got"), "{scale_m}");
        }
        assert!(message(read_depth(&png_of(2, 2, &[1; 4]), None, 3)).contains("too many pixels"));
    }

    #[test]
    fn a_png_cut_anywhere_is_damaged() {
        let whole = png_of(4, 4, &[700; 16]);
        for end in 8..whole.len() {
            assert!(matches!(read_whole(&whole[..end], None), Err(InputError::Damaged(_))), "cut at {end}");
        }
    }

    #[test]
    fn a_png_that_promises_too_much_is_refused_from_its_header() {
        let promising = |side: u32| {
            let mut bytes = png_of(1, 1, &[1]);
            bytes[16..20].copy_from_slice(&side.to_be_bytes());
            bytes[20..24].copy_from_slice(&side.to_be_bytes());
            // The checksum of IHDR, recomputed by a slow implementation.
            let mut crc = u32::MAX;
            for byte in &bytes[12..29] {
                crc ^= u32::from(*byte);
                for _ in 0..8 {
                    crc = (crc >> 1) ^ (0xedb8_8320 * (crc & 1));
                }
            }
            bytes[29..33].copy_from_slice(&(!crc).to_be_bytes());
            bytes
        };
        assert!(message(read_whole(&promising(4096), None)).contains("cannot hold the 4096 x 4096 pixels"));
        assert!(message(read_whole(&promising(4097), None)).contains("1 to 4096 pixels a side"));
        assert!(read_whole(&promising(0x7fff_ffff), None).is_err());
    }

    #[test]
    fn absurd_depths_are_refused_with_the_likely_unit() {
        let judged = |values: &[f32], scale_m| {
            let bytes = npy_of(&[1, values.len()], values);
            judge_depth(&read_whole(&bytes, scale_m).unwrap())
        };
        let said = |values: &[f32], scale_m| judged(values, scale_m).unwrap_err().to_string();
        assert!(judged(&[0.6, 0.7, 0.0], None).unwrap().is_empty());
        assert!(said(&[0.0, f32::NAN, -1.0], None).contains("no pixel has a depth (1 are not finite, 1 negative)"));
        assert!(said(&[612.0, 612.0], None).contains("got 612 m: are these millimetres? set depth_scale_m = 0.001"));
        assert!(said(&[0.6, 0.6], Some(0.001)).contains("are these metres? set depth_scale_m = 1"));
        assert!(said(&[1e6], None).contains("check depth_scale_m, which is 1"));
        let mut hardly = vec![0.0; 100];
        hardly[..2].copy_from_slice(&[0.5, -3.0]);
        let warnings = judged(&hardly, None).unwrap();
        assert!(warnings[0].contains("only 1.0 % of the pixels") && warnings[1].contains("1 pixels"), "{warnings:?}");
    }
}
