//! Depths of triangles at the pixels of a camera.
//!
//! A ray from the camera meets a triangle if it is on the same side of all three of its edges. Sides are told in double
//! precision, and by numbers that are each other's opposites for the two triangles at an edge, so that no ray slips
//! through between them.

use glamx::DVec3;
use schema::{Intrinsics, Pose, TriangleMesh};

/// A triangle with a corner that is less than this in front of the camera may cover all pixels.
const NEAR_M: f64 = 1e-3;
/// Rays are rounded to single precision: a triangle may cover pixels that are this far from it.
const MARGIN_PX: f64 = 0.01;

/// What rays have met so far.
#[derive(Debug, Clone)]
pub(super) struct Canvas {
    lens: Intrinsics,
    /// The rays of the columns and of the rows: x and y where z is 1.
    across: [Vec<f64>; 2],
    /// Depth at each pixel, row by row, in metres; infinite where nothing was met.
    depths_m: Vec<f32>,
}

impl Canvas {
    pub(super) fn new(lens: &Intrinsics) -> Self {
        let columns = (0..lens.width_px).map(|u| f64::from(lens.ray([u, 0]).x)).collect();
        let rows = (0..lens.height_px).map(|v| f64::from(lens.ray([0, v]).y)).collect();
        let depths_m = vec![f32::INFINITY; lens.width_px * lens.height_px];
        Self { lens: *lens, across: [columns, rows], depths_m }
    }

    /// The depth at a pixel, in metres; infinite where nothing was met.
    pub(super) fn depth_m(&self, [u, v]: [usize; 2]) -> f32 {
        self.depths_m.get(v * self.lens.width_px + u).copied().unwrap_or(f32::INFINITY)
    }

    /// Lets all rays meet a mesh, which is seen from both sides.
    pub(super) fn draw(&mut self, mesh: &TriangleMesh, camera_from_mesh: &Pose) {
        let seen = |corner_m| camera_from_mesh.transform_point(corner_m).as_dvec3();
        let corners_m: Vec<DVec3> = mesh.corners_m().iter().copied().map(seen).collect();
        for triangle in mesh.triangles() {
            self.draw_triangle(triangle.map(|corner| corners_m[corner as usize]));
        }
    }

    fn draw_triangle(&mut self, corners_m: [DVec3; 3]) {
        let [a, b, c] = corners_m;
        let [near_m, far_m] = ends([a.z, b.z, c.z]);
        if far_m <= 0.0 {
            return;
        }
        let Intrinsics { width_px, height_px, fx_px, fy_px, cx_px, cy_px } = self.lens;
        let covered = |axis: usize, focal_px: f32, middle_px: f32, count: usize| {
            let at_px = corners_m.map(|m| m[axis] / m.z * f64::from(focal_px) + f64::from(middle_px));
            let [low, high] = ends(at_px);
            match near_m < NEAR_M {
                true => 0..count,
                false => (low - MARGIN_PX).ceil() as usize..count.min((high + MARGIN_PX + 1.0) as usize),
            }
        };
        let columns = covered(0, fx_px, cx_px, width_px);
        let edges = [b.cross(c), c.cross(a), a.cross(b)];
        let normal = (b - a).cross(c - a);
        let away = normal.dot(a);
        for v in covered(1, fy_px, cy_px, height_px) {
            for u in columns.clone() {
                let ray = DVec3::new(self.across[0][u], self.across[1][v], 1.0);
                let [low, high] = ends(edges.map(|edge| edge.dot(ray)));
                let depth_m = away / normal.dot(ray);
                if (low >= 0.0 || high <= 0.0) && depth_m > 0.0 && depth_m.is_finite() {
                    let nearest_m = &mut self.depths_m[v * width_px + u];
                    *nearest_m = nearest_m.min(depth_m.max(near_m).min(far_m) as f32);
                }
            }
        }
    }
}

/// The least and the largest of three numbers.
fn ends([a, b, c]: [f64; 3]) -> [f64; 2] {
    [a.min(b).min(c), a.max(b).max(c)]
}

#[cfg(test)]
mod tests {
    use parry3d::query::{Ray, RayCast as _};
    use parry3d::shape::TriMesh;
    use schema::{Purpose, Stream, Vec3, axis_angle};

    use super::*;

    const LENS: Intrinsics =
        Intrinsics { width_px: 64, height_px: 48, fx_px: 60.0, fy_px: 60.0, cx_px: 32.0, cy_px: 24.0 };

