//! What matching does beside edges of depth: the nearer surface grows over its outline, and holes are wider or narrower
//! than what is hidden.

use schema::{DepthImage, Stream};

use super::lattice::Lattice;

/// The effect of a matching window that lies half on a near surface and half on a far one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeNoise {
    /// How far a near surface covers what is beside it along u, and along v, in pixels.
    pub fattening_px: [f32; 2],
    /// How far a far surface has no depth beside what is hidden, in pixels. Negative: how far it covers what is hidden.
    pub hole_px: f32,
    /// Standard deviation of both along an edge, in pixels.
    pub ragged_px: f32,
}

/// Pixels whose disparities differ by less than this many pixels are on one surface.
const ONE_SURFACE_PX: f32 = 1.0;

/// How far the outline of an edge is seen to wander before it turns.
const RAGGED_CELL_PX: f32 = 4.0;

impl EdgeNoise {
    /// Edges are where they are.
    pub const NONE: Self = Self { fattening_px: [0.0; 2], hole_px: 0.0, ragged_px: 0.0 };

    /// Those of another lens: as wide in angle.
    #[must_use]
    pub fn scaled(self, scale: f32) -> Self {
        let Self { fattening_px, hole_px, ragged_px } = self;
        Self {
            fattening_px: fattening_px.map(|reach_px| reach_px * scale),
            hole_px: hole_px * scale,
            ragged_px: ragged_px * scale,
        }
    }
}

/// Changes the disparities that were `seen`, of which 0 means no depth; `real` are those of the scene.
pub(super) fn move_edges(image: &DepthImage, edges: &EdgeNoise, real: &[f32], seen: &mut [f32], stream: &mut Stream) {
    if *edges == EdgeNoise::NONE {
        return;
    }
    let ragged_px = Lattice::of_cells(image, [RAGGED_CELL_PX; 2], edges.ragged_px, stream).even();
    let walk = Walk { width: image.width_px, height: image.height_px, edges, ragged_px, real };
    let visible = seen.to_vec();
    for side in SIDES {
        walk.hide_or_fill(&visible, side, seen);
    }
    for side in SIDES {
        walk.widen(&visible, side, seen);
    }
}

/// The four neighbours of a pixel, as steps along u and v.
const SIDES: [[isize; 2]; 4] = [[1, 0], [-1, 0], [0, 1], [0, -1]];

struct Walk<'a> {
    width: usize,
    height: usize,
    edges: &'a EdgeNoise,
    ragged_px: Vec<f32>,
    real: &'a [f32],
}

