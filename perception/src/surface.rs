//! The observed surface as points: where a TSDF changes sign, sampled at a uniform pitch; and other clouds thinned to
//! it.
//!
//! # The pitch
//!
//! DBSCAN's "100 points within 0.02 m" has no meaning without a density. The paper's grid (7.5 mm) has one crossing per
//! voxel on a level face, 17,800 points per square metre. A disc of 0.02 m then holds 22 points, so no point could be a
//! core point, and a cluster of 500 would be a face of 280 cm². At 2.5 mm (160,000 per square metre; the 120³ grid from
//! which VGN's robot takes its clouds) the disc holds 201 points and half a disc 100.5. Then a point on the rim of a
//! face is just a core point, and 500 points are 31 cm², the visible surface of a cube of 3 cm. Therefore clouds are
//! made at 2.5 mm. A slanted face gets up to √3 times as many points.

use rayon::prelude::*;
use schema::{Lattice, Vec3, VoxelGrid};

use crate::blocks::{Field as _, SurfaceBlocks, VOXELS, corners};

/// The surface in VGN's values: halfway between −1 and 1.
const SURFACE: f32 = 0.5;
/// Blocks that are looked at together.
const PARTS: usize = 16;
/// So far inside a cell, as a share of its side, its corners are looked at.
const INSIDE: f32 = 1e-3;

/// The surface of a TSDF in the workspace, in metres.
///
/// Between the centres of eight observed voxels the field is trilinear. Along a line parallel to an axis it is linear
/// and crosses the surface at most once. (voxel size / `pitch_m`, rounded up)² such lines run through every cell in
/// each of the three directions; the points are their crossings. (Open3D's `ExtractPointCloud` has one line, through
/// the corners.)
///
/// # Panics
/// If `pitch_m` is not above 0.
#[must_use]
pub fn surface_cloud(field: &VoxelGrid, pitch_m: f32) -> Vec<Vec3> {
    surface_beside(field, None, pitch_m)
}

/// The same without the points for which finer blocks have values.
///
/// # Panics
/// If `pitch_m` is not above 0.
#[must_use]
pub fn surface_beside(field: &VoxelGrid, finer: Option<&SurfaceBlocks>, pitch_m: f32) -> Vec<Vec3> {
    let shares = shares(&field.lattice, pitch_m);
    let slab = |i: usize| {
        let (mut points, mut row) = (Vec::new(), Row::default());
        // Most cells of things are inside of blocks as a whole.
        let is_wanted = |cell: [usize; 3]| finer.is_none_or(|finer| !is_within(finer, &field.lattice, cell));
        add_slab(&field.lattice, &field.values, i, &shares, &mut row, &mut points, is_wanted);
        if let Some(finer) = finer {
            points.retain(|point_m| !finer.has(*point_m));
        }
        points
    };
    let slabs = (0..field.lattice.counts[0].saturating_sub(1)).into_par_iter().with_min_len(4).map(slab);
    slabs.collect::<Vec<_>>().concat()
}

/// Whether blocks have values in all of a cell of another lattice that is smaller than they are.
fn is_within(blocks: &SurfaceBlocks, lattice: &Lattice, cell: [usize; 3]) -> bool {
    let first_m = lattice.centre_m(cell);
    // Corners a little inside: of blocks that only touch the cell nothing is asked.
    (0..8).all(|corner| {
        let share = |axis: usize| if corner >> axis & 1 == 0 { INSIDE } else { 1.0 - INSIDE };
        blocks.has(first_m + Vec3::new(share(0), share(1), share(2)) * lattice.voxel_size_m)
    })
}

/// The same of blocks, in their order.
///
/// # Panics
/// If `pitch_m` is not above 0.
#[must_use]
pub fn surface_of_blocks(field: &SurfaceBlocks, pitch_m: f32) -> Vec<Vec3> {
    let shares = shares(field.lattice(), pitch_m);
    let parts: Vec<(Lattice, &[f32])> = field.parts().collect();
    let of_parts = |parts: &[(Lattice, &[f32])]| {
        let (mut points, mut row) = (Vec::new(), Row::default());
        for (lattice, values) in parts {
            let is_any = |is_meant: fn(f32) -> bool| values.iter().fold(0, |any, m| any | u32::from(is_meant(*m))) != 0;
            if is_any(|value| (value > 0.0) & (value < SURFACE)) && is_any(|value| value >= SURFACE) {
                (0..VOXELS - 1).for_each(|i| add_slab(lattice, values, i, &shares, &mut row, &mut points, |_| true));
            }
        }
        points
    };
    parts.par_chunks(PARTS).map(of_parts).collect::<Vec<_>>().concat()
}

