//! Dex-Net's depth noise: one factor for the whole image and, in some images, smooth additive noise.

use schema::{DepthImage, Stream};

use super::lattice::Lattice;

/// Dex-Net's noise model of a structured-light camera (Mahler et al. 2017, equation of section IV-C: ŷ = αy + ε), as
/// GIGA's `apply_dex_noise` draws it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DexNoise {
    /// Shape of the factor's gamma distribution; at least 1.
    pub gamma_shape: f32,
    /// Its scale; the factor's mean is shape · scale.
    pub gamma_scale: f32,
    /// Standard deviation of the smooth noise at its lattice points, in metres.
    pub smooth_std_m: f32,
    /// Distance between lattice points, in pixels; the noise is bilinear between them.
    pub smooth_cell_px: f32,
    /// Share of the images that get smooth noise.
    pub smooth_rate: f32,
}

impl DexNoise {
    /// GIGA's values: factor Gamma(1000, 0.001), smooth noise of 5 mm on a lattice of 4 pixels in half of the images.
    pub const GIGA: Self =
        Self { gamma_shape: 1000.0, gamma_scale: 0.001, smooth_std_m: 0.005, smooth_cell_px: 4.0, smooth_rate: 0.5 };
}

pub(super) fn add_dex_noise(image: &mut DepthImage, dex: &DexNoise, stream: &mut Stream) {
    let factor = gamma(dex.gamma_shape, dex.gamma_scale, stream);
    let smooth = stream.unit() < f64::from(dex.smooth_rate);
    let points = |pixels: usize| (pixels as f32 / dex.smooth_cell_px) as usize;
    let counts = [points(image.width_px), points(image.height_px)];
    let lattice = smooth.then(|| Lattice::draw(image, counts, dex.smooth_std_m, stream));
    for v in 0..image.height_px {
        for u in 0..image.width_px {
            let error_m = lattice.as_ref().map_or(0.0, |lattice| lattice.at(u, v));
            let depth = &mut image.depth_m[v * image.width_px + u];
            *depth = spoiled(*depth, factor, error_m);
        }
    }
}

/// Gamma(shape, scale) for shape ≥ 1, by the squeeze of Marsaglia & Tsang (2000). It accepts at least 95 % of its
/// tries, so the limit is practically never reached; then the mean would be returned.
fn gamma(shape: f32, scale: f32, stream: &mut Stream) -> f32 {
    const TRIES_MAX: usize = 64;
    let d = f64::from(shape) - 1.0 / 3.0;
    let c = 1.0 / (9.0 * d).sqrt();
    for _ in 0..TRIES_MAX {
        let x = f64::from(stream.normal(0.0, 1.0));
        let u = stream.unit();
        let v = (1.0 + c * x) * (1.0 + c * x) * (1.0 + c * x);
        if v > 0.0 && libm::log(1.0 - u) < 0.5 * x * x + d - d * v + d * libm::log(v) {
            return (d * v * f64::from(scale)) as f32;
        }
    }
    shape * scale
}

/// A depth with noise; 0, "nothing seen", stays 0, and depths at or behind the lens become 0.
pub(super) fn spoiled(depth_m: f32, factor: f32, error_m: f32) -> f32 {
    if depth_m > 0.0 { (depth_m * factor + error_m).max(0.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::tests::{as_f64, flat_image, moments, stream};
    use crate::noise::{DepthNoise, add_depth_noise};

    #[test]
    fn the_gamma_factor_has_its_moments() {
        for (shape, scale) in [(1000.0, 0.001), (1.0, 2.0), (7.5, 0.3)] {
            let mut stream = stream(9);
            let values: Vec<f64> = (0..40_000).map(|_| f64::from(gamma(shape, scale, &mut stream))).collect();
            let (mean, variance) = moments(&values);
            let (shape, scale) = (f64::from(shape), f64::from(scale));
            assert!((mean / (shape * scale) - 1.0).abs() < 0.02, "mean {mean} of {shape}, {scale}");
            assert!((variance / (shape * scale * scale) - 1.0).abs() < 0.05, "variance {variance} of {shape}, {scale}");
        }
    }

    #[test]
    fn without_smooth_noise_dex_scales_the_whole_image() {
        let dex = DepthNoise::Dex(DexNoise { smooth_rate: 0.0, ..DexNoise::GIGA });
        let mut image = flat_image(32, 24, 0.5);
        add_depth_noise(&mut image, &dex, &mut stream(2));
        assert!(image.depth_m.iter().all(|d| *d == image.depth_m[0]));
        assert!(image.depth_m[0] != 0.5 && (image.depth_m[0] - 0.5).abs() < 0.08);
    }

    #[test]
    fn dex_is_smooth_in_its_share_of_the_images() {
        let images = 400;
        let smooth = (0..images)
            .filter(|scene| {
                let mut image = flat_image(16, 12, 0.5);
                add_depth_noise(&mut image, &DepthNoise::Dex(DexNoise::GIGA), &mut stream(*scene));
                image.depth_m.iter().any(|d| *d != image.depth_m[0])
            })
            .count();
        assert!((170..230).contains(&smooth), "{smooth} of {images}");
    }

    /// A pixel lies ⅛, ⅜, ⅝ or ⅞ of a cell past a lattice point along each axis, so its noise is a sum of lattice
    /// values with known weights s and 1 − s, and its variance is s² + (1 − s)² of theirs along each axis.
    #[test]
    fn smooth_noise_has_the_moments_of_bilinear_interpolation() {
        let dex = DepthNoise::Dex(DexNoise { gamma_scale: 1e-9, gamma_shape: 1e9, smooth_rate: 1.0, ..DexNoise::GIGA });
        let mut image = flat_image(640, 480, 0.6);
        add_depth_noise(&mut image, &dex, &mut stream(6));
        let inner: Vec<f64> = as_f64(&image)
            .into_iter()
            .enumerate()
            .filter(|(p, _)| (4..636).contains(&(p % 640)) && (4..476).contains(&(p / 640)))
            .map(|(_, d)| d - 0.6)
            .collect();
        let (mean, variance) = moments(&inner);
        let along = |share: f64| share * share + (1.0 - share) * (1.0 - share);
        let per_axis = [0.125, 0.375, 0.625, 0.875].map(along).iter().sum::<f64>() / 4.0;
        let expected = 0.005 * per_axis;
        assert!(mean.abs() < 2e-4, "mean {mean}");
        assert!((variance.sqrt() / expected - 1.0).abs() < 0.02, "std {} against {expected}", variance.sqrt());
        let steps = inner.windows(2).map(|w| (w[1] - w[0]).abs()).sum::<f64>() / inner.len() as f64;
        assert!(steps < 0.5 * variance.sqrt(), "neighbours differ by {steps} of {}", variance.sqrt());
    }
}
