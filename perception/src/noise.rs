//! A depth sensor's faults, drawn from a [`Stream`] onto a whole image.
//!
//! The models act on every pixel with the same count of draws whatever the image shows, so the noise of a scene does not
//! shift when an object moves. A pixel in which nothing was seen stays so; one that noise pushes to 0 or below becomes
//! one in which nothing was seen.

use schema::{DepthImage, Stream};

/// How depth images are spoiled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DepthNoise {
    /// Not at all.
    None,
    /// Independent N(0, std²) in every pixel (GIGA: `apply_gaussian_noise`, 0.005 m).
    Gaussian {
        /// Standard deviation, in metres.
        std_m: f32,
    },
    /// One gamma-distributed factor for the image and, now and then, smooth additive noise.
    Dex(DexNoise),
}

/// Dex-Net's noise with a structured-light camera in mind (Mahler et al. 2017, equation of section IV-C: ŷ = αy + ε),
/// as GIGA's `apply_dex_noise` draws it.
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

impl DepthNoise {
    /// What is wrong with the values, one line each, as `field must …, got …`; empty if nothing is.
    #[must_use]
    pub fn problems(&self) -> Vec<String> {
        let limits = match self {
            Self::None => Vec::new(),
            Self::Gaussian { std_m } => vec![("std_m", *std_m, 0.0, 1.0)],
            Self::Dex(dex) => vec![
                ("gamma_shape", dex.gamma_shape, 1.0, 1e9),
                ("gamma_scale", dex.gamma_scale, 1e-9, 1.0),
                ("smooth_std_m", dex.smooth_std_m, 0.0, 1.0),
                ("smooth_cell_px", dex.smooth_cell_px, 1.0, 1e4),
                ("smooth_rate", dex.smooth_rate, 0.0, 1.0),
            ],
        };
        limits
            .into_iter()
            .filter(|(_, value, low, high)| !(low..=high).contains(&value))
            .map(|(name, value, low, high)| format!("{name} must be between {low} and {high}, got {value}"))
            .collect()
    }
}

/// Spoils a depth image in place.
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
    }
}

fn add_dex_noise(image: &mut DepthImage, dex: &DexNoise, stream: &mut Stream) {
    let factor = gamma(dex.gamma_shape, dex.gamma_scale, stream);
    let smooth = stream.unit() < f64::from(dex.smooth_rate);
    let lattice = smooth.then(|| Lattice::draw(image, dex, stream));
    for v in 0..image.height_px {
        for u in 0..image.width_px {
            let error_m = lattice.as_ref().map_or(0.0, |lattice| lattice.at(u, v));
            let depth = &mut image.depth_m[v * image.width_px + u];
            *depth = spoiled(*depth, factor, error_m);
        }
    }
}

/// A depth with its errors; 0, "nothing seen", stays 0, and nothing is seen at or behind the lens.
fn spoiled(depth_m: f32, factor: f32, error_m: f32) -> f32 {
    if depth_m > 0.0 { (depth_m * factor + error_m).max(0.0) } else { 0.0 }
}

/// Gamma(shape, scale) for shape ≥ 1, by the squeeze of Marsaglia & Tsang (2000). It accepts at least 95 % of its tries,
/// so it never sees the last of them; if it did, the mean would be returned.
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

/// Normal variates on a coarse lattice, read bilinearly. Beyond its edges it is 0, as in the image resizing that GIGA
/// calls (`skimage.transform.resize`, `order=1`, `mode="constant"`).
struct Lattice {
    columns: usize,
    rows: usize,
    columns_per_px: f32,
    rows_per_px: f32,
    values_m: Vec<f32>,
}

impl Lattice {
    fn draw(image: &DepthImage, dex: &DexNoise, stream: &mut Stream) -> Self {
        let columns = (image.width_px as f32 / dex.smooth_cell_px) as usize;
        let rows = (image.height_px as f32 / dex.smooth_cell_px) as usize;
        Self {
            columns,
            rows,
            columns_per_px: columns as f32 / image.width_px as f32,
            rows_per_px: rows as f32 / image.height_px as f32,
            values_m: (0..columns * rows).map(|_| stream.normal(0.0, dex.smooth_std_m)).collect(),
        }
    }

    /// Error at a pixel, in metres.
    fn at(&self, u: usize, v: usize) -> f32 {
        let x = (u as f32 + 0.5) * self.columns_per_px - 0.5;
        let y = (v as f32 + 0.5) * self.rows_per_px - 0.5;
        let (left, top) = (x.floor(), y.floor());
        let (right_share, bottom_share) = (x - left, y - top);
        let row = |y: f32| self.point(left, y) * (1.0 - right_share) + self.point(left + 1.0, y) * right_share;
        row(top) * (1.0 - bottom_share) + row(top + 1.0) * bottom_share
    }

    fn point(&self, x: f32, y: f32) -> f32 {
        let inside = x >= 0.0 && y >= 0.0 && x < self.columns as f32 && y < self.rows as f32;
        if inside { self.values_m[y as usize * self.columns + x as usize] } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use schema::Purpose;

    use super::*;

    fn stream(scene: u64) -> Stream {
        Stream::new(3, scene, Purpose::DepthNoise, 0)
    }

    fn flat_image(width_px: usize, height_px: usize, depth_m: f32) -> DepthImage {
        DepthImage { width_px, height_px, depth_m: vec![depth_m; width_px * height_px] }
    }

    fn moments(values: &[f64]) -> (f64, f64) {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64)
    }

    fn as_f64(image: &DepthImage) -> Vec<f64> {
        image.depth_m.iter().map(|d| f64::from(*d)).collect()
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
        for noise in [DepthNoise::Gaussian { std_m: 0.01 }, DepthNoise::Dex(DexNoise::GIGA)] {
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

    /// A pixel lies ⅛, ⅜, ⅝ or ⅞ of a cell past a lattice point along each axis, so its noise is a sum of lattice values
    /// with known shares s and 1 − s, and its variance s² + (1 − s)² of theirs along each axis.
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

    #[test]
    fn values_that_cannot_be_are_named() {
        assert_eq!(DepthNoise::Dex(DexNoise::GIGA).problems(), Vec::<String>::new());
        assert_eq!(DepthNoise::Gaussian { std_m: -1.0 }.problems(), ["std_m must be between 0 and 1, got -1"]);
        let dex = DexNoise { gamma_shape: 0.5, smooth_cell_px: f32::NAN, ..DexNoise::GIGA };
        assert_eq!(DepthNoise::Dex(dex).problems().len(), 2);
    }
}