/// Where lines run through a cell, along either edge.
fn shares(lattice: &Lattice, pitch_m: f32) -> Vec<f32> {
    assert!(pitch_m > 0.0, "the pitch must be above 0 m, got {pitch_m}");
    let lines = (lattice.voxel_size_m / pitch_m - 1e-3).ceil().max(1.0) as usize;
    (0..lines).map(|line| (line as f32 + 0.5) / lines as f32).collect()
}

/// Adds the crossings in those of the cells with this x that are wanted.
fn add_slab(
    lattice: &Lattice,
    values: &[f32],
    i: usize,
    shares: &[f32],
    row: &mut Row,
    points: &mut Vec<Vec3>,
    is_wanted: impl Fn([usize; 3]) -> bool,
) {
    let [_, cells_y, cells_z] = lattice.counts.map(|count| count.saturating_sub(1));
    row.set(lattice, values, i);
    for j in 0..cells_y {
        let crossed = &row.is_crossed[j * lattice.counts[2]..][..cells_z];
        for k in (0..cells_z).filter(|k| crossed[*k] != 0 && is_wanted([i, j, *k])) {
            add_crossings(lattice, [i, j, k], &corners(values, lattice.counts, [i, j, k]), shares, points);
        }
    }
}

/// Which cells of a slab are crossed: most cells of a scene are not, and this is a quick look at them, in passes over
/// all of the slab, which the compiler vectorises.
#[derive(Default)]
struct Row {
    /// The lowest and the highest value at each place, of those around it so far.
    low: Vec<f32>,
    high: Vec<f32>,
    /// 1 if all corners of the cell were observed and the surface passes between them; nothing is meant at the last
    /// places along y and z.
    is_crossed: Vec<u8>,
}

impl Row {
    fn set(&mut self, lattice: &Lattice, values: &[f32], i: usize) {
        let [_, width, height] = lattice.counts;
        let slab = |i: usize| &values[i * width * height..][..width * height];
        let (near, far) = (slab(i), slab(i + 1));
        let both = || near.iter().zip(far);
        self.low.clear();
        self.low.extend(both().map(|(a, b)| least(*a, *b)));
        self.high.clear();
        self.high.extend(both().map(|(a, b)| most(*a, *b)));
        // With the next along y, then along z.
        for step in [height, 1] {
            let count = (width * height).saturating_sub(step);
            for at in 0..count {
                self.low[at] = least(self.low[at], self.low[at + step]);
                self.high[at] = most(self.high[at], self.high[at + step]);
            }
        }
        let crossed = |(low, high): (&f32, &f32)| u8::from((*low > 0.0) & (*low < SURFACE) & (*high >= SURFACE));
        self.is_crossed.clear();
        self.is_crossed.extend(self.low.iter().zip(&self.high).map(crossed));
    }
}

fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

fn add_crossings(lattice: &Lattice, cell: [usize; 3], corners: &[f32; 8], shares: &[f32], points: &mut Vec<Vec3>) {
    let origin_m = lattice.centre_m(cell);
    let between = |a: f32, b: f32, share: f32| a + (b - a) * share;
    for axis in 0..3 {
        // Strides of the axis and of the two across it, in `corners`.
        let [along, right, up] = [[4, 2, 1], [2, 1, 4], [1, 4, 2]][axis];
        for &u in shares {
            for &v in shares {
                let end = |first: usize| {
                    let low = between(corners[first], corners[first + right], u);
                    let high = between(corners[first + up], corners[first + up + right], u);
                    between(low, high, v)
                };
                let (start, stop) = (end(0), end(along));
                if (start < SURFACE) != (stop < SURFACE) {
                    let t = (SURFACE - start) / (stop - start);
                    let mut share = [0.0; 3];
                    share[axis] = t;
                    share[(axis + 1) % 3] = u;
                    share[(axis + 2) % 3] = v;
                    points.push(origin_m + Vec3::from_array(share) * lattice.voxel_size_m);
                }
            }
        }
    }
}

/// A cloud thinned to one point, the mean, per occupied cube of side `pitch_m`, in the order of the cubes, x slowest.
/// Points outside the workspace are dropped.
///
/// # Panics
/// If `pitch_m` is not above 0.
#[must_use]
pub fn thinned(points_m: &[Vec3], lattice: &Lattice, pitch_m: f32) -> Vec<Vec3> {
    assert!(pitch_m > 0.0, "the pitch must be above 0 m, got {pitch_m}");
    let inside = points_m.iter().filter(|point| lattice.voxel_at(**point).is_some());
    let mut by_cube: Vec<([u32; 3], Vec3)> =
        inside.map(|point| (((*point - lattice.low_m) / pitch_m).to_array().map(|x| x as u32), *point)).collect();
    // A stable sort, so that sums run in the cloud's order.
    by_cube.sort_by_key(|(cube, _)| *cube);
    by_cube
        .chunk_by(|a, b| a.0 == b.0)
        .map(|cube| cube.iter().map(|(_, point)| *point).sum::<Vec3>() / cube.len() as f32)
        .collect()
}

