//! Depth images as people see shapes: lit, and warmer where near.

use rayon::prelude::*;
use schema::{DepthImage, Intrinsics, Vec3};

use super::layer::{Rgb, lit, mixed};
use super::overlay::Image;

/// Where nothing was seen.
const UNSEEN: Rgb = [26, 28, 34];
const FAR: Rgb = [150, 182, 226];
const NEAR: Rgb = [255, 236, 208];
const OUTLINE: Rgb = [20; 3];
/// A surface's slope is that of a plane through so many pixels on each side, for an image of [`STEPS_ACROSS`].
const REACH: isize = 3;
const STEPS_ACROSS: usize = 320;
/// Pixels whose depth differs by this share or more are not of the same surface.
const SAME_SURFACE: f32 = 0.02;
/// A pixel before another that is farther by this share has an outline.
const STEP: f32 = 0.03;
/// From the scene to the lamp beside the camera, above it and at its left.
const TOWARDS_LAMP: Vec3 = Vec3::new(-0.45, -0.75, -0.48);

impl Image {
    /// A depth image through a lens of its size as a lit relief, warm where near and cool where far. What was not seen
    /// is dark.
    #[must_use]
    pub fn shaded(depth: &DepthImage, lens: &Intrinsics) -> Self {
        let (width_px, height_px) = (depth.width_px, depth.height_px);
        let ends = ends(depth);
        let stride = (width_px / STEPS_ACROSS).max(1);
        let pixels = (0..width_px * height_px)
            .into_par_iter()
            .map(|at| Relief { depth, lens, stride, ends }.colour([at % width_px, at / width_px]))
            .collect();
        Self { width_px, height_px, pixels }
    }
}

/// The inverse depths that are drawn as far and as near: all but the outermost hundredths.
fn ends(depth: &DepthImage) -> [f32; 2] {
    let mut seen: Vec<f32> =
        depth.depth_m.iter().filter(|depth_m| **depth_m > 0.0).map(|depth_m| 1.0 / depth_m).collect();
    seen.sort_unstable_by(f32::total_cmp);
    [1, 99].map(|hundredths| seen.get(seen.len() * hundredths / 100).copied().unwrap_or_default())
}

#[derive(Clone, Copy)]
struct Relief<'a> {
    depth: &'a DepthImage,
    lens: &'a Intrinsics,
    /// Pixels between two that are looked at.
    stride: usize,
    ends: [f32; 2],
}

