//! Depth noise of a time-of-flight camera: light from both sides of an edge mixes in one pixel.

use schema::{DepthImage, Stream};

use super::lattice::Lattice;
use super::loss::{Loss, lose};
use super::stereo::rounded;

/// Errors of a camera that measures how long its own light travels.
///
/// The light that comes back falls with z², so the error grows so. The illuminator is beside the lens, so nothing casts
/// a shadow. A pixel on an edge gets light of two surfaces and shows a depth between them.
///
/// Not modelled: light that comes on a second way, over corners (it makes concave corners rounder and deeper), and
/// errors that stay the same from image to image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightNoise {
    /// Focal length along u of the image, in pixels.
    pub focal_px: f32,
    /// Standard deviation at a depth of 1 m, in metres.
    pub std_at_1_m: f32,
    /// Distance between the lattice points from which the error is interpolated, in pixels; at least 1.
    pub smooth_cell_px: f32,
    /// Share of the pixels on the far side of an edge that have a depth between both sides.
    pub flying_share: f32,
    /// Share of them that are given up.
    pub invalid_share: f32,
    /// Largest angle between a ray and the camera's axis that has depth.
    pub view_rad: f32,
    /// Quantisation step, in metres; 0 for none.
    pub depth_step_m: f32,
    /// Holes within surfaces.
    pub loss: Loss,
}

/// Depths that differ by more than this share of the nearer one are two surfaces.
const EDGE_SHARE: f32 = 0.03;

impl FlightNoise {
    /// The same sensor behind another lens: what it has in pixels stays as wide in angle.
    #[must_use]
    pub fn through(self, focal_px: f32) -> Self {
        let scale = focal_px / self.focal_px;
        let smooth_cell_px = (self.smooth_cell_px * scale).max(1.0);
        Self { focal_px, smooth_cell_px, loss: self.loss.scaled(scale), ..self }
    }
}

pub(super) fn add_flight_noise(image: &mut DepthImage, flight: &FlightNoise, stream: &mut Stream) {
    let errors_m = Lattice::of_cells(image, [flight.smooth_cell_px; 2], flight.std_at_1_m, stream);
    // One draw a pixel: whether it flies, and how far.
    let luck: Vec<f32> = image.depth_m.iter().map(|_| stream.unit() as f32).collect();
    let slopes: Vec<f32> = image.depth_m.iter().map(|depth| if *depth > 0.0 { depth.recip() } else { 0.0 }).collect();
    let mut depth_m: Vec<f32> = (0..luck.len()).map(|pixel| mixed(image, flight, pixel, luck[pixel])).collect();
    lose(image, &flight.loss, flight.focal_px, &slopes, &mut depth_m, stream);
    let reach_px = flight.focal_px * libm::tanf(flight.view_rad);
    for (pixel, (mixed_m, error_m)) in depth_m.into_iter().zip(errors_m.even()).enumerate() {
        let (u, v) = (pixel % image.width_px, pixel / image.width_px);
        let x_px = u as f32 + 0.5 - 0.5 * image.width_px as f32;
        let y_px = v as f32 + 0.5 - 0.5 * image.height_px as f32;
        let in_view = x_px * x_px + y_px * y_px <= reach_px * reach_px;
        let measured_m = (mixed_m + error_m * mixed_m * mixed_m).max(0.0);
        image.depth_m[pixel] = if in_view && mixed_m > 0.0 { rounded(measured_m, flight.depth_step_m) } else { 0.0 };
    }
}

