//! Holes within a surface: the more of them, the more it turns away, and more on dark or shiny things.

use schema::{DepthImage, Stream};

use super::lattice::Lattice;

/// Pixels that have no depth though nothing hides them.
///
/// A share of `share` · exp(`per_secant` · (1/cos θ − 1)) is lost, where θ is between ray and normal: 1/cos θ is how
/// much further apart the pattern lies on the surface than in the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Loss {
    /// Share that is lost where a surface is looked at straight, mean over materials.
    pub share: f32,
    /// How fast it grows with 1/cos θ.
    pub per_secant: f32,
    /// Distance between the lattice points that decide, in pixels: half the size of a hole.
    pub patch_px: f32,
}

/// How often a material is drawn for an image, and how much more it loses than the mean of 1.
///
/// Dull things and, less often, dark or shiny ones. Our choice: no capture has the same thing in two materials. The
/// fitted rates of sensors that saw different things are 10 times apart.
const MATERIALS: [(f32, f32); 2] = [(0.75, 0.4), (0.25, 2.8)];

impl Loss {
    /// Nothing is lost.
    pub const NONE: Self = Self { share: 0.0, per_secant: 0.0, patch_px: 1.0 };

    /// That of another lens.
    #[must_use]
    pub fn scaled(self, scale: f32) -> Self {
        Self { patch_px: (self.patch_px * scale).max(1.0), ..self }
    }

    /// Share of a surface that is lost where 1/cos θ is `secant`.
    #[must_use]
    pub fn share_at(&self, secant: f32) -> f32 {
        (self.share * libm::expf(self.per_secant * (secant - 1.0))).min(1.0)
    }

    /// 1/cos θ where a share is lost; 0 if it is lost everywhere, infinite if nowhere.
    fn secant_of(&self, share: f32) -> f32 {
        if self.share >= share { 0.0 } else { 1.0 + libm::logf(share / self.share) / self.per_secant }
    }
}

/// Sets values of an image to 0 where nothing was measured. `slopes` has for each pixel, as disparities have, a value
/// in which planes are linear: any multiple of 1/depth, or 0.
pub(super) fn lose(
    image: &DepthImage,
    loss: &Loss,
    focal_px: f32,
    slopes: &[f32],
    values: &mut [f32],
    stream: &mut Stream,
) {
    if *loss == Loss::NONE {
        return;
    }
    let material = stream.weighted(&MATERIALS, &MATERIALS.map(|(weight, _)| weight)).1;
    let luck = Lattice::of_cells(image, [loss.patch_px; 2], 1.0, stream).even();
    let loss = Loss { share: loss.share * material, ..*loss };
    let often = loss.secant_of(OFTEN).powi(2);
    for (pixel, luck) in luck.into_iter().enumerate() {
        let squared = secant_squared(image, focal_px, slopes, pixel);
        if (luck < OFTEN_BELOW || squared >= often) && below_normal(luck, loss.share_at(squared.sqrt())) {
            values[pixel] = 0.0;
        }
    }
}

/// This share of normal variates is below this value. Most pixels are above and lose less, and what follows is slow.
const OFTEN: f32 = 0.15;
const OFTEN_BELOW: f32 = -1.0;

/// Whether a standard normal variate is among the lowest share.
fn below_normal(value: f32, share: f32) -> bool {
    0.5 * libm::erfcf(-value * std::f32::consts::FRAC_1_SQRT_2) < share
}

