//! The camera: the projection of all still pictures.

use schema::{Intrinsics, Vec3};

/// Margin on each side of the workspace, as a share of the picture.
const MARGIN: f32 = 0.04;
/// What is nearer to the eye than this is not seen: of a workspace from outside, and through a lens.
const NEAR_M: [f32; 2] = [1e-3, 0.02];
/// White edges of dark lines are this far behind them, so that they cover no other line of the same hand.
const HALO_BEHIND_M: f32 = 0.004;
/// Where boxes are light that are seen through a lens: at the lens's side, and above.
const LENS_SKY: Vec3 = Vec3::new(-0.3, -0.8, -0.52);

/// A viewing direction.
#[derive(Debug, Clone, Copy)]
pub struct Outlook {
    /// From the workspace to the eye; any length.
    pub towards_eye: Vec3,
    /// The up direction in the picture; not parallel to the former.
    pub up: Vec3,
    /// Distance from the centre of the workspace, in its sides: larger values give less perspective.
    pub sides_away: f32,
}

/// A camera with its image plane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Eye {
    position_m: Vec3,
    right: Vec3,
    up: Vec3,
    towards: Vec3,
    scale: Scale,
    /// Pixels down for each pixel across: how lenses with unequal focal lengths see.
    stretch: f32,
    centre_px: [f32; 2],
    /// Whether it is a camera's, in its optical frame.
    is_lens: bool,
}

/// The scale from lengths across the line of sight to pixels.
#[derive(Debug, Clone, Copy)]
enum Scale {
    /// Without perspective: pixels per metre.
    Parallel(f32),
    /// With perspective: pixels per metre at a depth of one metre.
    Perspective(f32),
}

/// A point in the picture: pixels from the left and from the top, and depth along the line of sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Seen {
    pub(crate) x: f32,
    pub(crate) y: f32,
    pub(crate) depth_m: f32,
}

impl Eye {
    /// Looks at `middle_m`, which projects to `centre_px`, without perspective.
    pub(crate) fn parallel(towards_eye: Vec3, middle_m: Vec3, px_per_m: f32, centre_px: [f32; 2]) -> Self {
        let towards = towards_eye.normalize_or_zero();
        let right = Vec3::Z.cross(towards).normalize_or_zero();
        Self {
            position_m: middle_m + 10.0 * towards,
            right,
            up: towards.cross(right),
            towards,
            scale: Scale::Parallel(px_per_m),
            stretch: 1.0,
            centre_px,
            is_lens: false,
        }
    }

    /// Sees what a camera with this lens sees, in its optical frame.
    pub(crate) fn through(lens: &Intrinsics) -> Self {
        Self {
            position_m: Vec3::ZERO,
            right: Vec3::X,
            up: -Vec3::Y,
            towards: -Vec3::Z,
            scale: Scale::Perspective(lens.fx_px),
            stretch: lens.fy_px / lens.fx_px,
            centre_px: [lens.cx_px, lens.cy_px],
            is_lens: true,
        }
    }

    /// Looks at a workspace of side `size_m`, which fills `width_px` × `height_px` pixels except for a margin.
    pub(crate) fn on_box([low_m, high_m]: [Vec3; 2], outlook: Outlook, [width_px, height_px]: [usize; 2]) -> Self {
        let size_m = (high_m - low_m).max_element();
        let towards = outlook.towards_eye.normalize_or_zero();
        let right = outlook.up.cross(towards).normalize_or_zero();
        let mut eye = Self {
            position_m: 0.5 * (low_m + high_m) + towards * (outlook.sides_away * size_m),
            right,
            up: towards.cross(right),
            towards,
            scale: Scale::Perspective(1.0),
            stretch: 1.0,
            centre_px: [0.0; 2],
            is_lens: false,
        };
        let seen: Vec<Seen> = corners([low_m, high_m]).into_iter().filter_map(|corner| eye.see(corner)).collect();
        let ends = |of: fn(&Seen) -> f32| {
            let values = seen.iter().map(of);
            [values.clone().fold(f32::INFINITY, f32::min), values.fold(f32::NEG_INFINITY, f32::max)]
        };
        let ([left, right], [top, bottom]) = (ends(|corner| corner.x), ends(|corner| corner.y));
        let (wide, high, inner) = (width_px as f32, height_px as f32, 1.0 - 2.0 * MARGIN);
        let focal_px = (wide * inner / (right - left)).min(high * inner / (bottom - top));
        eye.scale = Scale::Perspective(focal_px);
        eye.centre_px = [0.5 * wide - 0.5 * (left + right) * focal_px, 0.5 * high - 0.5 * (top + bottom) * focal_px];
        eye
    }

    /// Unit vector from the scene to the eye.
    pub(crate) fn towards(&self) -> Vec3 {
        self.towards
    }

    /// Where boxes are light.
    pub(crate) fn sky(&self) -> Vec3 {
        if self.is_lens { LENS_SKY } else { Vec3::Z }
    }

    /// A point behind this one. Through a lens it is far behind: what one sees there is often the back of a hand.
    pub(crate) fn behind(&self, point_m: Vec3) -> Vec3 {
        if self.is_lens { 2.0 * point_m } else { point_m - self.towards * HALO_BEHIND_M }
    }

    /// The projection of a point; `None` if it is behind the eye or not finite.
    pub(crate) fn see(&self, point_m: Vec3) -> Option<Seen> {
        (self.depth_m(point_m) > self.near_m() && point_m.is_finite()).then(|| self.projected(point_m))
    }

