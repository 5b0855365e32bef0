//! Grasps drawn into a camera's image, as PNG: with it one sees at once whether a frame is right.
//!
//! Grasps are lines without depth, the best on top. The bytes depend only on the arguments.

use std::ops::Range;

use program::{ExitCode, Failure};
use schema::{ColorImage, DepthImage, Gripper, Intrinsics, Pose, Vec2, Vec3};

use crate::view::shapes::box_corners_m;
use crate::view::{Class, Line};

/// Green by Okabe and Ito (2008), which the colour-blind distinguish.
const BEST: [u8; 3] = [0, 158, 115];
/// Orange by the same.
const WALL: [u8; 3] = [230, 159, 0];
/// Beside lines, so that they are seen on whatever they cross.
const HALO: [u8; 3] = [255; 3];
/// The longer side of an image whose lines are 2 pixels wide; those of smaller images are not narrower.
const SIDE_PX: f32 = 500.0;
/// How much wider a halo is than its line.
const HALO_WIDTH: f32 = 1.7;
/// What is nearer to the lens than this is not drawn.
const NEAR_M: f32 = 0.02;
/// Lines that end farther off than this are left out: only openings that no gripper has come to that.
const END_PX_MAX: f32 = 1e6;
/// Largest difference between the ratios of an image's sides and of its lens's, as a share.
const ASPECT_OFF_MAX: f32 = 0.01;

/// A grasp to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grasp {
    /// Pose of the grasp in the camera's optical frame: x right, y down, z forward.
    pub camera_from_grasp: Pose,
    /// Distance between the fingers, in metres.
    pub opening_m: f32,
}

/// The image as PNG with grasps drawn into it: the first is the best and on top. Below them are the edges of walls,
/// lines in the camera's optical frame in metres. The lens is scaled to the image if that has another size. The bytes
/// are a pure function of the arguments.
///
/// # Errors
/// If the image's sides have another ratio than the lens's.
pub fn overlay(
    mut image: ColorImage,
    lens: &Intrinsics,
    grasps: &[Grasp],
    walls_m: &[Vec<Vec3>],
    gripper: &Gripper,
) -> Result<Vec<u8>, Failure> {
    let lens = fitted(lens, &image)?;
    let radius_px = (image.width_px.max(image.height_px) as f32 / SIDE_PX).max(1.0);
    let mut stroke = |lines_m: Vec<[Vec3; 2]>, colour: [u8; 3]| {
        let lines: Vec<[Vec2; 2]> = lines_m.into_iter().filter_map(|ends_m| seen(ends_m, &lens)).collect();
        for (radius_px, colour) in [(HALO_WIDTH * radius_px, HALO), (radius_px, colour)] {
            lines.iter().for_each(|ends| draw(&mut image, *ends, radius_px, colour));
        }
    };
    stroke(walls_m.iter().flat_map(|edge| edge.windows(2).map(|ends| [ends[0], ends[1]])).collect(), WALL);
    for (place, grasp) in grasps.iter().enumerate().rev() {
        stroke(lines_m(grasp, gripper, place == 0), of_place(place, grasps.len()));
    }
    png(&image)
}

/// A depth image in grey: light where near, dark where far, black where nothing was seen.
#[must_use]
pub fn grey(depth: &DepthImage) -> ColorImage {
    // By inverse depths, which are linear along a plane; the outermost hundredths are as light and as dark as others.
    let mut seen: Vec<f32> = depth.depth_m.iter().filter(|at_m| **at_m > 0.0).map(|at_m| 1.0 / at_m).collect();
    seen.sort_unstable_by(f32::total_cmp);
    let [far, near] = [1, 99].map(|hundredths| seen.get(seen.len() * hundredths / 100).copied().unwrap_or_default());
    let shade = |at_m: &f32| {
        let nearness = ((1.0 / at_m - far) / (near - far).max(1e-6)).clamp(0.0, 1.0);
        [if *at_m > 0.0 { (50.0 + 190.0 * nearness) as u8 } else { 0 }; 3]
    };
    let pixels = depth.depth_m.iter().map(shade).collect();
    ColorImage { width_px: depth.width_px, height_px: depth.height_px, pixels }
}

