//! Where grasps are looked for by a judge: all that was seen above the table within reach, not a cube.

use perception::SeenPoint;
use rayon::prelude::*;
use schema::{Grid, Lattice, Vec3};

/// Cells of the table in which things are looked for.
const CELL_M: f32 = 0.02;
/// A thing is higher than this: noise of depth cameras makes the table this rough.
const THING_M: f32 = 0.01;
/// Fewest pixels or points of a thing in a cell.
const POINTS_MIN: u16 = 3;
/// Things beyond reach are seen this far away, because a gripper may touch them.
const BEYOND_M: f32 = 0.25;
/// The field reaches this far beyond things, and the table's top this far below.
const MARGIN_M: f32 = 0.1;
const BELOW_M: f32 = 0.05;

/// The box in which a gripper may touch something, and the voxels around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Region {
    /// Its lower and upper corner in the workspace, in metres.
    pub(crate) reach_m: [Vec3; 2],
    /// The voxels.
    pub(crate) lattice: Lattice,
}

impl Region {
    /// All of a grid.
    pub(crate) fn cube(grid: &Grid) -> Self {
        let lattice = Lattice::from(*grid);
        Self { reach_m: lattice.corners_m(), lattice }
    }

    /// The things among what views show above the table in a box, in voxels as a grid has them; without things that
    /// grid.
    pub(crate) fn of_views(seen: &[Vec<SeenPoint>], within_m: [Vec3; 2], grid: &Grid) -> Self {
        let of_view = |seen: &Vec<SeenPoint>| {
            let mut things = Things::new(within_m, grid);
            seen.iter().for_each(|(at_m, _)| things.add(*at_m));
            things
        };
        let things = seen.par_iter().map(of_view).reduce_with(Things::with);
        things.and_then(|things| things.region(within_m, grid)).unwrap_or_else(|| Self::cube(grid))
    }

    /// The things in a cloud.
    pub(crate) fn of_points(points_m: &[Vec3], within_m: [Vec3; 2], grid: &Grid) -> Self {
        let mut things = Things::new(within_m, grid);
        points_m.iter().for_each(|point_m| things.add(*point_m));
        things.region(within_m, grid).unwrap_or_else(|| Self::cube(grid))
    }
}

/// Cells of the table, and what stands in them.
struct Things {
    low_m: Vec3,
    counts: [usize; 2],
    heights_m: [f32; 2],
    /// Points above the table in each cell, and the highest.
    cells: Vec<(u16, f32)>,
}

impl Things {
    fn new([low_m, high_m]: [Vec3; 2], grid: &Grid) -> Self {
        let counts = [0, 1].map(|axis| ((high_m[axis] - low_m[axis] + 2.0 * BEYOND_M) / CELL_M).ceil() as usize);
        Self {
            low_m: low_m - BEYOND_M,
            counts,
            heights_m: [grid.table_z_m + THING_M, high_m.z],
            cells: vec![(0, 0.0); counts[0] * counts[1]],
        }
    }

    fn add(&mut self, point_m: Vec3) {
        let [x, y] = [0, 1].map(|axis| (point_m[axis] - self.low_m[axis]) / CELL_M);
        // False for NaN.
        let is_in = x >= 0.0 && y >= 0.0 && x < self.counts[0] as f32 && y < self.counts[1] as f32;
        if is_in && (self.heights_m[0]..self.heights_m[1]).contains(&point_m.z) {
            let (count, highest_m) = &mut self.cells[x as usize * self.counts[1] + y as usize];
            (*count, *highest_m) = (count.saturating_add(1), highest_m.max(point_m.z));
        }
    }

    fn with(mut self, other: Self) -> Self {
        for ((count, highest_m), (more, higher_m)) in self.cells.iter_mut().zip(other.cells) {
            (*count, *highest_m) = (count.saturating_add(more), highest_m.max(higher_m));
        }
        self
    }

    /// The box of the cells with things that `is_meant` takes by their middle: x and y, and the highest point.
    fn bounds_m(&self, is_meant: impl Fn(Vec3) -> bool) -> Option<[Vec3; 2]> {
        let cells = self.cells.iter().enumerate().filter(|(_, (count, _))| *count >= POINTS_MIN);
        let boxes = cells.filter_map(|(flat, (_, highest_m))| {
            let at = Vec3::new((flat / self.counts[1]) as f32, (flat % self.counts[1]) as f32, 0.0);
            let low_m = (self.low_m + at * CELL_M).with_z(*highest_m);
            is_meant(low_m + Vec3::new(0.5, 0.5, 0.0) * CELL_M)
                .then_some([low_m, low_m + Vec3::new(CELL_M, CELL_M, 0.0)])
        });
        boxes.reduce(|[low, high], [a, b]| [low.min(a), high.max(b)])
    }

