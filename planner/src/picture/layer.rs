//! Pixels with depths: what is nearer hides what is farther.
//!
//! A layer that is laid on another stays visible, faintly, where it is behind: a finger under an overhang is still told of.

use super::eye::Seen;
use super::tints::{Rgb, WHITE, mixed};

/// A picture with a depth at each pixel; infinite where there is nothing.
#[derive(Debug, Clone)]
pub(super) struct Layer {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) colour: Vec<Rgb>,
    pub(super) depth_m: Vec<f32>,
    /// Columns and rows that were drawn on, both ends included; none if a first is behind its last.
    drawn: [[usize; 2]; 2],
}

/// How much is seen of a layer that is laid on another: where it is in front, and where it is behind.
#[derive(Debug, Clone, Copy)]
pub(super) struct Opacity {
    pub(super) before: f32,
    pub(super) behind: f32,
}

const NOTHING: [[usize; 2]; 2] = [[usize::MAX, 0]; 2];

impl Layer {
    /// A white sheet.
    pub(super) fn new(width: usize, height: usize) -> Self {
        let count = width * height;
        Self { width, height, colour: vec![WHITE; count], depth_m: vec![f32::INFINITY; count], drawn: NOTHING }
    }

    /// Columns and rows of the picture between two ends, for loops.
    pub(super) fn within(&self, low: [f32; 2], high: [f32; 2]) -> [std::ops::Range<usize>; 2] {
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
                *drawn = [drawn[0].min(place), drawn[1].max(place)];
            }
        }
    }

    /// A disc across the line of sight.
    pub(super) fn disc(&mut self, at: Seen, radius_px: f32, colour: Rgb) {
        let [columns, rows] = self.within([at.x - radius_px, at.y - radius_px], [at.x + radius_px, at.y + radius_px]);
        for y in rows {
            for x in columns.clone() {
                let (dx, dy) = (x as f32 - at.x, y as f32 - at.y);
                if dx * dx + dy * dy <= radius_px * radius_px {
                    self.put(x, y, at.depth_m, colour);
                }
            }
        }
    }

    /// A line with round ends.
    pub(super) fn line(&mut self, from: Seen, to: Seen, radius_px: f32, colour: Rgb) {
        let length = (to.x - from.x).abs().max((to.y - from.y).abs());
        let steps = (length.ceil() as usize).clamp(1, 4 * (self.width + self.height));
        for step in 0..=steps {
            self.disc(from.towards(to, step as f32 / steps as f32), radius_px, colour);
        }
    }

    /// A filled triangle, whichever way round its corners go.
    pub(super) fn triangle(&mut self, [a, b, c]: [Seen; 3], colour: Rgb) {
        let cross = |p: Seen, q: Seen, x: f32, y: f32| (q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x);
        let area = cross(a, b, c.x, c.y);
        if area == 0.0 {
            return;
        }
        let least = |of: fn(Seen) -> f32| of(a).min(of(b)).min(of(c));
        let most = |of: fn(Seen) -> f32| of(a).max(of(b)).max(of(c));
        let [columns, rows] = self.within([least(|s| s.x), least(|s| s.y)], [most(|s| s.x), most(|s| s.y)]);
        for y in rows {
            for x in columns.clone() {
                let (u, v) = (x as f32, y as f32);
                let [of_a, of_b, of_c] = [cross(b, c, u, v), cross(c, a, u, v), cross(a, b, u, v)].map(|w| w / area);
                if of_a >= 0.0 && of_b >= 0.0 && of_c >= 0.0 {
                    self.put(x, y, of_a * a.depth_m + of_b * b.depth_m + of_c * c.depth_m, colour);
                }
            }
        }
    }

    /// Lays another layer of the same size on this one, whose depths stay, and empties the other.
    pub(super) fn lay(&mut self, other: &mut Self, opacity: Opacity) {
        let [columns, rows] = other.drawn.map(|[first, last]| first..last.saturating_add(1).max(first));
        for y in rows {
            for x in columns.clone() {
                let at = y * self.width + x;
                if other.depth_m[at] < f32::INFINITY {
                    let before = other.depth_m[at] <= self.depth_m[at];
                    let share = if before { opacity.before } else { opacity.behind };
                    self.colour[at] = mixed(self.colour[at], other.colour[at], share);
                    other.depth_m[at] = f32::INFINITY;
                }
            }
        }
        other.drawn = NOTHING;
    }
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
            let mut layer = Layer::new(40, 30);
            for which in order {
                let (depth, colour) = [(1.0, RED), (2.0, BLACK)][which];
                layer.disc(at(20.0, 15.0, depth), 5.0, colour);
            }
            assert_eq!((count(&layer, RED), count(&layer, BLACK)), (81, 0));
        }
    }

    #[test]
    fn shapes_cover_their_areas() {
        let mut layer = Layer::new(100, 100);
        layer.triangle([at(10.0, 10.0, 1.0), at(90.0, 10.0, 1.0), at(10.0, 90.0, 1.0)], RED);
        assert!((count(&layer, RED) as f32 - 3200.0).abs() <= 121.0);
        let mut layer = Layer::new(100, 100);
        layer.line(at(20.0, 50.0, 1.0), at(80.0, 50.0, 1.0), 4.0, RED);
        assert!((count(&layer, RED) as f32 - (60.0 * 9.0 + 50.0)).abs() < 20.0);
    }

    #[test]
    fn what_is_off_the_picture_is_left_out() {
        let mut layer = Layer::new(10, 10);
        layer.disc(at(-20.0, 500.0, 1.0), 5.0, RED);
        layer.line(at(-1e9, 5.0, 1.0), at(-1e8, 5.0, 1.0), 2.0, RED);
        layer.triangle([at(-5.0, -5.0, 1.0), at(-1.0, -5.0, 1.0), at(-5.0, -1.0, 1.0)], RED);
        assert_eq!(count(&layer, RED), 0);
        let mut sheet = Layer::new(10, 10);
        sheet.lay(&mut layer, Opacity { before: 1.0, behind: 1.0 });
        assert_eq!(count(&sheet, WHITE), 100);
    }

    #[test]
    fn a_layer_is_faint_where_it_is_behind_and_empty_afterwards() {
        let mut sheet = Layer::new(20, 20);
        sheet.disc(at(5.0, 10.0, 1.0), 4.0, BLACK);
        let mut layer = Layer::new(20, 20);
        layer.line(at(0.0, 10.0, 2.0), at(19.0, 10.0, 2.0), 1.0, RED);
        sheet.lay(&mut layer, Opacity { before: 1.0, behind: 0.2 });
        assert_eq!(sheet.colour[10 * 20 + 15], RED);
        assert_eq!(sheet.colour[10 * 20 + 5], [51, 0, 0]);
        assert!(layer.depth_m.iter().all(|depth| *depth == f32::INFINITY));
    }
}
