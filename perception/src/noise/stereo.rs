//! Depth noise of sensors that triangulate: uniform in disparity, so it grows with depth squared; quantised; and
//! without depth where not everything that must see a surface sees it.

use schema::{DepthImage, Stream};

use super::edges::{EdgeNoise, move_edges};
use super::lattice::Lattice;
use super::loss::{Loss, lose};

/// Errors of a sensor that finds depth by matching two images, or an image and a projected pattern.
///
/// Two imagers, or an imager and a projector, are `baseline_m` apart along the camera's x. A point at depth z is at
/// places in their images that differ by the disparity d = focal length · baseline / z. The sensor measures d with an
/// error that does not depend on z, so depth has the error z² · error / (focal length · baseline) (Keselman et al.
/// 2017, equation 2; Intel's "Tuning depth cameras for best performance"). The quantisation steps grow in the same way.
///
/// Pixels that one of the two does not see have no depth. An imager to the right of the camera by b sees a pixel moved
/// to the left by focal length · b / z, so it does not see the background to the left of a foreground object, as many
/// pixels as these differ; one to the left not that to the right. Where both are beside the camera, for the image was
/// moved to a colour camera's place, both sides can have shadows. If the image is that of the left imager, a band at
/// its left edge is beyond the right one's view ("invalid depth band" in the D400 series' datasheet). A surface also
/// hides itself where disparity rises to the right by at least half a pixel per pixel, on faces that turn away from the
/// right imager (at 0.6 m and 50 mm of baseline by 80°).
///
/// Not modelled: the minimum depth, given by the searched range of disparities; where in the image things are dark,
/// glossy or without texture; calibration errors, which stay the same from image to image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StereoNoise {
    /// Focal length along u of the image, in pixels.
    pub focal_px: f32,
    /// Distance between the imagers, or imager and projector, in metres.
    pub baseline_m: f32,
    /// How far right of the camera the rightmost of what must see a surface stands, and how far left the leftmost.
    pub seen_from_m: [f32; 2],
    /// Whether the other imager's view ends where the camera's does, so that there is a band without depth.
    pub has_band: bool,
    /// Standard deviation of the disparity at every pixel before it is rounded, in pixels.
    pub subpixel_std_px: f32,
    /// Distance between the lattice points from which the error is interpolated, along u and v, in pixels; at least 1.
    /// Errors two such cells apart are independent.
    pub smooth_cell_px: [f32; 2],
    /// Quantisation step of the disparity, in pixels; 0 for none.
    pub disparity_step_px: f32,
    /// Quantisation step of the depth that is made of it, in metres; 0 for none.
    pub depth_step_m: f32,
    /// What the window of matching does beside edges.
    pub edges: EdgeNoise,
    /// Holes within surfaces.
    pub loss: Loss,
}

impl StereoNoise {
    /// The same sensor behind another lens, or with its image scaled: all that it has in pixels stays as wide in angle.
    #[must_use]
    pub fn through(self, focal_px: f32) -> Self {
        let scale = focal_px / self.focal_px;
        Self {
            focal_px,
            subpixel_std_px: self.subpixel_std_px * scale,
            smooth_cell_px: self.smooth_cell_px.map(|cell_px| (cell_px * scale).max(1.0)),
            disparity_step_px: self.disparity_step_px * scale,
            edges: self.edges.scaled(scale),
            loss: self.loss.scaled(scale),
            ..self
        }
    }
}

pub(super) fn add_stereo_noise(image: &mut DepthImage, stereo: &StereoNoise, stream: &mut Stream) {
    let errors_px = Lattice::of_cells(image, stereo.smooth_cell_px, stereo.subpixel_std_px, stream);
    let depth_times_disparity = stereo.focal_px * stereo.baseline_m;
    let disparity = |depth: &f32| if *depth > 0.0 { depth_times_disparity / depth } else { 0.0 };
    let real_px: Vec<f32> = image.depth_m.iter().map(disparity).collect();
    let mut seen_px = real_px.clone();
    for row in seen_px.chunks_exact_mut(image.width_px.max(1)) {
        let [right, left] = stereo.seen_from_m.map(|offset_m| offset_m / stereo.baseline_m);
        hide_unseen(row.iter_mut(), right, stereo.has_band);
        hide_unseen(row.iter_mut().rev(), left, false);
    }
    move_edges(image, &stereo.edges, &real_px, &mut seen_px, stream);
    lose(image, &stereo.loss, stereo.focal_px, &real_px, &mut seen_px, stream);
    for ((depth, disparity), error_px) in image.depth_m.iter_mut().zip(seen_px).zip(errors_px.even()) {
        let measured = rounded(disparity + error_px, stereo.disparity_step_px);
        let is_measured = disparity > 0.0 && measured > 0.0;
        *depth = rounded(if is_measured { depth_times_disparity / measured } else { 0.0 }, stereo.depth_step_m);
    }
}

