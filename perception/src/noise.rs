//! Depth-sensor noise, drawn from a [`Stream`] for a whole image.
//!
//! The number of draws per pixel does not depend on the image, so the noise of a scene does not shift when an object
//! moves. A pixel without depth stays without depth; a pixel that noise pushes to 0 or below loses its depth.

mod dex;
mod edges;
mod lattice;
mod loss;
mod presets;
mod stereo;

use schema::{DepthImage, Stream};

pub use self::dex::DexNoise;
use self::dex::{add_dex_noise, spoiled};
pub use self::edges::EdgeNoise;
pub use self::loss::Loss;
pub use self::stereo::StereoNoise;
use self::stereo::add_stereo_noise;

/// The noise of depth images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DepthNoise {
    /// No noise.
    None,
    /// Independent N(0, std²) in every pixel (GIGA: `apply_gaussian_noise`, 0.005 m).
    Gaussian {
        /// Standard deviation, in metres.
        std_m: f32,
    },
    /// One gamma-distributed factor for the image and, in some images, smooth additive noise.
    Dex(DexNoise),
    /// Errors in disparity, so that depth errors grow with depth squared, and holes where only one of two imagers sees.
    Stereo(StereoNoise),
}

/// Adds noise to a depth image in place.
pub fn add_depth_noise(image: &mut DepthImage, noise: &DepthNoise, stream: &mut Stream) {
    match noise {
        DepthNoise::None => {}
        DepthNoise::Gaussian { std_m } => {
            for depth in &mut image.depth_m {
                let error_m = stream.normal(0.0, *std_m);
                *depth = spoiled(*depth, 1.0, error_m);
            }
        }
        DepthNoise::Dex(dex) => add_dex_noise(image, dex, stream),
        DepthNoise::Stereo(stereo) => add_stereo_noise(image, stereo, stream),
    }
}

#[cfg(test)]
mod tests {
    use schema::Purpose;

    use super::*;

    pub(super) fn stream(scene: u64) -> Stream {
        Stream::new(3, scene, Purpose::DepthNoise, 0)
    }

    pub(super) fn flat_image(width_px: usize, height_px: usize, depth_m: f32) -> DepthImage {
        DepthImage { width_px, height_px, depth_m: vec![depth_m; width_px * height_px] }
    }

    pub(super) fn moments(values: &[f64]) -> (f64, f64) {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64)
    }

    pub(super) fn as_f64(image: &DepthImage) -> Vec<f64> {
        image.depth_m.iter().map(|d| f64::from(*d)).collect()
    }

    pub(super) const SENSORS: [DepthNoise; 3] = [
        DepthNoise::Stereo(StereoNoise::D435),
        DepthNoise::Stereo(StereoNoise::D435_REAL),
        DepthNoise::Stereo(StereoNoise::KINECT),
    ];

    /// What is nowhere stays nowhere, and a scene of steps and holes takes as many draws as a wall.
    #[test]
    fn what_an_image_shows_does_not_change_the_draws_of_a_sensor() {
        for noise in SENSORS {
            let (mut wall, mut steps) = (flat_image(256, 16, 0.9), flat_image(256, 16, 0.9));
            for (pixel, depth) in steps.depth_m.iter_mut().enumerate() {
                *depth = [0.9, 0.5, 0.0, 0.7][pixel % 256 / 64];
            }
            let (mut of_wall, mut of_steps) = (stream(4), stream(4));
            add_depth_noise(&mut wall, &noise, &mut of_wall);
            add_depth_noise(&mut steps, &noise, &mut of_steps);
            assert_eq!(of_wall.bits(), of_steps.bits(), "{noise:?}");
            for (pixel, depth) in steps.depth_m.iter().enumerate() {
                assert!(*depth >= 0.0 && (pixel % 256 / 64 != 2 || *depth == 0.0), "{depth} m at {pixel}: {noise:?}");
            }
            assert!(steps.depth_m.iter().filter(|depth| **depth > 0.0).count() > 256 * 16 / 4, "{noise:?}");
        }
    }

    #[test]
    fn none_leaves_every_bit() {
        let mut image = flat_image(8, 6, 0.7);
        add_depth_noise(&mut image, &DepthNoise::None, &mut stream(0));
        assert_eq!(image, flat_image(8, 6, 0.7));
    }

    #[test]
    fn gaussian_has_its_moments_and_no_correlation() {
        let mut image = flat_image(320, 240, 0.6);
        add_depth_noise(&mut image, &DepthNoise::Gaussian { std_m: 0.005 }, &mut stream(0));
        let values = as_f64(&image);
        let (mean, variance) = moments(&values);
        assert!((mean - 0.6).abs() < 6e-5, "mean {mean}");
        assert!((variance.sqrt() / 0.005 - 1.0).abs() < 0.01, "std {}", variance.sqrt());
        let neighbours = values.windows(2).map(|w| (w[0] - mean) * (w[1] - mean)).sum::<f64>() / values.len() as f64;
        assert!((neighbours / variance).abs() < 0.02, "correlation {}", neighbours / variance);
    }

    #[test]
    fn the_same_stream_gives_the_same_image_and_another_does_not() {
        let models = [DepthNoise::Gaussian { std_m: 0.01 }, DepthNoise::Dex(DexNoise::GIGA)];
        for noise in models.into_iter().chain(SENSORS) {
            let spoil = |scene| {
                let mut image = flat_image(64, 48, 0.5);
                add_depth_noise(&mut image, &noise, &mut stream(scene));
                image
            };
            assert_eq!(spoil(1), spoil(1));
            assert_ne!(spoil(1), spoil(2));
        }
    }

    #[test]
    fn nothing_seen_stays_nothing_seen_and_costs_the_same_draws() {
        for noise in
            [DepthNoise::Gaussian { std_m: 0.3 }, DepthNoise::Dex(DexNoise { smooth_rate: 1.0, ..DexNoise::GIGA })]
        {
            let (mut full, mut holed) = (flat_image(64, 48, 0.2), flat_image(64, 48, 0.2));
            for depth in holed.depth_m.iter_mut().step_by(3) {
                *depth = 0.0;
            }
            let (mut of_full, mut of_holed) = (stream(4), stream(4));
            add_depth_noise(&mut full, &noise, &mut of_full);
            add_depth_noise(&mut holed, &noise, &mut of_holed);
            assert_eq!(of_full.bits(), of_holed.bits());
            for (pixel, (a, b)) in full.depth_m.iter().zip(&holed.depth_m).enumerate() {
                assert!(*a >= 0.0);
                assert_eq!(*b, if pixel % 3 == 0 { 0.0 } else { *a });
            }
        }
    }
}