    /// The projection of a flat polygon, or of a line there and back, cut where it comes too near.
    pub(crate) fn see_ring(&self, ring_m: &[Vec3]) -> Vec<Seen> {
        let mut seen = Vec::with_capacity(ring_m.len() + 1);
        for (from, to) in ring_m.iter().zip(ring_m.iter().cycle().skip(1)) {
            seen.extend(self.see(*from));
            let [before, after] = [from, to].map(|point| self.depth_m(*point) - self.near_m());
            if (before > 0.0) != (after > 0.0) && from.is_finite() && to.is_finite() {
                seen.push(self.projected(*from + (*to - *from) * (before / (before - after))));
            }
        }
        seen
    }

    fn near_m(&self) -> f32 {
        NEAR_M[usize::from(self.is_lens)]
    }

    fn depth_m(&self, point_m: Vec3) -> f32 {
        -(point_m - self.position_m).dot(self.towards)
    }

    fn projected(&self, point_m: Vec3) -> Seen {
        let (from_eye, depth_m) = (point_m - self.position_m, self.depth_m(point_m));
        let scale = self.pixels(1.0, depth_m);
        Seen {
            x: self.centre_px[0] + from_eye.dot(self.right) * scale,
            y: self.centre_px[1] - from_eye.dot(self.up) * scale * self.stretch,
            depth_m,
        }
    }

    /// The point with this projection.
    pub(crate) fn point_m(&self, seen: Seen) -> Vec3 {
        let scale = self.pixels(1.0, seen.depth_m);
        let across = (seen.x - self.centre_px[0]) / scale;
        let along = (self.centre_px[1] - seen.y) / (scale * self.stretch);
        self.position_m + self.right * across + self.up * along - self.towards * seen.depth_m
    }

    /// Length in pixels of `length_m` across the line of sight at a depth.
    pub(crate) fn pixels(&self, length_m: f32, depth_m: f32) -> f32 {
        match self.scale {
            Scale::Parallel(px_per_m) => length_m * px_per_m,
            Scale::Perspective(focal_px) => length_m * focal_px / depth_m,
        }
    }
}

/// Corners of a box: bit 0 of the index is x, bit 1 y, bit 2 z.
fn corners(ends_m: [Vec3; 2]) -> [Vec3; 8] {
    std::array::from_fn(|at| Vec3::from_array([0, 1, 2].map(|bit| ends_m[at >> bit & 1][bit])))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn eye() -> Eye {
        let outlook = Outlook { towards_eye: Vec3::new(0.4, -1.0, 0.8), up: Vec3::Z, sides_away: 4.0 };
        Eye::on_box([Vec3::ZERO, Vec3::splat(0.30)], outlook, [600, 500])
    }

    #[test]
    fn the_box_fills_the_panel_but_for_the_margin() {
        let seen: Vec<Seen> =
            corners([Vec3::ZERO, Vec3::splat(0.30)]).into_iter().map(|corner| eye().see(corner).unwrap()).collect();
        let (low, high) = (|v: f32, s: f32| v >= s * MARGIN - 0.01, |v: f32, s: f32| v <= s * (1.0 - MARGIN) + 0.01);
        assert!(seen.iter().all(|at| low(at.x, 600.0) && high(at.x, 600.0) && low(at.y, 500.0) && high(at.y, 500.0)));
        let top = seen.iter().map(|at| at.y).fold(f32::INFINITY, f32::min);
        assert!((top - 500.0 * MARGIN).abs() < 0.01, "{top}");
    }

    #[test]
    fn what_is_seen_is_where_it_was() {
        let parallel = Eye::parallel(Vec3::new(0.4, -1.0, 0.8), Vec3::splat(0.15), 1000.0, [300.0, 250.0]);
        for (eye, tolerance_m) in [(eye(), 1e-5), (parallel, 1e-5)] {
            for point in [Vec3::new(0.1, 0.2, 0.05), Vec3::new(0.29, 0.01, 0.2)] {
                let back = eye.point_m(eye.see(point).unwrap());
                assert!((back - point).length() < tolerance_m, "{point} {back}");
            }
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

    #[test]
    fn through_a_lens_points_are_where_its_equations_have_them() {
        let lens = Intrinsics { width_px: 64, height_px: 48, fx_px: 60.0, fy_px: 45.0, cx_px: 30.0, cy_px: 20.0 };
        let eye = Eye::through(&lens);
        let point = Vec3::new(0.1, -0.2, 0.5);
        let seen = eye.see(point).unwrap();
        assert!((seen.x - 42.0).abs() < 1e-4 && (seen.y - 2.0).abs() < 1e-4 && seen.depth_m == 0.5, "{seen:?}");
        assert!((eye.point_m(seen) - point).length() < 1e-6);
        // Of a square that the near plane halves four corners are left; two of them are on that plane.
        let square = [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.14], [-0.1, 0.14]].map(|[x, z]| Vec3::new(x, 0.01, z));
        let [first, second, third, last] = eye.see_ring(&square)[..] else { panic!() };
        assert_eq!([second, third].map(|corner| corner.depth_m), [0.14; 2]);
        assert!((first.depth_m - NEAR_M[1]).abs() < 1e-6 && (last.depth_m - NEAR_M[1]).abs() < 1e-6);
        assert!(
            (first.x - 330.0).abs() < 0.1 && (third.x + 60.0 * 0.1 / 0.14 - 30.0).abs() < 0.1,
            "{first:?} {third:?}"
        );
        assert_eq!(eye.see_ring(&[Vec3::ZERO, -Vec3::Z, Vec3::X]), []);
    }
}