/// The nearest multiple of a step; 0 for none.
pub(super) fn rounded(value: f32, step: f32) -> f32 {
    if step > 0.0 { (value / step).round() * step } else { value }
}

/// Sets to 0 the disparities in a row of pixels that another imager does not see; 0 means no depth. It stands to the
/// right, `share` of the baseline away; for one to the left the row is reversed. At 0 it is where the camera is.
///
/// Pixel u with disparity d is at u − d in the other image. A pixel is hidden if a nearer one is there, too, within
/// half a pixel. That nearer pixel is further right in this image, so a scan to the left only needs to know how far
/// left the other image is covered. Pixels visible out of order, beyond an object narrower than the difference of
/// disparities, count as hidden, so a slanted face has no gaps where its pixels are more than one apart in the other
/// image.
fn hide_unseen<'a>(
    disparity_px: impl ExactSizeIterator<Item = &'a mut f32> + DoubleEndedIterator,
    share: f32,
    has_band: bool,
) {
    if share <= 0.0 {
        return;
    }
    let mut covered_from = f32::INFINITY;
    for (u, disparity) in disparity_px.enumerate().rev() {
        if *disparity > 0.0 {
            let other_u = u as f32 - *disparity * share;
            let seen = (other_u >= -0.5 || !has_band) && other_u + 0.5 < covered_from;
            covered_from = covered_from.min(other_u);
            if !seen {
                *disparity = 0.0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::noise::tests::{flat_image, moments, stream};
    use crate::noise::{DepthNoise, add_depth_noise};

    /// Depth times disparity of [`StereoNoise::D435`].
    const METRE_PIXELS: f32 = 27.0;

    fn spoil(mut image: DepthImage, stereo: StereoNoise, scene: u64) -> DepthImage {
        add_depth_noise(&mut image, &DepthNoise::Stereo(stereo), &mut stream(scene));
        image
    }

    fn without_errors() -> StereoNoise {
        StereoNoise { subpixel_std_px: 0.0, ..StereoNoise::D435 }
    }

    /// Every eighth pixel of each eighth row: more than two cells apart, so they share no lattice point and are
    /// independent. A wall at 0.3 m has no depth in the first 90 columns.
    fn independent_pixels(image: &DepthImage) -> Vec<f64> {
        let rows = (0..480).step_by(8);
        rows.flat_map(|v| (96..640).step_by(8).map(move |u| f64::from(image.depth_m[v * 640 + u]))).collect()
    }

    /// Rounding to a step adds step² / 12 to the variance. Tolerances are four standard errors, std / √n for the mean
    /// and a share of 1 / √(2n) for the standard deviation.
    #[test]
    fn a_walls_error_grows_with_depth_squared() {
        let std_px = (0.08_f64.powi(2) + (1.0_f64 / 32.0).powi(2) / 12.0).sqrt();
        for depth_m in [0.3, 0.6, 1.2] {
            let walls = (0..3).map(|scene| spoil(flat_image(640, 480, depth_m), StereoNoise::D435, scene));
            let values: Vec<f64> = walls.flat_map(|wall| independent_pixels(&wall)).collect();
            let (mean_m, variance) = moments(&values);
            let (count, depth_m) = (values.len() as f64, f64::from(depth_m));
            let expected_m = depth_m.powi(2) * std_px / (540.0 * 0.05);
            assert!((mean_m - depth_m).abs() < 4.0 * expected_m / count.sqrt(), "mean {mean_m} m at {depth_m} m");
            let ratio = variance.sqrt() / expected_m;
            assert!((ratio - 1.0).abs() < 4.0 / (2.0 * count).sqrt(), "{ratio} of {expected_m} m at {depth_m} m");
        }
    }

    #[test]
    fn errors_are_alike_within_the_window_and_independent_beyond() {
        let wall = spoil(flat_image(640, 480, 0.6), StereoNoise::D435, 4);
        let correlation = |pairs: &[(f64, f64)]| {
            let products = pairs.iter().map(|(a, b)| (*a - 0.6) * (*b - 0.6)).sum::<f64>();
            products / pairs.iter().map(|(a, _)| (*a - 0.6).powi(2)).sum::<f64>()
        };
        let far = independent_pixels(&wall);
        let far: Vec<(f64, f64)> = far.iter().copied().zip(far.iter().copied().skip(1)).collect();
        let bound = 4.0 / (far.len() as f64).sqrt();
        assert!(correlation(&far).abs() < bound, "{} at 8 px", correlation(&far));
        let near: Vec<(f64, f64)> = (0..480)
            .flat_map(|v| wall.depth_m[v * 640 + 96..(v + 1) * 640].windows(2))
            .map(|pair| (f64::from(pair[0]), f64::from(pair[1])))
            .collect();
        assert!(correlation(&near) > 0.8, "{} at 1 px", correlation(&near));
    }

    /// From 1 m to 1.1 m, disparities go from 864 steps to 785.45.
    #[test]
    fn depth_comes_in_steps_of_disparity() {
        let (width, rows) = (48, 480);
        let mut ramp = flat_image(width, rows, 0.0);
        for (pixel, depth) in ramp.depth_m.iter_mut().enumerate() {
            *depth = 1.0 + 0.1 * ((pixel / width) as f32 / (rows - 1) as f32);
        }
        let spoiled = spoil(ramp.clone(), without_errors(), 0);
        let mut levels = BTreeSet::new();
        for v in 0..rows {
            let pixel = v * width + 40;
            let (before_px, after_px) = (METRE_PIXELS / ramp.depth_m[pixel], METRE_PIXELS / spoiled.depth_m[pixel]);
            assert!((after_px * 32.0 - (after_px * 32.0).round()).abs() < 1e-3, "{after_px} px is between steps");
            assert!((after_px - before_px).abs() < 1.0 / 64.0 + 1e-5, "{before_px} px became {after_px} px");
            levels.insert(spoiled.depth_m[pixel].to_bits());
        }
        // Positive floats sort as their bits do.
        let levels: Vec<f32> = levels.into_iter().map(f32::from_bits).collect();
        assert_eq!(levels.len(), 864 - 785 + 1);
        for pair in levels.windows(2) {
            let (step_m, middle_m) = (pair[1] - pair[0], 0.5 * (pair[0] + pair[1]));
            let expected_m = middle_m * middle_m / (32.0 * METRE_PIXELS);
            assert!((step_m / expected_m - 1.0).abs() < 0.01, "a step of {step_m} m at {middle_m} m");
        }
    }

    /// A box 12 px of disparity in front of a wall, compared with lines from the right imager to the wall, in metres.
    #[test]
    fn a_box_casts_its_shadow_to_the_left() {
        let (width, height, centre_px) = (160, 30, 80.0);
        let (wall_m, box_m) = (METRE_PIXELS / 20.0, METRE_PIXELS / 32.0);
        let is_box = |u: usize, v: usize| (80..110).contains(&u) && (10..20).contains(&v);
        let mut image = flat_image(width, height, wall_m);
        for (pixel, depth) in image.depth_m.iter_mut().enumerate() {
            if is_box(pixel % width, pixel / width) {
                *depth = box_m;
            }
        }
        let spoiled = spoil(image.clone(), without_errors(), 0);

        let (focal_px, baseline_m) = (540.0, 0.05);
        let (wall_m, box_m) = (f64::from(wall_m), f64::from(box_m));
        let seen_from_the_right = |u: usize, v: usize| {
            let depth_m = if is_box(u, v) { box_m } else { wall_m };
            let x_m = (u as f64 - centre_px) * depth_m / focal_px;
            let on_right_image = (x_m - baseline_m) * focal_px / depth_m + centre_px > -0.5;
            let at_box_m = baseline_m + (x_m - baseline_m) * box_m / wall_m;
            let at_box_px = at_box_m * focal_px / box_m + centre_px;
            let hidden = !is_box(u, v) && (10..20).contains(&v) && (79.5..109.5).contains(&at_box_px);
            on_right_image && !hidden
        };
        for (pixel, (before, after)) in image.depth_m.iter().zip(&spoiled.depth_m).enumerate() {
            let (u, v) = (pixel % width, pixel / width);
            let expected = if seen_from_the_right(u, v) { *before } else { 0.0 };
            assert!((after - expected).abs() < 1e-6, "{after} m at {u}, {v}, expected {expected}");
        }
        let holes = |v: usize| -> Vec<usize> { (0..width).filter(|u| spoiled.at([*u, v]).is_none()).collect() };
        assert_eq!(holes(5), (0..20).collect::<Vec<usize>>());
        assert_eq!(holes(15), (0..20).chain(68..80).collect::<Vec<usize>>());
    }

    /// What must see a surface stands 50 mm to the right and 25 mm to the left of a Kinect's image. At 525 px, a
    /// difference of 12 / 26.25 of 1/z is 12 px for the one and 6 px for the other; and there is no band.
    #[test]
    fn what_stands_on_both_sides_casts_shadows_to_both() {
        let stereo = StereoNoise {
            subpixel_std_px: 0.0,
            disparity_step_px: 0.0,
            edges: EdgeNoise::NONE,
            loss: Loss::NONE,
            ..StereoNoise::KINECT
        };
        for (scale, [left_px, right_px]) in [(1.0, [12, 6]), (2.0, [24, 12])] {
            let mut image = flat_image(200, 3, 1.0);
            for (pixel, depth) in image.depth_m.iter_mut().enumerate() {
                if (80..120).contains(&(pixel % 200)) {
                    *depth = 1.0 / (1.0 + 12.0 / 26.25);
                }
            }
            let spoiled = spoil(image, stereo.through(525.0 * scale), 0);
            let holes: Vec<usize> = (0..200).filter(|u| spoiled.at([*u, 1]).is_none()).collect();
            assert_eq!(holes, (80 - left_px..80).chain(120..120 + right_px).collect::<Vec<usize>>());
        }
    }

    /// Behind a lens of half the focal length, what is in pixels halves, and a wall's error in metres stays.
    #[test]
    fn another_lens_leaves_the_errors_in_metres() {
        let plain = StereoNoise { edges: EdgeNoise::NONE, loss: Loss::NONE, ..StereoNoise::D435_REAL };
        let deviation = |stereo: StereoNoise| {
            let walls = (0..4).map(|scene| spoil(flat_image(640, 480, 0.8), stereo, scene));
            let errors: Vec<f64> = walls.flat_map(|wall| independent_pixels(&wall)).collect();
            moments(&errors).1.sqrt()
        };
        let expected_m = 0.8 * 0.8 * 0.26 / (927.0 * 0.05);
        for focal_px in [927.0, 463.5] {
            let found_m = deviation(plain.through(focal_px));
            assert!((found_m / expected_m - 1.0).abs() < 0.05, "{found_m} m for {expected_m} m at {focal_px} px");
        }
    }

    /// Comparison with all pairs of pixels: a pixel is hidden by a nearer one that is at the same place in the right
    /// image, or that has changed order with it. Disparities are eighths of a pixel, so that ties are exact.
    #[test]
    fn what_is_hidden_is_what_every_pair_says() {
        let mut stream = stream(11);
        let (mut seen_count, mut hidden_count) = (0, 0);
        for _ in 0..300 {
            let mut row: Vec<f32> = Vec::new();
            for _ in 0..64 {
                let another = stream.index(96) as f32 / 8.0;
                let goes_on = stream.index(4) > 0;
                let disparity = row.last().copied().filter(|_| goes_on).unwrap_or(another);
                row.push(disparity);
            }
            let mut swept = row.clone();
            hide_unseen(swept.iter_mut(), 1.0, true);
            for (u, disparity) in row.iter().enumerate() {
                let right_u = u as f32 - disparity;
                let hidden = row.iter().enumerate().any(|(other, nearer)| {
                    let other_right_u = other as f32 - nearer;
                    let same_place = (other_right_u - right_u).abs() <= 0.5;
                    nearer > disparity && (same_place || (other > u && other_right_u < right_u))
                });
                let seen = *disparity > 0.0 && right_u >= -0.5 && !hidden;
                assert_eq!(swept[u], if seen { *disparity } else { 0.0 }, "pixel {u} of {row:?}");
                seen_count += usize::from(seen);
                hidden_count += usize::from(hidden && *disparity > 0.0);
            }
        }
        assert!(seen_count > 1000 && hidden_count > 1000, "{seen_count} seen, {hidden_count} hidden");
    }

    /// 64 × 48 pixels have 19 × 14 lattice points, and a normal variate is two draws of the stream.
    #[test]
    fn what_the_image_shows_changes_neither_the_draws_nor_the_rest_of_it() {
        let mut shows_more = flat_image(64, 48, 1.35);
        for (pixel, depth) in shows_more.depth_m.iter_mut().enumerate() {
            match pixel % 64 {
                40..50 => *depth = 0.9,
                60.. => *depth = 0.0,
                _ => {}
            }
        }
        let (mut wall, mut counted) = (flat_image(64, 48, 1.35), stream(4));
        let (mut of_wall, mut of_more) = (counted.clone(), counted.clone());
        add_depth_noise(&mut wall, &DepthNoise::Stereo(StereoNoise::D435), &mut of_wall);
        add_depth_noise(&mut shows_more, &DepthNoise::Stereo(StereoNoise::D435), &mut of_more);
        for _ in 0..2 * 19 * 14 {
            counted.bits();
        }
        let next = counted.bits();
        assert_eq!([of_wall.bits(), of_more.bits()], [next, next]);
        // Disparities 20 and 30: a band of 20 columns, and the ten before the near ones are hidden.
        for (pixel, (wall, more)) in wall.depth_m.iter().zip(&shows_more.depth_m).enumerate() {
            match pixel % 64 {
                0..20 => assert_eq!([*wall, *more], [0.0, 0.0], "pixel {pixel}"),
                30..40 | 60.. => assert!(*wall > 0.0 && *more == 0.0, "{wall} m, {more} m at pixel {pixel}"),
                40..50 => assert!(*wall > 1.3 && *more > 0.0 && *more < 1.0, "{wall} m, {more} m at pixel {pixel}"),
                _ => assert!(*wall > 0.0 && wall == more, "{wall} m, {more} m at pixel {pixel}"),
            }
        }
    }

    #[test]
    fn nothing_seen_stays_nothing_seen_and_casts_no_shadow() {
        let mut image = flat_image(64, 16, 1.0);
        let nothing = [0.0, -0.5, f32::NAN, f32::INFINITY];
        for row in image.depth_m.chunks_exact_mut(64) {
            for (n, depth) in nothing.iter().enumerate() {
                row[40 + 5 * n] = *depth;
            }
        }
        let spoiled = spoil(image, StereoNoise::D435, 3);
        for (pixel, depth) in spoiled.depth_m.iter().enumerate() {
            let u = pixel % 64;
            let seen = u >= 27 && ![40, 45, 50, 55].contains(&u);
            assert!(if seen { (depth - 1.0).abs() < 0.05 } else { *depth == 0.0 }, "{depth} m at {u}");
        }
    }

    /// Datasets have these bytes: a slanted wall with a box before it and a hole, through [`StereoNoise::D435`].
    #[test]
    fn a_d435_keeps_its_bytes() {
        let mut image = flat_image(160, 120, 0.0);
        for (pixel, depth) in image.depth_m.iter_mut().enumerate() {
            let (u, v) = (pixel % 160, pixel / 160);
            *depth = match (u, v) {
                (90..130, 30..80) => 0.45,
                (140..150, 90..100) => 0.0,
                _ => 0.6 + 0.002 * v as f32,
            };
        }
        let spoiled = spoil(image, StereoNoise::D435, 5);
        let digest = spoiled.depth_m.iter().fold(0xcbf2_9ce4_8422_2325_u64, |digest, depth| {
            (digest ^ u64::from(depth.to_bits())).wrapping_mul(0x0100_0000_01b3)
        });
        assert_eq!(digest, 3_366_835_714_722_621_606);
    }

    #[test]
    fn no_match_before_infinity_is_no_depth() {
        let far_m = 10.0 * METRE_PIXELS;
        let stereo = StereoNoise { subpixel_std_px: 1.0, ..StereoNoise::D435 };
        let spoiled = spoil(flat_image(64, 48, far_m), stereo, 8);
        assert!(spoiled.depth_m.iter().all(|depth| depth.is_finite() && *depth >= 0.0));
        let lost = spoiled.depth_m.iter().filter(|depth| **depth == 0.0).count();
        assert!((64 * 48 / 4..64 * 48 * 3 / 4).contains(&lost), "{lost} pixels without depth");
    }
}
