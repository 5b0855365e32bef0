//! The image, the hands in it, and the PNG.

use program::{ExitCode, Failure};
use rayon::prelude::*;
use schema::{Gripper, Intrinsics, Pose};

use super::canvas::Canvas;
use super::hand::hand;
use super::layer::Rgb;

/// Images are drawn in bands of about so many pixels, which bounds the memory.
const BAND_PX: usize = 1 << 18;
/// The longer side of an image whose lines are as wide as [`super::hand`] says.
const SIDE_PX: f32 = 2000.0;
/// Largest difference between the ratios of an image's sides and of its lens's, as a share.
const ASPECT_OFF_MAX: f32 = 0.01;

/// An image of 8-bit colours.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Pixels in a row.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// Red, green and blue, row by row.
    pub pixels: Vec<Rgb>,
}

/// A hand to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hand {
    /// Pose of the grasp in the camera's optical frame: x right, y down, z forward.
    pub camera_from_grasp: Pose,
    /// Distance between the fingers, in metres.
    pub opening_m: f32,
}

/// The image as PNG with hands drawn into it: the first is the best and on top. The lens is scaled to the image if that
/// has another size. The bytes are a pure function of the arguments.
///
/// # Errors
/// If the image's sides have another ratio than the lens's.
pub fn overlay(image: &Image, lens: &Intrinsics, hands: &[Hand], gripper: &Gripper) -> Result<Vec<u8>, Failure> {
    let lens = fitted(lens, image)?;
    let pen = image.width_px.max(image.height_px) as f32 / SIDE_PX;
    let rows = (BAND_PX / image.width_px).max(1);
    let draw = |(band, pixels): (usize, &[[u8; 3]])| {
        let (height_px, cy_px) = (pixels.len() / image.width_px, lens.cy_px - (band * rows) as f32);
        let mut canvas = Canvas::over(pixels, &Intrinsics { height_px, cy_px, ..lens }, pen);
        for (place, Hand { camera_from_grasp, opening_m }) in hands.iter().enumerate().rev() {
            hand(&mut canvas, camera_from_grasp, *opening_m, gripper, [place, hands.len()]);
        }
        canvas.image()
    };
    let bands: Vec<Vec<u8>> = image.pixels.par_chunks(rows * image.width_px).enumerate().map(draw).collect();
    png(&bands.concat(), [image.width_px, image.height_px])
}

/// The lens of the same camera when it delivers an image of this size.
fn fitted(lens: &Intrinsics, image: &Image) -> Result<Intrinsics, Failure> {
    let (width_px, height_px) = (image.width_px, image.height_px);
    let [across, down] = [width_px as f32 / lens.width_px as f32, height_px as f32 / lens.height_px as f32];
    if (across / down - 1.0).abs() > ASPECT_OFF_MAX {
        let [lens_width_px, lens_height_px] = [lens.width_px, lens.height_px];
        return Err(Failure::new(
            ExitCode::Config,
            format!(
                "an image of {width_px} x {height_px} pixels does not fit intrinsics for {lens_width_px} x {lens_height_px}"
            ),
        ));
    }
    // Pixels have their centres at whole numbers.
    let centre = |at_px: f32, scale: f32| (at_px + 0.5) * scale - 0.5;
    Ok(Intrinsics {
        width_px,
        height_px,
        fx_px: lens.fx_px * across,
        fy_px: lens.fy_px * down,
        cx_px: centre(lens.cx_px, across),
        cy_px: centre(lens.cy_px, down),
    })
}

