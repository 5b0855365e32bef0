//! Normals of the observed surface: the gradient of the TSDF where it changes sign.

use rayon::prelude::*;
use schema::Vec3;

use crate::blocks::{Field, in_voxels, trilinear};

/// The outward unit normal of the surface at each point, or 0 where too few voxels around it were observed.
///
/// The gradient is the difference of trilinear values a voxel apart along each axis. If one of the two is unobserved,
/// the one-sided difference over half the distance is used.
#[must_use]
pub fn normals<F: Field>(field: &F, points_m: &[Vec3]) -> Vec<Vec3> {
    let at = |point_m: &Vec3| in_voxels(field.lattice(), *point_m);
    points_m.par_iter().with_min_len(1024).map(|point_m| normal(field, at(point_m))).collect()
}

/// `at` is in voxels.
fn normal<F: Field>(field: &F, at: Vec3) -> Vec3 {
    let here = trilinear(field, at);
    let slope = |axis: Vec3| {
        let (before, after) = (trilinear(field, at - 0.5 * axis), trilinear(field, at + 0.5 * axis));
        match (before, here, after) {
            (Some(before), _, Some(after)) => Some(after - before),
            (Some(before), Some(here), None) => Some(2.0 * (here - before)),
            (None, Some(here), Some(after)) => Some(2.0 * (after - here)),
            _ => None,
        }
    };
    let slopes = [Vec3::X, Vec3::Y, Vec3::Z].map(slope);
    let [Some(x), Some(y), Some(z)] = slopes else { return Vec3::ZERO };
    Vec3::new(x, y, z).normalize_or_zero()
}

#[cfg(test)]
mod tests {
    use schema::{Grid, VoxelGrid};

    use super::*;
    use crate::surface_cloud;

    fn field(distance_m: impl Fn(Vec3) -> f32) -> VoxelGrid {
        let grid = Grid::PAPER;
        let truncation_m = 4.0 * grid.voxel_size_m();
        let stored = |flat: usize| {
            let at = [flat / 1600, flat / 40 % 40, flat % 40];
            let tsdf = (distance_m(grid.centre_m(at)) / truncation_m).clamp(-1.0, 1.0);
            if tsdf.abs() < 0.98 { 0.5 * (tsdf + 1.0) } else { 0.0 }
        };
        VoxelGrid::new(grid, (0..grid.len()).map(stored).collect()).unwrap()
    }

    #[test]
    fn a_ball_looks_outwards_everywhere() {
        let middle = Vec3::new(0.15, 0.16, 0.14);
        let ball = field(|p| (p - middle).length() - 0.06);
        let points_m = surface_cloud(&ball, 0.0025);
        let found = normals(&ball, &points_m);
        for (point, normal) in points_m.iter().zip(&found) {
            assert!(normal.dot((*point - middle).normalize()) > 0.995, "{point}: {normal}");
        }
        assert!(found.len() > 5_000);
    }

    #[test]
    fn a_slope_has_its_own_normal_and_the_unobserved_has_none() {
        let up = Vec3::new(0.3, -0.2, 0.9).normalize();
        let slope = field(|p| up.dot(p - Vec3::splat(0.15)));
        let points_m = surface_cloud(&slope, 0.0025);
        let found = normals(&slope, &points_m);
        let near = found.iter().filter(|normal| normal.dot(up) > 0.9999).count();
        assert!(near as f32 > 0.95 * found.len() as f32, "{near} of {}", found.len());
        let far = [Vec3::new(0.15, 0.15, 0.29), Vec3::new(-0.1, 0.1, 0.1)];
        assert_eq!(normals(&slope, &far), [Vec3::ZERO; 2]);
    }
}
