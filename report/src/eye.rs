//! The camera: the projection of all still pictures.

use schema::Vec3;

/// Margin on each side of the workspace, as a share of the picture.
const MARGIN: f32 = 0.04;

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
    centre_px: [f32; 2],
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
        let scale = Scale::Parallel(px_per_m);
        Self { position_m: middle_m + 10.0 * towards, right, up: towards.cross(right), towards, scale, centre_px }
    }

    /// Looks at a workspace of side `size_m`, which fills `width_px` × `height_px` pixels except for a margin.
    pub(crate) fn on_workspace(size_m: f32, outlook: Outlook, [width_px, height_px]: [usize; 2]) -> Self {
        let towards = outlook.towards_eye.normalize_or_zero();
        let right = outlook.up.cross(towards).normalize_or_zero();
        let mut eye = Self {
            position_m: Vec3::splat(0.5 * size_m) + towards * (outlook.sides_away * size_m),
            right,
            up: towards.cross(right),
            towards,
            scale: Scale::Perspective(1.0),
            centre_px: [0.0; 2],
        };
        let seen: Vec<Seen> = cube_corners(size_m).into_iter().filter_map(|corner| eye.see(corner)).collect();
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

    /// The projection of a point; `None` if it is behind the eye or not finite.
    pub(crate) fn see(&self, point_m: Vec3) -> Option<Seen> {
        let from_eye = point_m - self.position_m;
        let depth_m = -from_eye.dot(self.towards);
        let scale = self.pixels(1.0, depth_m);
        (depth_m > 1e-3 && from_eye.is_finite()).then(|| Seen {
            x: self.centre_px[0] + from_eye.dot(self.right) * scale,
            y: self.centre_px[1] - from_eye.dot(self.up) * scale,
            depth_m,
        })
    }

    /// The point with this projection.
    pub(crate) fn point_m(&self, seen: Seen) -> Vec3 {
        let scale = self.pixels(1.0, seen.depth_m);
        let [across, along] = [(seen.x - self.centre_px[0]) / scale, (self.centre_px[1] - seen.y) / scale];
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

/// Corners of a cube at the origin: bit 0 of the index is x, bit 1 y, bit 2 z.
fn cube_corners(size_m: f32) -> [Vec3; 8] {
    std::array::from_fn(|at| Vec3::from_array([0, 1, 2].map(|bit| if at >> bit & 1 == 1 { size_m } else { 0.0 })))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn eye() -> Eye {
        let outlook = Outlook { towards_eye: Vec3::new(0.4, -1.0, 0.8), up: Vec3::Z, sides_away: 4.0 };
        Eye::on_workspace(0.30, outlook, [600, 500])
    }

    #[test]
    fn the_box_fills_the_panel_but_for_the_margin() {
        let seen: Vec<Seen> = cube_corners(0.30).into_iter().map(|corner| eye().see(corner).unwrap()).collect();
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
}