impl Relief<'_> {
    fn colour(&self, pixel: [usize; 2]) -> Rgb {
        let Some(depth_m) = self.depth.at(pixel) else { return UNSEEN };
        let [far, near] = self.ends;
        let nearness = ((1.0 / depth_m - far) / (near - far).max(1e-6)).clamp(0.0, 1.0);
        let ray = self.lens.ray(pixel).normalize_or_zero();
        // Half of the light comes from the camera, so nothing is black, and half from the lamp, so edges differ.
        let light = self
            .normal(pixel, depth_m)
            .map_or(1.0, |normal| 0.12 + 0.55 * normal.dot(-ray).max(0.0) + 0.45 * normal.dot(TOWARDS_LAMP).max(0.0));
        let colour = lit(mixed(FAR, NEAR, nearness), light);
        let sides = [[-1, 0], [1, 0], [0, -1], [0, 1]];
        let stands_before = sides.iter().any(|side| self.beside(pixel, *side) > depth_m * (1.0 + STEP));
        if stands_before { mixed(colour, OUTLINE, 0.5) } else { colour }
    }

    /// The depth so many strides away, or 0.
    fn beside(&self, pixel: [usize; 2], [across, down]: [isize; 2]) -> f32 {
        let moved = |at: usize, steps: isize| at.checked_add_signed(steps * self.stride as isize);
        let (Some(u), Some(v)) = (moved(pixel[0], across), moved(pixel[1], down)) else { return 0.0 };
        let is_inside = u < self.depth.width_px && v < self.depth.height_px;
        if is_inside { self.depth.depth_m[v * self.depth.width_px + u] } else { 0.0 }
    }

    /// The surface's direction towards the camera. Of a plane the inverse depth is linear in the pixel, so a linear fit
    /// to it is true however steep the plane is.
    fn normal(&self, pixel: [usize; 2], depth_m: f32) -> Option<Vec3> {
        // Weighted sums of 1, u, v, u², uv, v²; and of the inverse depth over the centre's, less 1, times 1, u and v.
        let mut sums = [0.0_f32; 9];
        for (across, down) in (-REACH..=REACH).flat_map(|down| (-REACH..=REACH).map(move |across| (across, down))) {
            let beside_m = self.beside(pixel, [across, down]);
            let off = depth_m / beside_m - 1.0;
            let left = 1.0 - (off / SAME_SURFACE) * (off / SAME_SURFACE);
            if beside_m > 0.0 && left > 0.0 {
                let (u, v) = (across as f32, down as f32);
                let values = [1.0, u, v, u * u, u * v, v * v, off, u * off, v * off];
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += left * left * value);
            }
        }
        let [weight, u, v, uu, uv, vv, off, u_off, v_off] = sums;
        let about_means = |product: f32, a: f32, b: f32| product - a * b / weight;
        let (uu, uv, vv) = (about_means(uu, u, u), about_means(uv, u, v), about_means(vv, v, v));
        let (u_off, v_off) = (about_means(u_off, u, off), about_means(v_off, v, off));
        let determinant = uu * vv - uv * uv;
        let (along_u, along_v) = ((u_off * vv - v_off * uv) / determinant, (v_off * uu - u_off * uv) / determinant);
        let here = 1.0 + (off - along_u * u - along_v * v) / weight;
        let [per_u, per_v] = [along_u, along_v].map(|slope| slope / self.stride as f32);
        let from_centre = [pixel[0] as f32 - self.lens.cx_px, pixel[1] as f32 - self.lens.cy_px];
        let ahead = here - per_u * from_centre[0] - per_v * from_centre[1];
        let away = Vec3::new(per_u * self.lens.fx_px, per_v * self.lens.fy_px, ahead);
        (determinant > 1.0).then(|| -away).and_then(Vec3::try_normalize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENS: Intrinsics =
        Intrinsics { width_px: 64, height_px: 48, fx_px: 300.0, fy_px: 250.0, cx_px: 40.0, cy_px: 23.5 };

    fn plane(normal: Vec3, offset_m: f32) -> DepthImage {
        let pixels = (0..48).flat_map(|v| (0..64).map(move |u| [u, v]));
        let depth_m = pixels.map(|pixel| offset_m / normal.dot(LENS.ray(pixel))).collect();
        DepthImage { width_px: 64, height_px: 48, depth_m }
    }

    #[test]
    fn a_plane_s_direction_is_found_however_steep_it_is_and_wherever_it_is_seen() {
        for normal in [Vec3::Z, Vec3::new(0.3, -0.2, 0.9), Vec3::new(-0.1, 0.8, 0.6), Vec3::new(0.75, 0.1, 0.65)] {
            let normal = normal.normalize();
            let depth = plane(normal, 0.5);
            for stride in [1, 2] {
                let relief = Relief { depth: &depth, lens: &LENS, stride, ends: [0.0, 1.0] };
                for pixel in [[0, 0], [63, 10], [20, 30], [40, 47]] {
                    let found = relief.normal(pixel, depth.at(pixel).unwrap()).unwrap();
                    assert!((found + normal).length() < 2e-3, "{normal} {stride} {pixel:?}: {found}");
                }
            }
        }
    }

    #[test]
    fn near_is_warm_far_is_cool_unseen_is_dark_and_steps_have_outlines() {
        let mut depth = plane(Vec3::Z, 1.0);
        for (at, depth_m) in depth.depth_m.iter_mut().enumerate() {
            match at % 64 {
                0..20 => *depth_m = 0.6,
                50.. => *depth_m = 0.0,
                _ => {}
            }
        }
        let image = Image::shaded(&depth, &LENS);
        let [near, edge, far, unseen] = [10, 19, 35, 55].map(|u| image.pixels[24 * 64 + u]);
        assert!(near[0] > near[2] && far[0] < far[2], "{near:?} {far:?}");
        assert!(edge[0] < near[0] - 40, "{edge:?} {near:?}");
        assert_eq!(unseen, UNSEEN);
        let nothing = DepthImage { depth_m: vec![0.0; 64 * 48], ..depth };
        assert!(Image::shaded(&nothing, &LENS).pixels.iter().all(|pixel| *pixel == UNSEEN));
    }
}
