//! Pixels with depths: nearer content hides farther content.
//!
//! A layer that is merged into another remains faintly visible where it is behind, such as a finger under an overhang.

use std::ops::Range;

use crate::eye::Seen;

/// Every pixel is the mean of a square of this side.
pub(super) const MEAN_OF: usize = 2;

/// Red, green, blue.
pub(super) type Rgb = [u8; 3];

/// Opacity of drawn content where it is in front of the existing picture, and where it is behind.
#[derive(Debug, Clone, Copy)]
pub(super) struct Opacity {
    /// Opacity in front.
    pub(super) before: f32,
    /// Opacity behind.
    pub(super) behind: f32,
}

/// A picture with a depth at each pixel; infinite where it is empty.
#[derive(Debug, Clone)]
pub(super) struct Layer {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) colour: Vec<Rgb>,
    pub(super) depth_m: Vec<f32>,
    /// The range of drawn columns and rows.
    drawn: [Range<usize>; 2],
}

impl Layer {
    /// A white sheet.
    pub(super) fn new([width, height]: [usize; 2]) -> Self {
        let count = width * height;
        let (colour, depth_m) = (vec![[255; 3]; count], vec![f32::INFINITY; count]);
        Self { width, height, colour, depth_m, drawn: [width..0, height..0] }
    }

    /// Columns and rows of the picture between two ends, for loops.
    fn within(&self, low: [f32; 2], high: [f32; 2]) -> [Range<usize>; 2] {
        let range = |low: f32, high: f32, size: usize| {
            let first = low.ceil().clamp(0.0, size as f32) as usize;
            first..((high.floor() + 1.0).clamp(0.0, size as f32) as usize).max(first)
        };
        [range(low[0], high[0], self.width), range(low[1], high[1], self.height)]
    }

    fn put(&mut self, x: usize, y: usize, depth_m: f32, colour: Rgb) {
        let at = y * self.width + x;
        if depth_m < self.depth_m[at] {
            self.depth_m[at] = depth_m;
            self.colour[at] = colour;
            for (drawn, place) in self.drawn.iter_mut().zip([x, y]) {
                *drawn = drawn.start.min(place)..drawn.end.max(place + 1);
            }
        }
    }

    /// A disc that faces the viewer.
    fn disc(&mut self, at: Seen, radius_px: f32, colour: Rgb) {
        let [columns, rows] = self.within([at.x - radius_px, at.y - radius_px], [at.x + radius_px, at.y + radius_px]);
        for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
            let (dx, dy) = (x as f32 - at.x, y as f32 - at.y);
            if dx * dx + dy * dy <= radius_px * radius_px {
                self.put(x, y, at.depth_m, colour);
            }
        }
    }

    /// A line with round ends.
    pub(super) fn line(&mut self, from: Seen, to: Seen, radius_px: f32, colour: Rgb) {
        let length = (to.x - from.x).abs().max((to.y - from.y).abs());
        let steps = (length.ceil() as usize).clamp(1, 4 * (self.width + self.height));
        for step in 0..=steps {
            let share = step as f32 / steps as f32;
            let between = |from: f32, to: f32| from + (to - from) * share;
            let (x, y) = (between(from.x, to.x), between(from.y, to.y));
            self.disc(Seen { x, y, depth_m: between(from.depth_m, to.depth_m) }, radius_px, colour);
        }
    }

    /// A filled triangle of either orientation.
    pub(super) fn triangle(&mut self, [a, b, c]: [Seen; 3], colour: Rgb) {
        let cross = |p: Seen, q: Seen, x: f32, y: f32| (q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x);
        let area = cross(a, b, c.x, c.y);
        if area == 0.0 {
            return;
        }
        let low = [a.x.min(b.x).min(c.x), a.y.min(b.y).min(c.y)];
        let [columns, rows] = self.within(low, [a.x.max(b.x).max(c.x), a.y.max(b.y).max(c.y)]);
        for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
            let (u, v) = (x as f32, y as f32);
            let [of_a, of_b, of_c] = [cross(b, c, u, v), cross(c, a, u, v), cross(a, b, u, v)].map(|w| w / area);
            if of_a >= 0.0 && of_b >= 0.0 && of_c >= 0.0 {
                self.put(x, y, of_a * a.depth_m + of_b * b.depth_m + of_c * c.depth_m, colour);
            }
        }
    }

    /// Merges another layer of the same size into this one, whose depths remain, and clears the other.
    pub(super) fn lay(&mut self, other: &mut Self, opacity: Opacity) {
        let [columns, rows] = std::mem::replace(&mut other.drawn, [self.width..0, self.height..0]);
        for at in rows.flat_map(|y| columns.clone().map(move |x| (x, y))).map(|(x, y)| y * self.width + x) {
            if other.depth_m[at] < f32::INFINITY {
                let is_before = other.depth_m[at] <= self.depth_m[at];
                let share = if is_before { opacity.before } else { opacity.behind };
                self.colour[at] = mixed(self.colour[at], other.colour[at], share);
                other.depth_m[at] = f32::INFINITY;
            }
        }
    }
}