#[cfg(test)]
mod tests {
    use schema::Grid;

    use super::*;

    /// A field whose value is ½ plus the distance to the surface in truncations of 4 voxels, halved, cut as VGN cuts
    /// it.
    fn field(distance_m: impl Fn(Vec3) -> f32) -> VoxelGrid {
        let grid = Grid::PAPER;
        let n = grid.resolution;
        let indices = (0..grid.len()).map(|flat| [flat / (n * n), flat / n % n, flat % n]);
        let values = indices.map(|index| {
            let tsdf = distance_m(grid.centre_m(index)) / (4.0 * grid.voxel_size_m());
            if tsdf.abs() < 0.98 { (tsdf + 1.0) * 0.5 } else { 0.0 }
        });
        VoxelGrid::new(grid, values.collect()).unwrap()
    }

    #[test]
    fn a_level_plane_is_sampled_exactly_and_at_the_promised_density() {
        let points = surface_cloud(&field(|p| p.z - 0.0517), 0.0025);
        // 39 cells of 7.5 mm a side, 9 lines each.
        assert_eq!(points.len(), 39 * 39 * 9);
        for point in &points {
            assert!((point.z - 0.0517).abs() < 1e-6, "{point}");
        }
        let per_m2 = points.len() as f32 / (39.0_f32 * 0.0075).powi(2);
        assert!((per_m2 - 160_000.0).abs() < 1.0, "{per_m2}");
        let middle = Vec3::new(0.15, 0.15, 0.0517);
        let near = points.iter().filter(|p| (**p - middle).length() <= 0.02).count();
        assert!((190..215).contains(&near), "a disc of 0.02 m holds {near}");
    }

    #[test]
    fn an_oblique_plane_is_sampled_exactly_and_denser() {
        let normal = Vec3::ONE / 3.0_f32.sqrt();
        let points = surface_cloud(&field(|p| (p - Vec3::splat(0.15)).dot(normal)), 0.0025);
        for point in &points {
            assert!((*point - Vec3::splat(0.15)).dot(normal).abs() < 1e-6, "{point}");
        }
        let near = points.iter().filter(|p| (**p - Vec3::splat(0.15)).length() <= 0.05).count();
        let per_m2 = near as f32 / (core::f32::consts::PI * 0.05 * 0.05);
        assert!((per_m2 / (160_000.0 * 3.0_f32.sqrt()) - 1.0).abs() < 0.02, "{per_m2} a square metre");
    }

    #[test]
    fn a_balls_points_lie_on_the_ball() {
        let centre = Vec3::new(0.14, 0.16, 0.15);
        let points = surface_cloud(&field(|p| (p - centre).length() - 0.05), 0.0025);
        assert!(points.len() > 5_000, "{}", points.len());
        for point in &points {
            let off_m = (*point - centre).length() - 0.05;
            // A chord of a voxel in a circle of 5 cm is 0.14 mm deep.
            assert!(off_m.abs() < 0.3e-3, "{point} is off by {off_m}");
        }
        let mean = points.iter().sum::<Vec3>() / points.len() as f32;
        assert!((mean - centre).length() < 0.5e-3, "{mean}");
    }

    #[test]
    fn what_was_not_observed_has_no_surface() {
        let empty = VoxelGrid::new(Grid::PAPER, vec![0.0; Grid::PAPER.len()]).unwrap();
        assert!(surface_cloud(&empty, 0.0025).is_empty());
        let mut holed = field(|p| p.z - 0.05);
        for i in 0..20 {
            for j in 0..40 {
                for k in 0..40 {
                    holed.values[Grid::PAPER.flat([i, j, k])] = 0.0;
                }
            }
        }
        let points = surface_cloud(&holed, 0.0075);
        assert_eq!(points.len(), 19 * 39);
        assert!(points.iter().all(|p| p.x > 0.15));
    }

    #[test]
    fn thinning_leaves_one_mean_a_cube() {
        let grid = Lattice::from(Grid::PAPER);
        let pair = [Vec3::new(0.1001, 0.1, 0.1), Vec3::new(0.1011, 0.1, 0.1)];
        let outside = [Vec3::new(0.4, 0.1, 0.1), Vec3::new(-0.001, 0.1, 0.1), Vec3::splat(f32::NAN)];
        let cloud: Vec<Vec3> = pair.into_iter().chain(outside).chain([Vec3::new(0.2, 0.1, 0.1)]).collect();
        let thin = thinned(&cloud, &grid, 0.0025);
        assert_eq!(thin.len(), 2);
        assert!((thin[0] - Vec3::new(0.1006, 0.1, 0.1)).length() < 1e-6, "{}", thin[0]);
        assert_eq!(thin[1], Vec3::new(0.2, 0.1, 0.1));
    }
}