/// A PNG of three bytes a pixel.
fn png(pixels: &[u8], [width, height]: [usize; 2]) -> Result<Vec<u8>, Failure> {
    let failed = |reason| Failure::new(ExitCode::Internal, format!("failed to write a PNG: {reason}"));
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(pixels).and_then(|()| writer.finish()).map_err(failed)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use schema::{Quat, Vec3, pose_from_parts};

    use super::super::hand::BEST;
    use super::super::layer::lit;
    use super::*;

    const GREY: Rgb = [200; 3];
    /// Its image has two bands, of which the second begins at row 409.
    const LENS: Intrinsics =
        Intrinsics { width_px: 640, height_px: 480, fx_px: 600.0, fy_px: 500.0, cx_px: 300.0, cy_px: 420.0 };

    fn gripper() -> Gripper {
        Gripper::from_toml(include_str!("../../../configs/grippers/parallel_jaw_80.toml")).unwrap()
    }

    fn empty(width_px: usize, height_px: usize) -> Image {
        Image { width_px, height_px, pixels: vec![GREY; width_px * height_px] }
    }

    /// A hand that moves down in the image and closes across it.
    fn downwards(at_m: Vec3, opening_m: f32) -> Hand {
        Hand { camera_from_grasp: pose_from_parts(Quat::from_xyzw(-0.5, -0.5, -0.5, 0.5), at_m), opening_m }
    }

    fn drawn(image: &Image, hands: &[Hand]) -> Image {
        decoded(&overlay(image, &LENS, hands, &gripper()).unwrap())
    }

    fn decoded(bytes: &[u8]) -> Image {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        let [width_px, height_px] = [info.width, info.height].map(|px| px as usize);
        Image { width_px, height_px, pixels: pixels.as_chunks::<3>().0.to_vec() }
    }

    /// Whether it is of the best hand's fingers, whichever way its surface looks.
    fn is_finger([red, green, blue]: Rgb) -> bool {
        let [_, dark, _] = lit(BEST, 0.4);
        red < 12 && green >= dark && green > blue
    }

    #[test]
    fn fingers_are_where_the_lens_projects_them_in_an_image_of_any_size() {
        let (hand, opening_m) = (gripper(), 0.05);
        let tips_m = Vec3::new(0.02, 0.01, 0.4);
        let front_m = tips_m.z - 0.5 * hand.finger_width_m;
        for scale in [1, 2] {
            let image = drawn(&empty(640 * scale, 480 * scale), &[downwards(tips_m, opening_m)]);
            let large = scale as f32;
            let pixel = |x_m: f32, y_m: f32| {
                let (u, v) = (600.0 * x_m / front_m + 300.0, 500.0 * y_m / front_m + 420.0);
                [u, v].map(|at_px| (at_px + 0.5) * large - 0.5)
            };
            for (side, edges_m) in [(-1.0, [-1.0, 0.0]), (1.0, [0.0, 1.0])] {
                let inner_m = tips_m.x + side * 0.5 * opening_m;
                let [left, right] = edges_m.map(|share: f32| inner_m + share * hand.finger_thickness_m);
                for share in [0.1, 0.3, 0.6, 0.9] {
                    let y_m = tips_m.y - share * hand.finger_length_m;
                    let ([first, v], [last, _]) = (pixel(left, y_m), pixel(right, y_m));
                    let row = &image.pixels[v.round() as usize * image.width_px..][..image.width_px];
                    // A side of the finger may be seen beside its front, towards the image's middle.
                    let near = |u: f32| is_finger(row[u.round() as usize]);
                    assert!(near(first + 2.0 * large) && near(last - 2.0 * large), "{side} {share}: {first} {last}");
                    let outer = if side < 0.0 { first - 2.0 * large } else { last + 2.0 * large };
                    assert!(!near(outer), "{side} {share}: {outer}");
                }
                let ([u, end], middle) = (pixel(0.5 * (left + right), tips_m.y), pixel(tips_m.x, tips_m.y));
                let at = |u: f32, v: f32| image.pixels[v.round() as usize * image.width_px + u.round() as usize];
                assert!(is_finger(at(u, end - 2.5 * large)) && at(u, end + 2.5 * large) == GREY, "{side} {end}");
                assert_eq!(at(middle[0], end + 2.5 * large), GREY);
            }
        }
    }

    #[test]
    fn hands_behind_the_camera_are_left_out_and_near_ones_are_cut() {
        let image = empty(640, 480);
        let behind = [Vec3::new(0.0, 0.0, -0.4), Vec3::new(0.1, 0.0, -0.1), Vec3::splat(f32::NAN)];
        assert_eq!(drawn(&image, &behind.map(|at_m| downwards(at_m, 0.04))), image);
        assert_eq!(drawn(&image, &[downwards(Vec3::Z, f32::INFINITY); 2]).pixels.len(), image.pixels.len());
        // Towards the eye from the front: its palm is behind the camera, its fingers are before it.
        let forwards = Hand { camera_from_grasp: Pose::from_translation(Vec3::new(0.0, -0.03, 0.06)), opening_m: 0.04 };
        let near = drawn(&image, &[forwards]);
        assert!(near.pixels.iter().filter(|pixel| is_finger(**pixel)).count() > 500);
        assert_ne!(drawn(&image, &[downwards(Vec3::Z * 0.4, 0.04), forwards]), near);
    }

    #[test]
    fn the_first_hand_is_the_best_and_on_top_and_bytes_repeat() {
        let image = empty(640, 480);
        let [first, second] = [Vec3::new(0.0, -0.05, 0.4), Vec3::new(0.02, -0.05, 0.35)].map(|at| downwards(at, 0.04));
        let bytes = |hands: &[Hand]| overlay(&image, &LENS, hands, &gripper()).unwrap();
        assert_eq!(bytes(&[first, second]), bytes(&[first, second]));
        assert_ne!(bytes(&[first, second]), bytes(&[second, first]));
        let fingers =
            |hands: &[Hand]| drawn(&image, hands).pixels.iter().map(|rgb| is_finger(*rgb)).collect::<Vec<_>>();
        assert_eq!(fingers(&[first, second]), fingers(&[first]), "although the second is nearer");
    }

    #[test]
    fn an_image_of_another_shape_is_refused_with_both_sizes() {
        let refused = overlay(&empty(640, 360), &LENS, &[], &gripper()).unwrap_err();
        assert_eq!(refused.to_string(), "an image of 640 x 360 pixels does not fit intrinsics for 640 x 480");
        assert_eq!(refused.exit_code(), program::ExitCode::Config);
        assert_eq!(drawn(&empty(427, 320), &[]), empty(427, 320), "rounded as cameras do");
    }
}