/// Between `under` (0) and `over` (1).
pub(super) fn mixed(under: Rgb, over: Rgb, share: f32) -> Rgb {
    std::array::from_fn(|channel| {
        let (from, to) = (f32::from(under[channel]), f32::from(over[channel]));
        (from + (to - from) * share + 0.5) as u8
    })
}

/// A picture, three bytes a pixel, [`MEAN_OF`] times smaller in both directions.
pub(super) fn means(large: &[u8], width: usize) -> Vec<u8> {
    let small_width = width / MEAN_OF;
    let small_height = large.len() / (3 * width * MEAN_OF);
    let mut small = Vec::with_capacity(3 * small_width * small_height);
    for row in 0..small_height {
        for column in 0..small_width {
            for channel in 0..3 {
                let square = (0..MEAN_OF * MEAN_OF).map(|at| {
                    let (y, x) = (row * MEAN_OF + at / MEAN_OF, column * MEAN_OF + at % MEAN_OF);
                    usize::from(large[3 * (y * width + x) + channel])
                });
                small.push((square.sum::<usize>() / (MEAN_OF * MEAN_OF)) as u8);
            }
        }
    }
    small
}

/// Lighter above 1, darker below; clamped to white.
pub(super) fn lit(colour: Rgb, light: f32) -> Rgb {
    colour.map(|value| (f32::from(value) * light + 0.5).min(255.0) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RED: Rgb = [255, 0, 0];
    const BLACK: Rgb = [0; 3];

    fn at(x: f32, y: f32, depth_m: f32) -> Seen {
        Seen { x, y, depth_m }
    }

    fn count(layer: &Layer, colour: Rgb) -> usize {
        layer.colour.iter().filter(|pixel| **pixel == colour).count()
    }

    #[test]
    fn the_nearer_one_is_seen_in_whichever_order() {
        for order in [[0, 1], [1, 0]] {
            let mut layer = Layer::new([40, 30]);
            for which in order {
                let (depth, colour) = [(1.0, RED), (2.0, BLACK)][which];
                layer.disc(at(20.0, 15.0, depth), 5.0, colour);
            }
            assert_eq!((count(&layer, RED), count(&layer, BLACK)), (81, 0));
        }
    }

    #[test]
    fn shapes_cover_their_areas() {
        let mut layer = Layer::new([100, 100]);
        layer.triangle([at(10.0, 10.0, 1.0), at(90.0, 10.0, 1.0), at(10.0, 90.0, 1.0)], RED);
        assert!((count(&layer, RED) as f32 - 3200.0).abs() <= 121.0);
        let mut layer = Layer::new([100, 100]);
        layer.line(at(20.0, 50.0, 1.0), at(80.0, 50.0, 1.0), 4.0, RED);
        assert!((count(&layer, RED) as f32 - (60.0 * 9.0 + 50.0)).abs() < 20.0);
    }

    #[test]
    fn what_is_off_the_picture_is_left_out() {
        let mut layer = Layer::new([10, 10]);
        layer.disc(at(-20.0, 500.0, 1.0), 5.0, RED);
        layer.line(at(-1e9, 5.0, 1.0), at(-1e8, 5.0, 1.0), 2.0, RED);
        layer.triangle([at(-5.0, -5.0, 1.0), at(-1.0, -5.0, 1.0), at(-5.0, -1.0, 1.0)], RED);
        assert_eq!(count(&layer, RED), 0);
        let mut sheet = Layer::new([10, 10]);
        sheet.lay(&mut layer, Opacity { before: 1.0, behind: 1.0 });
        assert_eq!(count(&sheet, [255; 3]), 100);
    }

    #[test]
    fn a_layer_is_faint_where_it_is_behind_and_empty_afterwards() {
        let mut sheet = Layer::new([20, 20]);
        sheet.disc(at(5.0, 10.0, 1.0), 4.0, BLACK);
        let mut layer = Layer::new([20, 20]);
        layer.line(at(0.0, 10.0, 2.0), at(19.0, 10.0, 2.0), 1.0, RED);
        sheet.lay(&mut layer, Opacity { before: 1.0, behind: 0.2 });
        assert_eq!(sheet.colour[10 * 20 + 15], RED);
        assert_eq!(sheet.colour[10 * 20 + 5], [51, 0, 0]);
        assert!(layer.depth_m.iter().all(|depth| *depth == f32::INFINITY));
    }

    #[test]
    fn a_mixture_ends_in_what_it_is_made_of() {
        assert_eq!(mixed([10, 20, 30], [110, 120, 130], 0.0), [10, 20, 30]);
        assert_eq!(mixed([10, 20, 30], [110, 120, 130], 1.0), [110, 120, 130]);
        assert_eq!(mixed([0; 3], [100; 3], 0.25), [25; 3]);
        assert_eq!(lit([100, 200, 0], 2.0), [200, 255, 0]);
    }

    #[test]
    fn means_are_those_of_squares() {
        let large = [[0, 10, 20], [4, 10, 20], [8, 8, 8], [9, 9, 9], [0, 10, 20], [4, 10, 20], [8, 8, 8], [9, 9, 9]];
        assert_eq!(means(large.as_flattened(), 4), [2, 10, 20, 8, 8, 8]);
    }
}
