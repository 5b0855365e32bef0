//! A map of heights: the highest point over each cell of a table, and the pieces that stand apart in it.

use core::f32::consts::TAU;

use schema::{Vec2, Vec3};

/// Side of a cell.
pub(crate) const CELL_M: f32 = 0.004;
/// Lower than this above the table is the table.
pub(crate) const FLOOR_M: f32 = 0.008;
/// Cells beside each other are of one piece if their heights differ by no more than this: sides of things are steeper.
const STEP_M: f32 = 0.012;
/// Where an image ends its surface ends up to so many cells before.
const BESIDE_CELLS: f32 = 3.0;
/// Directions from a middle.
pub(crate) const SECTORS: usize = 32;

/// The direction of a place from a middle.
pub(crate) fn sector(off: Vec2) -> usize {
    ((libm::atan2f(off.y, off.x) / TAU + 0.5) * SECTORS as f32) as usize % SECTORS
}

/// The highest point of each cell; minus infinity where nothing was seen.
#[derive(Debug)]
pub(crate) struct Heights {
    pub(crate) low: Vec2,
    pub(crate) counts: [usize; 2],
    pub(crate) top_m: Vec<f32>,
}

impl Heights {
    pub(crate) fn new(points_m: &[Vec3]) -> Self {
        let low = points_m.iter().fold(Vec2::INFINITY, |low, p| low.min(p.truncate()));
        let high = points_m.iter().fold(Vec2::NEG_INFINITY, |high, p| high.max(p.truncate()));
        let counts = ((high - low) / CELL_M).to_array().map(|cells| cells as usize + 1);
        let mut heights = Self { low, counts, top_m: vec![f32::NEG_INFINITY; counts[0] * counts[1]] };
        for point in points_m {
            let [x, y] = ((point.truncate() - low) / CELL_M).to_array().map(|cell| cell as usize);
            let top_m = &mut heights.top_m[x * counts[1] + y];
            *top_m = top_m.max(point.z);
        }
        heights
    }

    /// The cell at a place, or that of the map's border beside it.
    pub(crate) fn cell(&self, at: Vec2) -> Option<usize> {
        let last = Vec2::from_array(self.counts.map(|count| count as f32 - 1.0));
        let along = (at - self.low) / CELL_M;
        let [x, y] = along.clamp(Vec2::ZERO, last).to_array().map(|along| along as usize);
        ((along - along.clamp(Vec2::ZERO, last)).abs().max_element() < BESIDE_CELLS).then_some(x * self.counts[1] + y)
    }

    /// The middle of a cell.
    pub(crate) fn place_m(&self, cell: usize) -> Vec2 {
        self.low + (Vec2::new((cell / self.counts[1]) as f32, (cell % self.counts[1]) as f32) + 0.5) * CELL_M
    }

    /// A cell and those that are no more than `reach` cells from it along x and y.
    pub(crate) fn around(&self, cell: usize, reach: usize) -> impl Iterator<Item = usize> + use<> {
        let range = |at: usize, count: usize| at.saturating_sub(reach)..(at + reach + 1).min(count);
        let [rows, columns] = self.counts;
        let (along_x, along_y) = (range(cell / columns, rows), range(cell % columns, columns));
        along_x.flat_map(move |x| along_y.clone().map(move |y| x * columns + y))
    }
}

/// What stands apart on a table.
#[derive(Debug)]
pub struct Pieces {
    pub(crate) heights: Heights,
    pub(crate) table_z_m: f32,
    /// The cells of each.
    pub(crate) pieces: Vec<Vec<usize>>,
    /// The piece of each cell.
    pub(crate) piece_of: Vec<Option<usize>>,
}

impl Pieces {
    /// The pieces of a surface that was seen of a level table and of what stands on it; its points are finite and at
    /// most 4 mm apart.
    #[must_use]
    pub fn new(points_m: &[Vec3], table_z_m: f32) -> Self {
        let heights = Heights::new(points_m);
        let top_m = &heights.top_m;
        let (mut pieces, mut piece_of) = (Vec::new(), vec![None; top_m.len()]);
        for first in 0..top_m.len() {
            if top_m[first] <= table_z_m + FLOOR_M || piece_of[first].is_some() {
                continue;
            }
            piece_of[first] = Some(pieces.len());
            let (mut cells, mut next) = (vec![first], 0);
            while let Some(cell) = cells.get(next).copied() {
                for near in heights.around(cell, 1) {
                    let is_joined = top_m[near] > table_z_m + FLOOR_M && (top_m[near] - top_m[cell]).abs() <= STEP_M;
                    if is_joined && piece_of[near].is_none() {
                        piece_of[near] = Some(pieces.len());
                        cells.push(near);
                    }
                }
                next += 1;
            }
            pieces.push(cells);
        }
        Self { heights, table_z_m, pieces, piece_of }
    }

    /// How high a cell's highest point is above the table.
    pub(crate) fn above_m(&self, cell: usize) -> f32 {
        self.heights.top_m[cell] - self.table_z_m
    }

    /// The middles of the first and the last of some cells along x and y.
    pub(crate) fn bounds_m(&self, cells: &[usize]) -> [Vec2; 2] {
        let places = cells.iter().map(|cell| self.heights.place_m(*cell));
        places.fold([Vec2::INFINITY, Vec2::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)])
    }
}