impl Walk<'_> {
    /// Where a far surface ends to be visible: its last pixels lose their depth, or those beyond get it.
    fn hide_or_fill(&self, visible: &[f32], side: [isize; 2], seen: &mut [f32]) {
        let reach = self.edges.hole_px;
        for (hidden, far) in self.pairs(side) {
            let is_end = visible[hidden] <= 0.0 && self.real[hidden] > 0.0 && visible[far] > 0.0;
            if !is_end || self.real[far] > self.real[hidden] + ONE_SURFACE_PX {
                continue;
            }
            let (start, step) = if reach > 0.0 { (far, side) } else { (hidden, side.map(isize::wrapping_neg)) };
            for (distance, pixel) in (1..).zip(self.from(start, step)) {
                let is_hole = visible[pixel] <= 0.0;
                if is_hole == (reach > 0.0) || distance as f32 > reach.abs() + 0.5 + self.ragged_px[pixel] {
                    break;
                }
                seen[pixel] = if reach > 0.0 { 0.0 } else { self.real[pixel] };
            }
        }
    }

    /// Where a near surface ends: it covers the first pixels beside it.
    fn widen(&self, visible: &[f32], side: [isize; 2], seen: &mut [f32]) {
        let reach_px = self.edges.fattening_px[usize::from(side[0] == 0)];
        for (near, far) in self.pairs(side) {
            for (distance, pixel) in (1..).zip(self.from(far, side)) {
                let is_far = self.real[pixel] > 0.0 && visible[near] > self.real[pixel] + ONE_SURFACE_PX;
                if !is_far || distance as f32 > reach_px + 0.5 + self.ragged_px[pixel] {
                    break;
                }
                seen[pixel] = seen[pixel].max(visible[near]);
            }
        }
    }

    /// Every pixel with its neighbour on a side.
    fn pairs(&self, side: [isize; 2]) -> impl Iterator<Item = (usize, usize)> {
        let within = |step: isize, size: usize| usize::from(step < 0)..size.saturating_sub(usize::from(step > 0));
        let (columns, step) = (within(side[0], self.width), side[1] * self.width.cast_signed() + side[0]);
        let rows = within(side[1], self.height).map(|v| v * self.width);
        let pixels = rows.flat_map(move |row| columns.clone().map(move |u| row + u));
        pixels.map(move |pixel| (pixel, pixel.wrapping_add_signed(step)))
    }

    /// The pixels from one on, along steps, to the end of the image.
    fn from(&self, pixel: usize, step: [isize; 2]) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(pixel), move |pixel| self.neighbour(*pixel, step))
    }

    fn neighbour(&self, pixel: usize, [along, down]: [isize; 2]) -> Option<usize> {
        let u = (pixel % self.width).checked_add_signed(along)?;
        let v = (pixel / self.width).checked_add_signed(down)?;
        (u < self.width && v < self.height).then(|| v * self.width + u)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::tests::{flat_image, stream};

    /// A row: far, hidden, near, far.
    fn row(edges: EdgeNoise) -> Vec<f32> {
        let image = flat_image(24, 1, 1.0);
        let real: Vec<f32> = (0..24).map(|u| if (12..16).contains(&u) { 30.0 } else { 20.0 }).collect();
        let mut seen = real.clone();
        seen[6..12].fill(0.0);
        move_edges(&image, &edges, &real, &mut seen, &mut stream(0));
        seen
    }

    fn expected(parts: &[(usize, f32)]) -> Vec<f32> {
        parts.iter().flat_map(|(count, disparity)| std::iter::repeat_n(*disparity, *count)).collect()
    }

    #[test]
    fn a_near_surface_grows_over_what_is_beside_and_hidden() {
        let fat = row(EdgeNoise { fattening_px: [2.0; 2], ..EdgeNoise::NONE });
        assert_eq!(fat, expected(&[(6, 20.0), (4, 0.0), (8, 30.0), (6, 20.0)]));
    }

    #[test]
    fn holes_are_wider_or_filled_from_their_far_side() {
        let wide = row(EdgeNoise { fattening_px: [1.0; 2], hole_px: 2.0, ragged_px: 0.0 });
        assert_eq!(wide, expected(&[(4, 20.0), (7, 0.0), (6, 30.0), (7, 20.0)]));
        let filled = row(EdgeNoise { hole_px: -4.0, ..EdgeNoise::NONE });
        assert_eq!(filled, expected(&[(10, 20.0), (2, 0.0), (4, 30.0), (8, 20.0)]));
        let closed = row(EdgeNoise { hole_px: -9.0, ..EdgeNoise::NONE });
        assert_eq!(closed, expected(&[(12, 20.0), (4, 30.0), (8, 20.0)]));
    }

    /// A disparity that changes by less than a pixel from pixel to pixel is a slanted surface without an edge.
    #[test]
    fn a_slanted_surface_has_no_edges() {
        let real: Vec<f32> = (0..24).map(|u| 20.0 + 0.8 * u as f32).collect();
        let mut seen = real.clone();
        let edges = EdgeNoise { fattening_px: [3.0; 2], hole_px: 2.0, ragged_px: 1.0 };
        move_edges(&flat_image(24, 1, 1.0), &edges, &real, &mut seen, &mut stream(0));
        assert_eq!(seen, real);
    }

    #[test]
    fn outlines_wander_by_their_deviation() {
        let (width, height) = (40, 2000);
        let image = flat_image(width, height, 1.0);
        let real: Vec<f32> = (0..width * height).map(|pixel| if pixel % width < 20 { 30.0 } else { 20.0 }).collect();
        let mut seen = real.clone();
        let edges = EdgeNoise { fattening_px: [5.0, 0.0], hole_px: 0.0, ragged_px: 1.5 };
        move_edges(&image, &edges, &real, &mut seen, &mut stream(2));
        let reach = |row: &[f32]| row.iter().filter(|disparity| **disparity == 30.0).count() as f64 - 20.0;
        let reached: Vec<f64> = seen.chunks_exact(width).map(reach).collect();
        let mean = reached.iter().sum::<f64>() / reached.len() as f64;
        let std = (reached.iter().map(|px| (px - mean).powi(2)).sum::<f64>() / reached.len() as f64).sqrt();
        // 500 lattice rows; rounding adds 1/12 to the variance, and a walk ends at the first pixel that is too far.
        assert!((mean - 5.0).abs() < 0.5, "{mean}");
        assert!((1.1..1.8).contains(&std), "{std}");
    }
}
