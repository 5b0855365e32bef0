//! Depth images from PNG and NumPy files. The first bytes determine the format, never the name, and the size
//! is checked before a pixel is decoded. Values that are not finite and positive become 0, "nothing seen".

use png::BitDepth;
use schema::DepthImage;

use crate::input::error::{InputError, refuse};
use crate::input::{grey_png, npy};

/// Maximum side of a depth image, in pixels.
pub(crate) const SIDE_PX_MAX: usize = 4096;
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

/// Reads a depth image of at most `pixels_max` pixels, with warnings about it. `scale_m` is metres per stored unit; by
/// default integers are millimetres and floats metres.
///
/// # Errors
/// [`InputError`] if the format is unknown, the bytes are damaged, the image is not a depth image of at most
/// [`SIDE_PX_MAX`] pixels a side, no pixel has a depth, or the median depth is implausible for a table in front of a
/// robot, which mostly means a wrong unit.
pub(crate) fn read_depth(
    bytes: &[u8],
    scale_m: Option<f32>,
    pixels_max: usize,
) -> Result<(DepthImage, Vec<String>), InputError> {
    if let Some(scale_m) = scale_m.filter(|scale_m| !(SCALE_M_MIN..=SCALE_M_MAX).contains(scale_m)) {
        return refuse(format!("depth_scale_m must be between {SCALE_M_MIN:e} and {SCALE_M_MAX}, got {scale_m}"));
    }
    let ([width_px, height_px], mut depth_m, default_scale_m) = if grey_png::is_png(bytes) {
        read_png(bytes, pixels_max)
    } else if npy::is_npy(bytes) {
        read_array(bytes, pixels_max)
    } else {
        Err(InputError::Damaged("a depth image must be a PNG or NPY file, got other bytes".to_owned()))
    }?;
    let scale_m = scale_m.unwrap_or(default_scale_m);
    let (mut not_finite, mut negative) = (0, 0);
    for depth in &mut depth_m {
        let scaled = *depth * scale_m;
        not_finite += usize::from(!scaled.is_finite());
        negative += usize::from(scaled.is_finite() && scaled < 0.0);
        *depth = if scaled.is_finite() && scaled > 0.0 { scaled } else { 0.0 };
    }
    let mut warnings: Vec<String> = check_depths(&depth_m, scale_m, [not_finite, negative])?.into_iter().collect();
    if negative > 0 {
        warnings.push(format!("{negative} pixels with a negative depth count as not seen"));
    }
    Ok((DepthImage { width_px, height_px, depth_m }, warnings))
}

/// Checks an image in metres, of which values that are not positive were not seen, and warns of few that are.
///
/// # Errors
/// [`InputError`] if no pixel has a depth, or the median is implausible for a table in front of a robot.
pub fn check_image(image: &DepthImage) -> Result<Option<String>, InputError> {
    check_depths(&image.depth_m, 1.0, [0; 2])
}

/// A warning about few pixels with a depth, if there are any and their median is plausible.
fn check_depths(depth_m: &[f32], scale_m: f32, odd: [usize; 2]) -> Result<Option<String>, InputError> {
    let mut seen: Vec<f32> = depth_m.iter().copied().filter(|depth_m| *depth_m > 0.0).collect();
    if seen.is_empty() {
        return refuse(format!("no pixel has a depth{}", odd_pixels(odd)));
    }
    let middle = seen.len() / 2;
    let median_m = *seen.select_nth_unstable_by(middle, f32::total_cmp).1;
    if !(MEDIAN_M_MIN..=MEDIAN_M_MAX).contains(&median_m) {
        let hint = scale_hint(scale_m, median_m);
        return refuse(format!(
            "the median depth must be between {MEDIAN_M_MIN} and {MEDIAN_M_MAX} m, got {median_m} m: {hint}"
        ));
    }
    let share = seen.len() as f64 / depth_m.len() as f64;
    Ok((share < SEEN_SHARE_MIN)
        .then(|| format!("only {:.1} % of the pixels have a depth{}", 100.0 * share, odd_pixels(odd))))
}

