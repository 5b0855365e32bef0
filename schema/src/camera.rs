//! Pinhole depth cameras. Pixel `(u, v)` has its centre at the whole numbers `u`, `v`; camera x right, y down, z
//! forward.

use crate::{Grid, Pose, Quat, Vec3, axis_angle, pose_from_parts};

/// Focal lengths and principal point, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Pixels in a row.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// Focal length along u.
    pub fx_px: f32,
    /// Focal length along v.
    pub fy_px: f32,
    /// Principal point, u.
    pub cx_px: f32,
    /// Principal point, v.
    pub cy_px: f32,
}

impl Intrinsics {
    /// VGN's simulated camera.
    pub const VGN: Self =
        Self { width_px: 640, height_px: 480, fx_px: 540.0, fy_px: 540.0, cx_px: 320.0, cy_px: 240.0 };

    /// The pixel onto which a point in the camera frame falls, or `None` if it is behind the camera or off the image.
    #[must_use]
    pub fn project(&self, point_camera_m: Vec3) -> Option<[usize; 2]> {
        if point_camera_m.z <= 0.0 {
            return None;
        }
        let u = (point_camera_m.x * self.fx_px / point_camera_m.z + self.cx_px + 0.5).floor();
        let v = (point_camera_m.y * self.fy_px / point_camera_m.z + self.cy_px + 0.5).floor();
        let inside = u >= 0.0 && v >= 0.0 && u < self.width_px as f32 && v < self.height_px as f32;
        inside.then_some([u as usize, v as usize])
    }

    /// The ray through a pixel's centre, in the camera frame, scaled so that its z is 1: depth times it is the point.
    #[must_use]
    pub fn ray(&self, [u, v]: [usize; 2]) -> Vec3 {
        Vec3::new((u as f32 - self.cx_px) / self.fx_px, (v as f32 - self.cy_px) / self.fy_px, 1.0)
    }
}

/// A camera in the workspace.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Lens.
    pub intrinsics: Intrinsics,
    /// Pose.
    pub workspace_from_camera: Pose,
}

/// Where a camera stood, as stored with a scene: on a sphere about the middle of the workspace's floor, looking at it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Distance from the sphere's centre, in metres.
    pub radius_m: f32,
    /// Angle from the vertical.
    pub polar_rad: f32,
    /// Angle about the vertical, from +x.
    pub azimuth_rad: f32,
}

impl View {
    /// Where the camera is: three turns, of a camera that looks straight down, tilted by the polar angle about y,
    /// turned by the azimuth about z.
    #[must_use]
    pub fn workspace_from_camera(&self, grid: &Grid) -> Pose {
        // Straight down: camera x along workspace y, camera y along workspace x, camera z along −z.
        let down = Quat::from_xyzw(core::f32::consts::FRAC_1_SQRT_2, core::f32::consts::FRAC_1_SQRT_2, 0.0, 0.0);
        let onto_sphere = axis_angle(Vec3::Z, self.azimuth_rad) * axis_angle(Vec3::Y, self.polar_rad);
        let target = Vec3::new(0.5 * grid.size_m, 0.5 * grid.size_m, 0.0);
        let eye = target + onto_sphere * Vec3::Z * self.radius_m;
        pose_from_parts(onto_sphere * down, eye)
    }
}

/// A depth image: distance along the camera's z in metres, row by row; 0 where nothing was seen.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthImage {
    /// Pixels in a row.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// `width_px * height_px` values.
    pub depth_m: Vec<f32>,
}

impl DepthImage {
    /// Depth at a pixel, in metres; `None` where nothing was seen.
    #[must_use]
    pub fn at(&self, [u, v]: [usize; 2]) -> Option<f32> {
        let depth = self.depth_m[v * self.width_px + u];
        (depth > 0.0).then_some(depth)
    }
}

/// An image of 8-bit colours.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ColorImage {
    /// Pixels in a row.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// Red, green and blue, row by row.
    pub pixels: Vec<[u8; 3]>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixels_ray_falls_on_that_pixel() {
        let lens = Intrinsics::VGN;
        for pixel in [[0, 0], [639, 479], [320, 240], [17, 401]] {
            assert_eq!(lens.project(lens.ray(pixel) * 0.7), Some(pixel));
        }
    }
}
