//! Masks: images that are not 0 where the target is.

use crate::input::error::{InputError, refuse};
use crate::input::{grey_png, npy};

/// A mask of a depth image of this size, row by row: a grey PNG or an NPY file of bytes or truth values.
///
/// # Errors
/// [`InputError`] if it is neither, or of another size.
pub(crate) fn read_mask(bytes: &[u8], [width_px, height_px]: [usize; 2]) -> Result<Vec<bool>, InputError> {
    let must_fit = |[width, height]: [usize; 2]| {
        if [width, height] == [width_px, height_px] {
            return Ok(());
        }
        refuse(format!("must have its depth image's size, {width_px} x {height_px}, got {width} x {height}"))
    };
    if grey_png::is_png(bytes) {
        let (_, pixels) = grey_png::read_grey(bytes, "a mask", |size, _| must_fit(size))?;
        let pixel_bytes = pixels.len() / (width_px * height_px);
        return Ok(pixels.chunks_exact(pixel_bytes).map(|pixel| pixel.iter().any(|byte| *byte != 0)).collect());
    }
    if !npy::is_npy(bytes) {
        return refuse("a mask must be a PNG or NPY file, got other bytes");
    }
    let (header, data) = npy::split(bytes)?;
    let [height, width] = header.shape[..] else {
        return refuse(format!("a mask must have the shape [H, W], got {:?}", header.shape));
    };
    must_fit([width, height])?;
    if !header.number.is_byte() {
        return refuse("a mask's dtype must be bool or uint8: mask.astype(\"uint8\")");
    }
    Ok(header.decode(data).into_iter().map(|value| value != 0.0).collect())
}

#[cfg(test)]
mod tests {
    use png::ColorType;

    use super::*;
    use crate::input::tests::{npy_of, png_of};

    fn grey8(width: u32, height: u32, pixels: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        png::Encoder::new(&mut bytes, width, height).write_header().unwrap().write_image_data(pixels).unwrap();
        bytes
    }

    fn bytes_npy(descr: &str, rows: usize, columns: usize, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn what_is_not_0_is_the_target() {
        let expected = [true, false, false, false, true, true];
        let pixels = [255, 0, 0, 0, 1, 7];
        assert_eq!(read_mask(&grey8(3, 2, &pixels), [3, 2]).unwrap(), expected);
        assert_eq!(read_mask(&bytes_npy("|u1", 2, 3, &pixels), [3, 2]).unwrap(), expected);
        assert_eq!(read_mask(&bytes_npy("|b1", 2, 3, &[1, 0, 0, 0, 1, 1]), [3, 2]).unwrap(), expected);
    }

    #[test]
    fn what_is_no_mask_of_the_image_is_refused() {
        let message = |bytes: &[u8]| read_mask(bytes, [3, 2]).unwrap_err().to_string();
        assert!(message(&grey8(2, 3, &[0; 6])).contains("must have its depth image's size, 3 x 2, got 2 x 3"));
        assert!(message(&bytes_npy("|u1", 3, 2, &[0; 6])).contains("3 x 2, got 2 x 3"));
        assert!(message(&npy_of(&[2, 3], &[0.0; 6])).contains("bool or uint8"));
        assert!(message(b"GIF89a").contains("PNG or NPY"));
        let mut rgb = Vec::new();
        let mut encoder = png::Encoder::new(&mut rgb, 3, 2);
        encoder.set_color(ColorType::Rgb);
        encoder.write_header().unwrap().write_image_data(&[7; 18]).unwrap();
        assert!(message(&rgb).contains("grey PNG, got Rgb"));
        let whole = grey8(3, 2, &[1; 6]);
        for end in 8..whole.len() {
            assert!(read_mask(&whole[..end], [3, 2]).is_err(), "cut at {end}");
        }
        // 16 bits, as numbers of instances have, are taken, too.
        assert_eq!(
            read_mask(&png_of(3, 2, &[7, 0, 255, 256, 65_535, 0]), [3, 2]).unwrap(),
            [true, false, true, true, true, false]
        );
    }
}