fn odd_pixels([not_finite, negative]: [usize; 2]) -> String {
    if not_finite + negative == 0 {
        String::new()
    } else {
        format!(" ({not_finite} are not finite, {negative} negative)")
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

/// Width and height, values as stored, and the default scale.
type Stored = ([usize; 2], Vec<f32>, f32);

fn read_array(bytes: &[u8], pixels_max: usize) -> Result<Stored, InputError> {
    let (header, data) = npy::split(bytes)?;
    let size = match header.shape[..] {
        [height, width] | [height, width, 1] => [width, height],
        _ => return refuse(format!("a depth array must have the shape [H, W], got {:?}", header.shape)),
    };
    check_size(size, pixels_max)?;
    if header.number.is_byte() {
        return refuse("a depth array must not be of 8 bits: 256 depths are a coloured picture of them");
    }
    let default_scale_m = if header.number.is_float() { 1.0 } else { WHOLE_NUMBER_SCALE_M };
    Ok((size, header.decode(data), default_scale_m))
}

fn read_png(bytes: &[u8], pixels_max: usize) -> Result<Stored, InputError> {
    let (size, pixels) = grey_png::read_grey(bytes, "a depth image", |size, depth| {
        if depth != BitDepth::Sixteen {
            let got = depth as u8;
            return refuse(format!(
                "a depth PNG must have 16 bits a pixel, got {got}: fewer cannot tell millimetres apart"
            ));
        }
        check_size(size, pixels_max)
    })?;
    let values = pixels.as_chunks::<2>().0.iter().map(|unit| f32::from(u16::from_be_bytes(*unit))).collect();
    Ok((size, values, WHOLE_NUMBER_SCALE_M))
}

fn check_size([width_px, height_px]: [usize; 2], pixels_max: usize) -> Result<(), InputError> {
    if [width_px, height_px].iter().any(|side_px| !(1..=SIDE_PX_MAX).contains(side_px)) {
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

#[cfg(test)]
mod tests {
    use png::ColorType;

    use super::*;
    use crate::input::tests::{npy_of, png_of};

    fn read_whole(bytes: &[u8], scale_m: Option<f32>) -> Result<DepthImage, InputError> {
        read_depth(bytes, scale_m, usize::MAX).map(|(image, _)| image)
    }

    fn message(result: Result<DepthImage, InputError>) -> String {
        result.unwrap_err().to_string()
    }

    #[test]
    fn a_png_is_millimetres_row_by_row() {
        let bytes = png_of(3, 2, &[0, 500, 1000, 65535, 1, 2]);
        let read = read_whole(&bytes, None).unwrap();
        assert_eq!((read.width_px, read.height_px), (3, 2));
        assert_eq!(read.at([0, 0]), None);
        assert_eq!(read.at([1, 0]), Some(0.5));
        assert!((read.at([0, 1]).unwrap() - 65.535).abs() < 1e-4);
        let scaled = read_whole(&bytes, Some(0.0002)).unwrap();
        assert!((scaled.at([1, 0]).unwrap() - 0.1).abs() < 1e-6, "5000 units a metre, as TUM's datasets have");
    }

    #[test]
    fn arrays_of_each_kind_are_read() {
        let floats = npy_of(&[2, 2, 1], &[0.5, f32::NAN, -1.0, f32::INFINITY]);
        let read = read_whole(&floats, None).unwrap();
        assert_eq!(read.depth_m, [0.5, 0.0, 0.0, 0.0]);
        let mut whole = b"\x93NUMPY\x01\x00\x3b\x00".to_vec();
        whole.extend(format!("{:<59}", "{'descr': '<u2', 'fortran_order': True, 'shape': (1, 2)}").bytes());
        whole.extend([0xf4, 0x01, 0xe8, 0x03]);
        assert_eq!(read_whole(&whole, None).unwrap().depth_m, [0.5, 1.0]);
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
        assert!(message(read_whole(&rgb, None)).contains("must be a grey PNG, got Rgb"));
        assert!(message(read_whole(b"GIF89a", None)).contains("PNG or NPY"));
        assert!(message(read_whole(&npy_of(&[4], &[1.0; 4]), None)).contains("shape [H, W], got [4]"));
        assert!(message(read_whole(&npy_of(&[0, 4], &[]), None)).contains("got 4 x 0"));
        let good = png_of(1, 1, &[500]);
        for scale_m in [5.0, 0.0, -1.0, f32::NAN] {
            assert!(message(read_whole(&good, Some(scale_m))).contains("between 1e-6 and 1, got"), "{scale_m}");
        }
        assert!(read_depth(&png_of(2, 2, &[1; 4]), None, 3).unwrap_err().to_string().contains("too many pixels"));
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
            read_depth(&bytes, scale_m, usize::MAX).map(|(_, warnings)| warnings)
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