    fn region(&self, [low_m, high_m]: [Vec3; 2], grid: &Grid) -> Option<Region> {
        let is_within = |at: Vec3, more_m: f32| {
            (0..2).all(|axis| (low_m[axis] - more_m..high_m[axis] + more_m).contains(&at[axis]))
        };
        let [first_m, last_m] = self.bounds_m(|at| is_within(at, 0.0))?;
        // What a gripper may touch beyond.
        let near = |at: Vec3| {
            let is_beside = (0..2).all(|axis| (first_m[axis] - BEYOND_M..last_m[axis] + BEYOND_M).contains(&at[axis]));
            is_beside && is_within(at, BEYOND_M)
        };
        let [from_m, to_m] = self.bounds_m(near)?;
        let voxel_m = grid.voxel_size_m();
        // But for rounding.
        let [low_of, high_of] = [1e-3, -1e-3].map(|off| move |along_m: f32| (along_m / voxel_m + off).floor());
        let floor_m = grid.table_z_m - BELOW_M;
        let low = [from_m.x - MARGIN_M, from_m.y - MARGIN_M, floor_m].map(low_of);
        let high = [to_m.x + MARGIN_M, to_m.y + MARGIN_M, to_m.z + MARGIN_M].map(|along_m| high_of(along_m) + 1.0);
        let lattice = Lattice {
            low_m: Vec3::from_array(low) * voxel_m,
            counts: core::array::from_fn(|axis| (high[axis] - low[axis]) as usize),
            voxel_size_m: voxel_m,
            table_z_m: grid.table_z_m,
        };
        let [low_m, high_m] = [low_m.max(first_m).with_z(floor_m), high_m.min(last_m).with_z(high_m.z)];
        Some(Region { reach_m: [low_m, high_m], lattice })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a level square.
    fn square(low_m: Vec3, side_m: f32) -> Vec<Vec3> {
        let count = (side_m / 0.004) as usize;
        (0..count * count).map(|at| low_m + Vec3::new((at / count) as f32, (at % count) as f32, 0.0) * 0.004).collect()
    }

    #[test]
    fn the_region_follows_what_stands_on_the_table() {
        let within_m = [Vec3::new(-0.45, -0.45, 0.05), Vec3::new(0.75, 0.75, 0.55)];
        let table = square(Vec3::new(-0.5, -0.5, 0.05), 1.3);
        let one = square(Vec3::new(-0.2, 0.1, 0.15), 0.06);
        // Of things beyond reach only those near others are seen; what hangs higher is not.
        let (beyond, far) = (square(Vec3::new(0.78, 0.1, 0.09), 0.05), square(Vec3::new(-0.68, 0.1, 0.09), 0.05));
        let two = square(Vec3::new(0.6, 0.1, 0.1), 0.04);
        let lamp = square(Vec3::new(0.1, 0.6, 0.7), 0.05);
        let region = |parts: &[&Vec<Vec3>]| {
            let points: Vec<Vec3> = parts.iter().flat_map(|part| part.iter().copied()).collect();
            Region::of_points(&points, within_m, &Grid::PAPER)
        };
        assert_eq!(region(&[&table, &lamp]), Region::cube(&Grid::PAPER), "nothing stands there");
        let Region { reach_m: [low, high], lattice } = region(&[&table, &one, &lamp]);
        assert!((low.x + 0.2).abs() < 0.021 && (high.x + 0.14).abs() < 0.021, "{low} {high}");
        assert!((low.y - 0.1).abs() < 0.021 && (high.y - 0.16).abs() < 0.021, "{low} {high}");
        let [first, last] = lattice.corners_m();
        assert!((low - first).truncate().min_element() > 0.099 && (last - high).truncate().min_element() > 0.099);
        assert!(first.z == 0.0 && (0.25..0.26).contains(&last.z), "{first} {last}");
        let wide = region(&[&table, &one, &two, &beyond, &far]);
        let [first, last] = wide.lattice.corners_m();
        assert!(wide.reach_m[1].x <= 0.75 && last.x > 0.92 && first.x > -0.4, "{wide:?}");
    }
}