/// 1/cos² of the angle between ray and normal; 0 where there is nothing.
///
/// Of the differences to both neighbours the smaller counts, for the other may lead over an edge. Values are
/// n · ray · c with the plane's normal n, so n follows from how they change, and cos = n · ray / (|n| |ray|).
fn secant_squared(image: &DepthImage, focal_px: f32, slopes: &[f32], pixel: usize) -> f32 {
    let (u, v) = (pixel % image.width_px, pixel / image.width_px);
    let here = slopes[pixel];
    if here <= 0.0 {
        return 0.0;
    }
    let change = |before: Option<usize>, after: Option<usize>| {
        let to = |other: Option<usize>| other.map(|other| slopes[other]).filter(|value| *value > 0.0);
        match (to(before).map(|value| here - value), to(after).map(|value| value - here)) {
            (Some(before), Some(after)) if before.abs() < after.abs() => before,
            (Some(change), None) | (_, Some(change)) => change,
            (None, None) => 0.0,
        }
    };
    let along = change((u > 0).then(|| pixel - 1), (u + 1 < image.width_px).then(|| pixel + 1));
    let below = (v + 1 < image.height_px).then(|| pixel + image.width_px);
    let down = change((v > 0).then(|| pixel - image.width_px), below);
    // The lens has its centre in the image's.
    let x_px = u as f32 + 0.5 - 0.5 * image.width_px as f32;
    let y_px = v as f32 + 0.5 - 0.5 * image.height_px as f32;
    let ray = (x_px * x_px + y_px * y_px) / (focal_px * focal_px) + 1.0;
    let forward = here - along * x_px - down * y_px;
    let normal = focal_px * focal_px * (along * along + down * down) + forward * forward;
    normal * ray / (here * here)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::tests::{flat_image, stream};

    const LOSS: Loss = Loss { share: 0.01, per_secant: 1.5, patch_px: 2.0 };

    /// 1/depth of a plane whose normal is turned by an angle about the image's y axis, 0.7 m in front of the lens.
    fn slanted(image: &DepthImage, focal_px: f32, angle_rad: f32) -> Vec<f32> {
        let (sin, cos) = (libm::sinf(angle_rad), libm::cosf(angle_rad));
        let at = |pixel: usize| {
            let x = ((pixel % image.width_px) as f32 + 0.5 - 0.5 * image.width_px as f32) / focal_px;
            (cos + sin * x) / (0.7 * cos)
        };
        (0..image.width_px * image.height_px).map(at).collect()
    }

    #[test]
    fn the_angle_is_that_of_the_plane_at_every_pixel() {
        let (image, focal_px) = (flat_image(41, 31, 1.0), 60.0);
        for degrees in [0.0_f32, 30.0, 60.0, 70.0] {
            let angle_rad = degrees.to_radians();
            let slopes = slanted(&image, focal_px, angle_rad);
            let normal = [libm::sinf(angle_rad), libm::cosf(angle_rad)];
            for pixel in (0..slopes.len()).filter(|pixel| slopes[*pixel] > 0.0) {
                let [x, y] = [(pixel % 41) as f32 - 20.0, (pixel / 41) as f32 - 15.0].map(|px| px / focal_px);
                let cos = (normal[0] * x + normal[1]) / (x * x + y * y + 1.0).sqrt();
                let found = secant_squared(&image, focal_px, &slopes, pixel).sqrt();
                assert!((found * cos - 1.0).abs() < 1e-3, "{found} for {cos} at {pixel}, {degrees}°");
            }
        }
    }

    #[test]
    fn an_edge_is_no_angle() {
        let image = flat_image(8, 1, 1.0);
        let slopes = [1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 0.0, 2.0];
        for pixel in (0..8).filter(|pixel| *pixel != 6) {
            let found = secant_squared(&image, 500.0, &slopes, pixel).sqrt();
            assert!((found - 1.0).abs() < 1e-3, "{found} at {pixel}");
        }
    }

    /// Shares follow the formula, over materials and images. A pixel's share is known to 20 % from 400 holes.
    #[test]
    fn the_share_that_is_lost_grows_with_the_angle() {
        let (image, focal_px, images) = (flat_image(160, 120, 1.0), 2000.0, 60);
        for degrees in [0.0_f32, 45.0, 60.0] {
            let slopes = slanted(&image, focal_px, degrees.to_radians());
            let mut lost = 0;
            for scene in 0..images {
                let mut values = slopes.clone();
                lose(&image, &LOSS, focal_px, &slopes, &mut values, &mut stream(scene));
                lost += values.iter().filter(|value| **value == 0.0).count();
            }
            let share = lost as f32 / (images as usize * slopes.len()) as f32;
            let expected = LOSS.share_at(1.0 / libm::cosf(degrees.to_radians()));
            assert!((share / expected - 1.0).abs() < 0.25, "{share} for {expected} at {degrees}°");
        }
    }

    #[test]
    fn holes_have_the_size_of_patches() {
        let image = flat_image(400, 300, 1.0);
        let runs = |patch_px: f32| {
            let loss = Loss { share: 0.05, patch_px, per_secant: 0.0 };
            let slopes = vec![1.0; 400 * 300];
            let mut values = slopes.clone();
            lose(&image, &loss, 500.0, &slopes, &mut values, &mut stream(4));
            let lost = values.iter().filter(|value| **value == 0.0).count();
            let starts = values.windows(2).filter(|pair| pair[0] > 0.0 && pair[1] == 0.0).count();
            lost as f32 / starts as f32
        };
        let (fine, coarse) = (runs(1.0), runs(6.0));
        assert!(fine < 1.5 && coarse > 3.0, "{fine} px and {coarse} px");
    }
}