/// The depth at which a pixel's light seems to come back; 0 if it is given up.
fn mixed(image: &DepthImage, flight: &FlightNoise, pixel: usize, luck: f32) -> f32 {
    let (u, v, width) = (pixel % image.width_px, pixel / image.width_px, image.width_px);
    let here_m = image.depth_m[pixel];
    let depth = |is_there: bool, at: fn(usize, usize) -> usize| {
        if is_there { image.depth_m[at(pixel, width)] } else { 0.0 }
    };
    let beside = [
        depth(u > 0, |pixel, _| pixel - 1),
        depth(u + 1 < width, |pixel, _| pixel + 1),
        depth(v > 0, |pixel, width| pixel - width),
        depth(v + 1 < image.height_px, |pixel, width| pixel + width),
    ];
    let near_m = beside.into_iter().filter(|depth| *depth > 0.0).fold(f32::INFINITY, f32::min);
    if !(here_m > 0.0 && here_m > near_m * (1.0 + EDGE_SHARE)) {
        here_m.max(0.0)
    } else if luck < flight.flying_share {
        // Uniform: how much of the pixel the near surface fills.
        near_m + (here_m - near_m) * (luck / flight.flying_share)
    } else if luck < flight.flying_share + flight.invalid_share {
        0.0
    } else {
        here_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::tests::{as_f64, flat_image, moments, stream};
    use crate::noise::{DepthNoise, add_depth_noise};

    fn spoil(mut image: DepthImage, flight: FlightNoise, scene: u64) -> DepthImage {
        add_depth_noise(&mut image, &DepthNoise::Flight(flight), &mut stream(scene));
        image
    }

    fn without_errors() -> FlightNoise {
        FlightNoise { std_at_1_m: 0.0, depth_step_m: 0.0, loss: Loss::NONE, ..FlightNoise::AZURE }
    }

    #[test]
    fn a_walls_error_grows_with_depth_squared() {
        for depth_m in [0.5, 1.0, 2.0] {
            let flight = FlightNoise { loss: Loss::NONE, depth_step_m: 0.0, ..FlightNoise::AZURE };
            let (mean_m, variance) = moments(&as_f64(&spoil(flat_image(160, 120, depth_m), flight, 3)));
            let (depth_m, expected_m) = (f64::from(depth_m), 0.001 * f64::from(depth_m).powi(2));
            assert!((mean_m - depth_m).abs() < 0.05 * expected_m, "{mean_m} m at {depth_m} m");
            assert!((variance.sqrt() / expected_m - 1.0).abs() < 0.03, "{} m at {depth_m} m", variance.sqrt());
        }
    }

    /// Edges along columns only. A share of n pixels is known to ½ / √n, here four times that.
    #[test]
    fn pixels_fly_between_both_sides_of_an_edge() {
        let (width, height) = (40, 4000);
        let mut image = flat_image(width, height, 1.0);
        for (pixel, depth) in image.depth_m.iter_mut().enumerate() {
            if (15..25).contains(&(pixel % width)) {
                *depth = 0.8;
            }
        }
        let flight = FlightNoise { view_rad: 1.5, ..without_errors() };
        let spoiled = spoil(image.clone(), flight, 7);
        let (mut flying, mut invalid, mut weights) = (0_u32, 0_u32, Vec::new());
        for (pixel, (before, after)) in image.depth_m.iter().zip(&spoiled.depth_m).enumerate() {
            if [14, 25].contains(&(pixel % width)) {
                invalid += u32::from(*after == 0.0);
                if *after > 0.0 && *after < 1.0 {
                    flying += 1;
                    weights.push(f64::from((after - 0.8) / 0.2));
                }
            } else {
                assert_eq!(before, after);
            }
        }
        let count = 2.0 * height as f64;
        assert!((f64::from(flying) / count - 0.5).abs() < 2.0 / count.sqrt(), "{flying} of {count}");
        assert!((f64::from(invalid) / count - 0.2).abs() < 2.0 / count.sqrt(), "{invalid} of {count}");
        let (mean, variance) = moments(&weights);
        assert!((mean - 0.5).abs() < 0.02 && (variance - 1.0 / 12.0).abs() < 0.005, "{mean}, {variance}");
    }

    /// tan 0.7 · 504 px is 424.5 px; an image of 640 × 576 px has its corners at 430.5 px.
    #[test]
    fn there_is_no_depth_beyond_the_view() {
        let spoiled = spoil(flat_image(640, 576, 1.0), without_errors(), 0);
        for (pixel, depth) in spoiled.depth_m.iter().enumerate() {
            let [x_px, y_px] = [(pixel % 640) as f64 - 319.5, (pixel / 640) as f64 - 287.5];
            let expected = if x_px.hypot(y_px) < 504.0 * 0.7_f64.tan() { 1.0 } else { 0.0 };
            assert_eq!(f64::from(*depth), expected, "at {x_px}, {y_px}");
        }
        assert!(spoiled.depth_m[0] == 0.0 && spoiled.depth_m[320] > 0.0);
    }

    #[test]
    fn depth_comes_in_steps() {
        let spoiled = spoil(flat_image(64, 48, 1.3), FlightNoise::AZURE, 2);
        for depth in spoiled.depth_m {
            assert!((depth * 1e3 - (depth * 1e3).round()).abs() < 1e-3, "{depth} m");
        }
    }
}
