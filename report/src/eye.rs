//! The camera: the projection of all still pictures.

use schema::{Intrinsics, Vec3};

/// What is nearer to the eye than this is not seen: of a workspace from outside, and through a lens.
const NEAR_M: [f32; 2] = [1e-3, 0.02];

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
}

/// The scale from lengths across the line of sight to pixels.
#[derive(Debug, Clone, Copy)]
enum Scale {
    /// Without perspective: pixels per metre.
    Parallel(f32),
    /// Through a lens, in its optical frame: pixels per metre at a depth of one metre.
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
        }
    }

    /// Unit vector from the scene to the eye.
    pub(crate) fn towards(&self) -> Vec3 {
        self.towards
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
        NEAR_M[usize::from(matches!(self.scale, Scale::Perspective(_)))]
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

    /// Length in pixels of `length_m` across the line of sight at a depth.
    pub(crate) fn pixels(&self, length_m: f32, depth_m: f32) -> f32 {
        match self.scale {
            Scale::Parallel(px_per_m) => length_m * px_per_m,
            Scale::Perspective(focal_px) => length_m * focal_px / depth_m,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_perspective_lengths_are_equal_and_higher_is_above() {
        let eye = Eye::parallel(Vec3::new(0.4, -1.0, 0.8), Vec3::splat(0.15), 1000.0, [300.0, 250.0]);
        let at = |x, y, z| eye.see(Vec3::new(x, y, z)).unwrap();
        let middle = at(0.15, 0.15, 0.15);
        assert!((middle.x - 300.0).abs() < 1e-2 && (middle.y - 250.0).abs() < 1e-2, "{middle:?}");
        assert!(at(0.1, 0.1, 0.2).y < at(0.1, 0.1, 0.1).y && at(0.2, 0.1, 0.1).x > at(0.1, 0.1, 0.1).x);
        assert!(at(0.1, 0.0, 0.1).depth_m < at(0.1, 0.3, 0.1).depth_m);
        let step = at(0.2, 0.1, 0.1).x - at(0.1, 0.1, 0.1).x;
        assert!((at(0.2, 0.3, 0.2).x - at(0.1, 0.3, 0.2).x - step).abs() < 1e-2);
        assert_eq!(eye.see(Vec3::splat(f32::NAN)), None);
    }

    #[test]
    fn through_a_lens_points_are_where_its_equations_have_them() {
        let lens = Intrinsics { width_px: 64, height_px: 48, fx_px: 60.0, fy_px: 45.0, cx_px: 30.0, cy_px: 20.0 };
        let eye = Eye::through(&lens);
        let point = Vec3::new(0.1, -0.2, 0.5);
        let seen = eye.see(point).unwrap();
        assert!((seen.x - 42.0).abs() < 1e-4 && (seen.y - 2.0).abs() < 1e-4 && seen.depth_m == 0.5, "{seen:?}");
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