/// The lens of the same camera when it delivers an image of this size.
fn fitted(lens: &Intrinsics, image: &ColorImage) -> Result<Intrinsics, Failure> {
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

/// The edges of the best grasp's boxes; of another a fork, because complete grippers would hide the objects.
fn lines_m(grasp: &Grasp, gripper: &Gripper, is_best: bool) -> Vec<[Vec3; 2]> {
    let Grasp { camera_from_grasp, opening_m } = grasp;
    if !is_best {
        let fork = Line::fork(Class::Gripper, "", gripper, camera_from_grasp, *opening_m);
        return fork.points_m.windows(2).map(|ends| [ends[0], ends[1]].map(Vec3::from_array)).collect();
    }
    let edges = |part| {
        let corners: Vec<Vec3> = box_corners_m(part).map(|corner| camera_from_grasp.transform_point(corner)).collect();
        let pairs = (0..corners.len()).flat_map(|from| [1, 2, 4].map(|bit| [from, from | bit]));
        pairs.filter(|[from, to]| from < to).map(move |ends| ends.map(|end| corners[end]))
    };
    gripper.boxes(*opening_m).iter().flat_map(edges).collect()
}

/// A grasp's colour by its rank among the `count` drawn ones: after the best from dark to light grey, so that
/// their order is seen without colours.
fn of_place(place: usize, count: usize) -> [u8; 3] {
    if place == 0 {
        return BEST;
    }
    let share = (place - 1) as f32 / (count.max(6) - 2) as f32;
    [(60.0 + 105.0 * share.min(1.0)) as u8; 3]
}

/// Where a line is in the image, without what is too near; `None` if all of it is, or an end is not finite.
fn seen([from, to]: [Vec3; 2], lens: &Intrinsics) -> Option<[Vec2; 2]> {
    let cut = |end: Vec3, other: Vec3| {
        if end.z < NEAR_M { end + (other - end) * ((NEAR_M - end.z) / (other.z - end.z)) } else { end }
    };
    let ends = [cut(from, to), cut(to, from)]
        .map(|at_m| Vec2::new(lens.fx_px * at_m.x / at_m.z + lens.cx_px, lens.fy_px * at_m.y / at_m.z + lens.cy_px));
    let is_seen = (from.z > NEAR_M || to.z > NEAR_M) && ends.iter().all(|end| end.length() < END_PX_MAX);
    is_seen.then_some(ends)
}

/// Draws a line with round ends; the pixels at its rim are blended.
fn draw(image: &mut ColorImage, [from, to]: [Vec2; 2], radius_px: f32, colour: [u8; 3]) {
    let (along, reach_px) = (to - from, radius_px + 0.5);
    for y in pixels(from.y.min(to.y) - reach_px, from.y.max(to.y) + reach_px, image.height_px) {
        // Only beside the piece of the line that is near this row. Of a level line one of the ends may be 0 / 0, at a
        // row that the line just does not reach.
        let x_at = |down_px: f32| from.x + along.x * ((y as f32 + down_px - from.y) / along.y).clamp(0.0, 1.0);
        let [above, below] = [x_at(-reach_px), x_at(reach_px)];
        for x in pixels(above.min(below) - reach_px, above.max(below) + reach_px, image.width_px) {
            let off = Vec2::new(x as f32, y as f32) - from;
            let share = (off.dot(along) / along.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
            let covered = (reach_px - (off - along * share).length()).clamp(0.0, 1.0);
            for (under, over) in image.pixels[y * image.width_px + x].iter_mut().zip(colour) {
                let (was, full) = (f32::from(*under), f32::from(over));
                *under = (was + (full - was) * covered + 0.5) as u8;
            }
        }
    }
}

/// The pixels of a side between two ends.
fn pixels(low: f32, high: f32, side_px: usize) -> Range<usize> {
    low.max(0.0).ceil() as usize..((high + 1.0).max(0.0) as usize).min(side_px)
}

/// A PNG of three bytes a pixel.
fn png(image: &ColorImage) -> Result<Vec<u8>, Failure> {
    let failed = |reason| Failure::new(ExitCode::Internal, format!("failed to write a PNG: {reason}"));
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, image.width_px as u32, image.height_px as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(image.pixels.as_flattened()).and_then(|()| writer.finish()).map_err(failed)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use schema::{Quat, pose_from_parts};

    use super::*;

    const GREY: [u8; 3] = [200; 3];
    const LENS: Intrinsics =
        Intrinsics { width_px: 640, height_px: 480, fx_px: 600.0, fy_px: 500.0, cx_px: 300.0, cy_px: 420.0 };

    fn gripper() -> Gripper {
        Gripper::from_toml(include_str!("../../configs/grippers/parallel_jaw_80.toml")).unwrap()
    }

    fn empty(width_px: usize, height_px: usize) -> ColorImage {
        ColorImage { width_px, height_px, pixels: vec![GREY; width_px * height_px] }
    }

    /// A grasp that moves down in the image and closes across it.
    fn downwards(at_m: Vec3, opening_m: f32) -> Grasp {
        Grasp { camera_from_grasp: pose_from_parts(Quat::from_xyzw(-0.5, -0.5, -0.5, 0.5), at_m), opening_m }
    }

    fn drawn(image: ColorImage, grasps: &[Grasp]) -> ColorImage {
        decoded(overlay(image, &LENS, grasps, &[], &gripper()).unwrap())
    }

    fn decoded(bytes: Vec<u8>) -> ColorImage {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        let [width_px, height_px] = [info.width, info.height].map(|px| px as usize);
        ColorImage { width_px, height_px, pixels: pixels.as_chunks::<3>().0.to_vec() }
    }

    #[test]
    fn a_finger_s_tip_is_where_the_lens_projects_it_in_an_image_of_any_size() {
        let (gripper, opening_m) = (gripper(), 0.05);
        let tips_m = Vec3::new(0.02, 0.01, 0.4);
        let front_m = tips_m.z - 0.5 * gripper.finger_width_m;
        for scale in [1, 2] {
            let image = drawn(empty(640 * scale, 480 * scale), &[downwards(tips_m, opening_m)]);
            let at = |x_m: f32, off_px: f32| {
                let (u, v) = (600.0 * x_m / front_m + 300.0, 500.0 * tips_m.y / front_m + 420.0);
                let [x, y] = [u, v].map(|at_px| (at_px + 0.5) * scale as f32 - 0.5);
                image.pixels[(y + off_px).round() as usize * image.width_px + x.round() as usize]
            };
            for side in [-1.0, 1.0] {
                let middle_m = tips_m.x + side * 0.5 * (opening_m + gripper.finger_thickness_m);
                let beyond_px = 2.0 * HALO_WIDTH * scale as f32 + 2.0;
                assert_eq!([at(middle_m, 0.0), at(middle_m, beyond_px)], [BEST, GREY], "{side}");
            }
            assert_eq!(at(tips_m.x, 0.0), GREY, "between the fingers");
        }
    }

    #[test]
    fn grasps_behind_the_camera_are_left_out_and_near_ones_are_cut() {
        let image = empty(640, 480);
        let behind = [Vec3::new(0.0, 0.0, -0.4), Vec3::new(0.1, 0.0, -0.1), Vec3::splat(f32::NAN)];
        assert_eq!(drawn(image.clone(), &behind.map(|at_m| downwards(at_m, 0.04))), image);
        // Of these only the best one's palm has a place.
        let boundless = drawn(image.clone(), &[downwards(Vec3::Z, f32::INFINITY); 2]);
        assert!(boundless != image && !boundless.pixels.contains(&[0; 3]));
        // Towards the eye from the front: its palm is behind the camera, its fingers are before it.
        let forwards =
            Grasp { camera_from_grasp: Pose::from_translation(Vec3::new(0.0, -0.03, 0.06)), opening_m: 0.04 };
        let green = drawn(image, &[forwards]).pixels.iter().filter(|pixel| **pixel == BEST).count();
        assert!(green > 500, "{green}");
    }

    #[test]
    fn the_first_grasp_is_the_best_and_on_top_and_bytes_repeat() {
        let image = empty(640, 480);
        let [first, second] = [Vec3::new(0.0, -0.05, 0.4), Vec3::new(0.02, -0.05, 0.35)].map(|at| downwards(at, 0.04));
        let bytes = |grasps: &[Grasp]| overlay(image.clone(), &LENS, grasps, &[], &gripper()).unwrap();
        assert_eq!(bytes(&[first, second]), bytes(&[first, second]));
        assert_ne!(bytes(&[first, second]), bytes(&[second, first]));
        let green = |grasps: &[Grasp]| {
            drawn(image.clone(), grasps).pixels.iter().map(|pixel| *pixel == BEST).collect::<Vec<_>>()
        };
        assert!(green(&[first, second]) == green(&[first]), "although the second is nearer");
    }

    #[test]
    fn edges_of_walls_are_where_the_lens_projects_them() {
        let edge_m = [[-0.1, 0.0, 0.5], [0.1, 0.0, 0.5], [0.1, -0.1, 0.5]].map(Vec3::from_array).to_vec();
        let bytes = overlay(empty(640, 480), &LENS, &[], &[edge_m], &gripper()).unwrap();
        let image = decoded(bytes);
        let at = |u: usize, v: usize| image.pixels[v * image.width_px + u];
        assert_eq!([at(300, 420), at(420, 370), at(300, 370), at(180, 370)], [WALL, WALL, GREY, GREY]);
    }

    #[test]
    fn grasps_fade_with_their_rank() {
        for count in [2, 3, 12] {
            let greys: Vec<u8> = (1..count).map(|place| of_place(place, count)[0]).collect();
            assert!(greys.is_sorted() && greys[0] == 60 && greys[greys.len() - 1] <= 165, "{greys:?}");
        }
    }

    #[test]
    fn an_image_of_another_shape_is_refused_with_both_sizes() {
        let refused = overlay(empty(640, 360), &LENS, &[], &[], &gripper()).unwrap_err();
        assert_eq!(refused.to_string(), "an image of 640 x 360 pixels does not fit intrinsics for 640 x 480");
        assert_eq!(refused.exit_code(), ExitCode::Config);
        assert_eq!(drawn(empty(427, 320), &[]), empty(427, 320), "rounded as cameras do");
    }

    #[test]
    fn near_is_light_far_is_dark_and_unseen_is_black() {
        let depth_m = vec![0.5, 1.0, 0.0, 0.7, f32::NAN, 1.0];
        let image = grey(&DepthImage { width_px: 3, height_px: 2, depth_m });
        let [near, far, unseen, between, unknown, _] = image.pixels[..] else { panic!() };
        assert!(near > between && between > far && far > unseen, "{image:?}");
        assert_eq!([unseen, unknown], [[0; 3]; 2]);
        let nothing = DepthImage { width_px: 1, height_px: 1, depth_m: vec![0.0] };
        assert_eq!(grey(&nothing).pixels, [[0; 3]]);
    }
}
