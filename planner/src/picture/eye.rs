//! Who looks: a perspective eye on the workspace.
//!
//! The direction is chosen, the rest follows: the picture is scaled and shifted so that the workspace's box just fits.

use schema::{Grid, Vec3};

/// Share of a panel that stays free at each side of the box.
pub(super) const MARGIN: f32 = 0.04;

/// A direction to look from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Outlook {
    /// From the workspace to the eye; any length.
    pub(super) towards_eye: Vec3,
    /// What is above in the picture; not along the former.
    pub(super) up: Vec3,
    /// Distance from the middle of the workspace, in its sides: the farther, the less perspective.
    pub(super) sides_away: f32,
}

/// An eye with a picture before it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Eye {
    position_m: Vec3,
    right: Vec3,
    down: Vec3,
    forward: Vec3,
    focal_px: f32,
    centre_px: [f32; 2],
}

/// A point in the picture: pixels from the left and from the top, and depth along the line of sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Seen {
    pub(super) x: f32,
    pub(super) y: f32,
    pub(super) depth_m: f32,
}

impl Seen {
    /// The point at `share` of the way to another.
    pub(super) fn towards(self, other: Self, share: f32) -> Self {
        let between = |from: f32, to: f32| from + (to - from) * share;
        Self { x: between(self.x, other.x), y: between(self.y, other.y), depth_m: between(self.depth_m, other.depth_m) }
    }
}

impl Eye {
    /// Looks at the workspace's box, which fills `width_px` × `height_px` pixels but for a margin.
    pub(super) fn new(grid: &Grid, outlook: Outlook, width_px: usize, height_px: usize) -> Self {
        let towards_eye = outlook.towards_eye.normalize_or_zero();
        let right = outlook.up.cross(towards_eye).normalize_or_zero();
        let mut eye = Self {
            position_m: Vec3::splat(0.5 * grid.size_m) + towards_eye * (outlook.sides_away * grid.size_m),
            right,
            down: right.cross(towards_eye),
            forward: -towards_eye,
            focal_px: 1.0,
            centre_px: [0.0; 2],
        };
        let corners: Vec<Seen> = box_corners(grid.size_m).into_iter().filter_map(|corner| eye.see(corner)).collect();
        let ends = |of: fn(&Seen) -> f32| {
            let values = corners.iter().map(of);
            (values.clone().fold(f32::INFINITY, f32::min), values.fold(f32::NEG_INFINITY, f32::max))
        };
        let (left, right) = ends(|corner| corner.x);
        let (top, bottom) = ends(|corner| corner.y);
        let (wide, high) = (width_px as f32, height_px as f32);
        let inner = 1.0 - 2.0 * MARGIN;
        eye.focal_px = (wide * inner / (right - left)).min(high * inner / (bottom - top));
        eye.centre_px =
            [0.5 * wide - 0.5 * (left + right) * eye.focal_px, 0.5 * high - 0.5 * (top + bottom) * eye.focal_px];
        eye
    }

    /// Where a point of the workspace is seen; `None` if it is behind the eye or no point at all.
    pub(super) fn see(&self, point_m: Vec3) -> Option<Seen> {
        let from_eye = point_m - self.position_m;
        let depth_m = from_eye.dot(self.forward);
        let usable = depth_m > 1e-3 && from_eye.is_finite();
        let scale = self.focal_px / depth_m;
        usable.then(|| Seen {
            x: from_eye.dot(self.right) * scale + self.centre_px[0],
            y: from_eye.dot(self.down) * scale + self.centre_px[1],
            depth_m,
        })
    }

    /// The point of the workspace that is seen there.
    pub(super) fn point_m(&self, seen: Seen) -> Vec3 {
        let scale = seen.depth_m / self.focal_px;
        let across = self.right * ((seen.x - self.centre_px[0]) * scale);
        let along = self.down * ((seen.y - self.centre_px[1]) * scale);
        self.position_m + across + along + self.forward * seen.depth_m
    }

    /// How many pixels `length_m` takes across the line of sight at that depth.
    pub(super) fn pixels(&self, length_m: f32, depth_m: f32) -> f32 {
        length_m * self.focal_px / depth_m
    }
}

/// Corners of the workspace: bit 0 of the index is x, bit 1 y, bit 2 z.
pub(super) fn box_corners(size_m: f32) -> [Vec3; 8] {
    std::array::from_fn(|at| {
        let side = |bit: usize| if at >> bit & 1 == 1 { size_m } else { 0.0 };
        Vec3::new(side(0), side(1), side(2))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn eye() -> Eye {
        let outlook = Outlook { towards_eye: Vec3::new(0.4, -1.0, 0.8), up: Vec3::Z, sides_away: 4.0 };
        Eye::new(&Grid::PAPER, outlook, 600, 500)
    }

    #[test]
    fn the_box_fills_the_panel_but_for_the_margin() {
        let seen: Vec<Seen> = box_corners(0.30).into_iter().map(|corner| eye().see(corner).unwrap()).collect();
        let (low, high) = (|v: f32, s: f32| v >= s * MARGIN - 0.01, |v: f32, s: f32| v <= s * (1.0 - MARGIN) + 0.01);
        assert!(seen.iter().all(|at| low(at.x, 600.0) && high(at.x, 600.0) && low(at.y, 500.0) && high(at.y, 500.0)));
        let top = seen.iter().map(|at| at.y).fold(f32::INFINITY, f32::min);
        assert!((top - 500.0 * MARGIN).abs() < 0.01, "{top}");
    }

    #[test]
    fn what_is_seen_is_where_it_was() {
        for point in [Vec3::new(0.1, 0.2, 0.05), Vec3::new(0.29, 0.01, 0.2)] {
            let back = eye().point_m(eye().see(point).unwrap());
            assert!((back - point).length() < 1e-5, "{point} {back}");
        }
    }

    #[test]
    fn higher_is_above_nearer_is_less_deep_and_nothing_is_behind() {
        let at = |x, y, z| eye().see(Vec3::new(x, y, z)).unwrap();
        assert!(at(0.1, 0.1, 0.2).y < at(0.1, 0.1, 0.1).y);
        assert!(at(0.2, 0.1, 0.1).x > at(0.1, 0.1, 0.1).x);
        assert!(at(0.1, 0.0, 0.1).depth_m < at(0.1, 0.3, 0.1).depth_m);
        assert_eq!(eye().see(Vec3::new(4.0, -10.0, 8.0)), None);
        assert_eq!(eye().see(Vec3::splat(f32::NAN)), None);
    }
}