    /// A ball of triangles as small as a pixel, or smaller: 60 mm, closed, from pole to pole.
    fn ball(around: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let rings = around / 2 - 1;
        let at = |ring: u32, side: u32| 2 + ring * around + side % around;
        let corner = |ring: u32, side: u32| {
            let [down, turn] = [(ring + 1) as f32 / (rings + 1) as f32, 2.0 * side as f32 / around as f32]
                .map(|half_turns| libm::sincosf(half_turns * core::f32::consts::PI));
            0.03 * Vec3::new(down.0 * turn.1, down.0 * turn.0, down.1)
        };
        let corners = (0..rings).flat_map(|ring| (0..around).map(move |side| corner(ring, side)));
        let corners: Vec<Vec3> = [0.03 * Vec3::Z, -0.03 * Vec3::Z].into_iter().chain(corners).collect();
        let mut triangles = Vec::new();
        for side in 0..around {
            triangles.push([0, at(0, side), at(0, side + 1)]);
            triangles.push([1, at(rings - 1, side + 1), at(rings - 1, side)]);
            for ring in 0..rings - 1 {
                let [a, b, c, d] = [at(ring, side), at(ring, side + 1), at(ring + 1, side), at(ring + 1, side + 1)];
                triangles.extend([[a, c, b], [b, c, d]]);
            }
        }
        (corners, triangles)
    }

    #[test]
    fn rays_meet_triangles_where_parry_s_do() {
        let (corners, triangles) = ball(16);
        let mesh = TriangleMesh::new(&corners, triangles.clone()).unwrap();
        let theirs = TriMesh::new(mesh.corners_m().to_vec(), triangles).unwrap();
        let mut stream = Stream::new(31, 0, Purpose::Views, 0);
        let (mut met, mut disagreements) = (0, 0);
        for _ in 0..30 {
            let at_m = stream.point(Vec3::new(-0.02, -0.02, 0.05), Vec3::new(0.02, 0.02, 0.12));
            let pose = Pose::from_parts(at_m, stream.rotation());
            let mut canvas = Canvas::new(&LENS);
            canvas.draw(&mesh, &pose);
            for (u, v) in (0..64).flat_map(|u| (0..48).map(move |v| (u, v))) {
                let ray = Ray::new(Vec3::ZERO, LENS.ray([u, v]));
                let expected_m = theirs.cast_ray(&pose, &ray, 10.0, false).unwrap_or(f32::INFINITY);
                let got_m = canvas.depth_m([u, v]);
                met += u32::from(got_m.is_finite());
                // A ray along a silhouette may hit in one and miss in the other.
                disagreements += u32::from(got_m != expected_m && (got_m - expected_m).abs() > 2e-5);
            }
        }
        assert!(met > 10_000, "only {met} rays met it");
        assert!(disagreements <= 30, "{disagreements} of {} rays disagree", 30 * 64 * 48);
    }

    /// A hole of one pixel would show what is far behind, also where many triangles share one pixel, a corner lies
    /// behind the camera, or edges and pixels are in line.
    #[test]
    fn no_ray_slips_through_between_triangles() {
        for (around, turn_rad) in [(8, 0.0), (64, 0.0), (64, 0.3), (512, 0.0), (512, 1.0)] {
            let (corners, triangles) = ball(around);
            let mesh = TriangleMesh::new(&corners, triangles).unwrap();
            for z_m in [0.0, 0.02, 0.2, 2.0] {
                let mut canvas = Canvas::new(&LENS);
                canvas.draw(&mesh, &Pose::from_parts(Vec3::Z * z_m, axis_angle(Vec3::X, turn_rad)));
                // Well within the outline of the ball, which is nearly round.
                let inner = 0.9 * 0.03 * libm::cosf(core::f32::consts::PI / around as f32).powi(2) / z_m.max(1e-6);
                for (u, v) in (0..64).flat_map(|u| (0..48).map(move |v| (u, v))) {
                    let ray = LENS.ray([u, v]);
                    if libm::hypotf(ray.x, ray.y) < inner {
                        let depth_m = canvas.depth_m([u, v]);
                        assert!(
                            depth_m > 0.0 && depth_m <= z_m + 0.030_001,
                            "{around}, {z_m} m: {depth_m} at {u}, {v}"
                        );
                    }
                }
            }
        }
    }
}
