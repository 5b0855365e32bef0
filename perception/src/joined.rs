//! What is no thing of its own, though it stands apart on a table: what the border of an image cuts, as the arm of a
//! robot that reaches into the picture, and the table itself where its end is bent up.

use schema::{Vec2, Vec3};

use crate::heights::{CELL_M, FLOOR_M, Pieces, SECTORS, sector};

/// A piece is cut if the border takes so much of it, and it is no heap: not so broad.
const CUT_M_MIN: f32 = 0.010;
const BROAD_M: f32 = 0.15;
/// A piece is near a place within so many cells. So much of its steep sides, which are pieces of their own, is near it.
const NEAR_CELLS: usize = 2;
const SIDE_SHARE: f32 = 0.7;
/// From a bent table to the level one the cells' heights differ by no more than this, nearly all along.
const GENTLE_M: f32 = 0.0055;
const GENTLE_SHARE: f32 = 0.6;
const GENTLE_MIN: usize = 8;
/// Around a thing, so far, something is seen on all sides but where it hides the table; around the bent end of a table
/// on one side: in so many directions, in each in so many cells.
const AROUND_M: f32 = 0.08;
const SECTORS_MAX: usize = 18;
const SECTOR_CELLS: usize = 6;

/// A place at which the picture ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cut {
    /// What was seen there, in metres.
    pub at_m: Vec3,
    /// How much of it, in metres.
    pub length_m: f32,
}

/// What a point of a surface is joined to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Joined {
    /// To the table: its end is bent up.
    Table,
    /// To what is beyond the picture.
    Border,
}

impl Pieces {
    /// Of each of these points, of which the pieces are, what it is joined to, if the picture ends at `cuts`; empty if
    /// none is joined to anything.
    #[must_use]
    pub fn joined(&self, points_m: &[Vec3], cuts: &[Cut]) -> Vec<Option<Joined>> {
        let mut cut_m = vec![0.0; self.pieces.len()];
        for (piece, length_m) in cuts.iter().filter_map(|cut| Some((self.near(cut.at_m)?, cut.length_m))) {
            cut_m[piece] += length_m;
        }
        let mut joined = vec![None; self.piece_of.len()];
        for (cells, cut_m) in self.pieces.iter().zip(cut_m) {
            let [low, high] = self.bounds_m(cells);
            let width_m = cells.len() as f32 * CELL_M * CELL_M / (high - low + CELL_M).length();
            let is_cut = cut_m >= CUT_M_MIN && width_m <= BROAD_M;
            let of = if is_cut { Some(Joined::Border) } else { self.is_bent(cells).then_some(Joined::Table) };
            cells.iter().for_each(|cell| joined[*cell] = of);
        }
        if joined.iter().all(Option::is_none) {
            return Vec::new();
        }
        let beside = |cell: &usize| self.heights.around(*cell, NEAR_CELLS).filter_map(|near| joined[near]).max();
        let of_side = |cells: &Vec<usize>| {
            let near: Vec<Joined> = cells.iter().filter_map(beside).collect();
            near.iter().copied().max().filter(|_| near.len() as f32 >= SIDE_SHARE * cells.len() as f32)
        };
        let of_pieces: Vec<Option<Joined>> = self.pieces.iter().map(of_side).collect();
        let of = |at_m: &Vec3| of_pieces[self.piece_of[self.heights.cell(at_m.truncate())?]?];
        points_m.iter().map(|at_m| of(at_m).filter(|_| at_m.z > self.table_z_m + 0.5 * FLOOR_M)).collect()
    }

    /// The piece near a place, the one whose height is most like.
    fn near(&self, at_m: Vec3) -> Option<usize> {
        let around = self.heights.around(self.heights.cell(at_m.truncate())?, NEAR_CELLS);
        let off_m = |cell: usize| (self.heights.top_m[cell] - at_m.z).abs();
        let of_pieces = around.filter(|cell| self.piece_of[*cell].is_some());
        self.piece_of[of_pieces.min_by(|a, b| off_m(*a).total_cmp(&off_m(*b)))?]
    }

    /// Whether a piece rises gently from the table, and beyond it nothing is seen.
    fn is_bent(&self, cells: &[usize]) -> bool {
        let (mut gentle, mut feet) = (0, 0);
        for cell in cells {
            for foot in self.heights.around(*cell, 1).filter(|near| self.above_m(*near).abs() <= FLOOR_M) {
                feet += 1;
                gentle += usize::from(self.above_m(*cell) - self.above_m(foot) <= GENTLE_M);
            }
        }
        let ([low, high], own) = (self.bounds_m(cells), self.piece_of[cells[0]]);
        let middle = cells.iter().map(|cell| self.heights.place_m(*cell)).sum::<Vec2>() / cells.len() as f32;
        let reach_m = 0.5 * (high - low).length() + AROUND_M;
        if feet < GENTLE_MIN || (gentle as f32) < GENTLE_SHARE * feet as f32 {
            return false;
        }
        let (mut seen, reach) = ([0; SECTORS], (reach_m / CELL_M) as usize);
        let around = self.heights.cell(middle).into_iter().flat_map(|cell| self.heights.around(cell, reach));
        for near in around.filter(|near| self.piece_of[*near] != own && self.above_m(*near) >= -FLOOR_M) {
            seen[sector(self.heights.place_m(near) - middle)] += 1;
        }
        seen.iter().filter(|count| **count >= SECTOR_CELLS).count() <= SECTORS_MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE_M: f32 = 0.05;

    /// Points 3 mm apart over a rectangle, so high above the table.
    fn sheet(low: [f32; 2], high: [f32; 2], above_m: impl Fn(Vec2) -> f32) -> Vec<Vec3> {
        let (low, size) = (Vec2::from_array(low), Vec2::from_array(high) - Vec2::from_array(low));
        let [columns, rows] = (size / 0.003).to_array().map(|count| count.round() as usize + 1);
        let place = |n: usize| low + Vec2::new((n / rows) as f32, (n % rows) as f32) * 0.003;
        (0..columns * rows).map(|n| place(n).extend(TABLE_M + above_m(place(n)))).collect()
    }

    /// The share of these points that are joined so, in a surface of them and of others.
    fn share(points_m: &[Vec3], others: &[Vec<Vec3>], cuts: &[Cut], joined: Joined) -> f32 {
        let all_m = [points_m, &others.concat()[..]].concat();
        let found = Pieces::new(&all_m, TABLE_M).joined(&all_m, cuts);
        found.iter().take(points_m.len()).filter(|of| **of == Some(joined)).count() as f32 / points_m.len() as f32
    }

    /// The border of a picture at this x, every 2 mm.
    fn border(x_m: f32, [from_m, to_m]: [f32; 2], above_m: f32) -> Vec<Cut> {
        let count = ((to_m - from_m) / 0.002) as usize;
        let at_m = |n: usize| Vec3::new(x_m, from_m + n as f32 * 0.002, TABLE_M + above_m);
        (0..count).map(|n| Cut { at_m: at_m(n), length_m: 0.002 }).collect()
    }

    #[test]
    fn an_arm_is_cut_and_neither_the_thing_beside_it_nor_a_heap() {
        let table = sheet([-0.3, -0.2], [0.3, 0.3], |_| 0.0);
        let arm = sheet([-0.3, 0.10], [0.05, 0.16], |_| 0.06);
        let thing = sheet([0.0, 0.17], [0.05, 0.22], |_| 0.03);
        // The surface ends 5 mm before the border.
        let cuts = border(-0.305, [0.10, 0.16], 0.06);
        let of = |points: &[Vec3], others: &[Vec<Vec3>]| share(points, others, &cuts, Joined::Border);
        assert_eq!(of(&arm, &[table.clone(), thing.clone()]), 1.0);
        assert_eq!(of(&thing, &[table.clone(), arm.clone()]), 0.0);
        assert_eq!(of(&table, core::slice::from_ref(&arm)), 0.0);
        assert_eq!(share(&arm, &[table.clone(), thing], &cuts[..4], Joined::Border), 0.0, "8 mm are no cut");
        assert_eq!(of(&sheet([-0.3, -0.15], [0.1, 0.25], |_| 0.06), &[table]), 0.0);
    }

    #[test]
    fn the_end_of_a_table_that_is_bent_up_is_the_table_and_what_rises_amid_it_is_not() {
        let (middle, corner) = (Vec2::splat(0.12), Vec2::new(0.4, 0.3));
        let corner_m = |at: Vec2| (0.6 * ((at - corner).element_sum() / 2.0_f32.sqrt() + 0.1)).max(0.0);
        let edge_m = |at: Vec2| (0.7 * (at.x - 0.33)).max(0.0);
        let mound_m = |at: Vec2| (0.03 * (1.0 - at.distance_squared(middle) / 0.0064)).max(0.0);
        for bent_m in [&corner_m as &dyn Fn(Vec2) -> f32, &edge_m] {
            let table = sheet([0.0; 2], corner.to_array(), |at| bent_m(at).max(mound_m(at)));
            let [bent, mound] = [bent_m, &mound_m].map(|above_m| {
                let is_it = |at: &&Vec3| above_m(at.truncate()) > 0.012;
                table.iter().filter(is_it).copied().collect::<Vec<Vec3>>()
            });
            let thing = sheet([0.25, 0.05], [0.29, 0.09], |_| 0.04);
            let of = |points: &[Vec3]| share(points, &[table.clone(), thing.clone()], &[], Joined::Table);
            assert_eq!([of(&bent), of(&mound), of(&thing)], [1.0, 0.0, 0.0]);
        }
    }
}
