//! The rim of a container whose walls lean, curve or have holes: it goes all around, is about as high everywhere, and
//! inside of it the surface falls.

use core::f32::consts::TAU;

use schema::{Vec2, Vec3};

use crate::heights::{CELL_M, FLOOR_M, Pieces};
use crate::table::median;
use crate::walls::height_off_m;

/// Directions from the middle in which the rim is looked for; it is found in this share of them, and no further than so
/// many from each.
const WAYS: usize = 120;
const SHARE_MIN: f32 = 0.75;
const BESIDE_MAX: usize = 8;
/// It is no lower than this, and less wide is no container.
const HIGH_M_MIN: f32 = 0.03;
const WIDE_M_MIN: f32 = 0.22;
/// The highest cell within so many steps of a cell is the rim.
const RIM_STEPS: usize = 7;
/// Inside of it a wall comes in by no more steps than this, and rises nowhere by more than this …
const DEEP_STEPS: usize = 30;
const RISE_M: f32 = 0.004;
/// … but may have holes of so many steps.
const HOLE_STEPS: usize = 12;
/// What is so far outside of the rim belongs to it.
const OUTER_M: f32 = 0.020;

/// A rim, seen from its middle.
#[derive(Debug, Clone, PartialEq)]
pub struct Rim {
    middle: Vec2,
    /// In each direction how far it is to where the wall ends inside, and to the rim, in metres.
    ways_m: Vec<[f32; 2]>,
    /// The rim, where it was seen, in metres.
    pub edge_m: Vec<Vec3>,
}

impl Rim {
    /// Whether a point above the table belongs to the wall.
    #[must_use]
    pub fn has(&self, point_m: Vec3) -> bool {
        let (way, far_m) = way(point_m.truncate() - self.middle);
        let [inner_m, outer_m] = self.ways_m[way];
        (inner_m - CELL_M..=outer_m + OUTER_M).contains(&far_m)
    }

    /// Whether a point is outside.
    #[must_use]
    pub fn is_behind(&self, point_m: Vec3) -> bool {
        let (way, far_m) = way(point_m.truncate() - self.middle);
        far_m > self.ways_m[way][1]
    }
}

/// The direction in which a place is from the middle, and how far.
fn way(off: Vec2) -> (usize, f32) {
    (((libm::atan2f(off.y, off.x) / TAU + 0.5) * WAYS as f32) as usize % WAYS, off.length())
}

/// The highest cells of pieces from a middle outwards.
struct Profile<'a> {
    pieces: &'a Pieces,
    middle: Vec2,
    steps: Vec<Option<usize>>,
}

impl Pieces {
    /// The rim of a container, which is one piece.
    #[must_use]
    pub fn rim(&self) -> Option<Rim> {
        (0..self.pieces.len()).find_map(|piece| self.rim_of(piece))
    }

    fn rim_of(&self, own: usize) -> Option<Rim> {
        let [low, high] = self.bounds_m(&self.pieces[own]);
        if (high - low).min_element() < WIDE_M_MIN {
            return None;
        }
        let (middle, count) = (0.5 * (low + high), (0.5 * (high - low).length() / CELL_M) as usize + 2);
        let mut profiles = vec![vec![None::<usize>; count]; WAYS];
        for cell in self.pieces.iter().flatten().copied() {
            let (way, far_m) = way(self.heights.place_m(cell) - middle);
            if let Some(step) = profiles[way].get_mut((far_m / CELL_M) as usize) {
                *step = step.filter(|other| self.above_m(*other) >= self.above_m(cell)).or(Some(cell));
            }
        }
        let of_way = |steps: Vec<Option<usize>>| Profile { pieces: self, middle, steps }.rim(own);
        let mut ways: Vec<Option<(f32, usize)>> = profiles.into_iter().map(of_way).collect();
        let high_m = median(ways.iter().flatten().map(|(_, rim)| self.above_m(*rim)))?;
        for way in &mut ways {
            *way = way.filter(|(_, rim)| (self.above_m(*rim) - high_m).abs() <= height_off_m(high_m));
        }
        let far_m = |rim: usize| (self.heights.place_m(rim) - middle).length();
        let found = |way: usize| ways[way % WAYS].map(|(inner_m, rim)| [inner_m, far_m(rim)]);
        let wide_m = (0..WAYS / 2).filter_map(|way| Some(found(way)?[1] + found(way + WAYS / 2)?[1]));
        let is_wide = wide_m.fold(f32::INFINITY, f32::min) >= WIDE_M_MIN;
        let edge: Vec<usize> = ways.iter().flatten().map(|(_, rim)| *rim).collect();
        let nearest =
            |way: usize| (0..=BESIDE_MAX).find_map(|off| found(way + off).or_else(|| found(way + WAYS - off)));
        let ways_m: Vec<[f32; 2]> = (0..WAYS).map_while(nearest).collect();
        let is_closed = ways_m.len() == WAYS && edge.len() as f32 >= SHARE_MIN * WAYS as f32;
        let edge_m = edge.iter().map(|cell| self.heights.place_m(*cell).extend(self.heights.top_m[*cell])).collect();
        (is_closed && is_wide).then_some(Rim { middle, ways_m, edge_m })
    }
}

impl Profile<'_> {
    fn above_m(&self, step: usize) -> f32 {
        self.steps[step].map_or(f32::NEG_INFINITY, |cell| self.pieces.above_m(cell))
    }

    /// Whether the table was seen as far from the middle as a step, beside a cell.
    fn is_table(&self, step: usize, rim: usize) -> bool {
        let off = self.pieces.heights.place_m(rim) - self.middle;
        let at = self.middle + off * ((step as f32 + 0.5) * CELL_M / off.length());
        let cell = self.pieces.heights.cell(at, [0, 0]);
        cell.is_some_and(|cell| self.pieces.above_m(cell).abs() <= FLOOR_M)
    }

    /// How far from the middle the wall ends inside, in metres, and the cell of the rim.
    fn rim(&self, own: usize) -> Option<(f32, usize)> {
        let own = |step: &usize| self.steps[*step].is_some_and(|cell| self.pieces.piece_of[cell] == Some(own));
        let last = (0..self.steps.len()).rev().find(|step| own(step) && self.above_m(*step) >= HIGH_M_MIN)?;
        let near = (last.saturating_sub(RIM_STEPS)..=last).filter(own);
        let top = near.max_by(|a, b| self.above_m(*a).total_cmp(&self.above_m(*b)))?;
        let rim = self.steps[top]?;
        let (mut lowest_m, mut inner, mut holes, mut falls) = (self.above_m(top), top, 0, false);
        for step in (top.saturating_sub(DEEP_STEPS)..top).rev() {
            let above_m = self.above_m(step);
            if above_m > lowest_m + RISE_M {
                break;
            }
            if above_m.is_finite() {
                (lowest_m, inner, holes) = (above_m.min(lowest_m), step, 0);
                continue;
            }
            holes += 1;
            falls = holes > HOLE_STEPS || self.is_table(step, rim);
            if falls {
                break;
            }
        }
        (falls || lowest_m < 0.5 * self.above_m(top)).then_some((inner as f32 * CELL_M, rim))
    }
}

#[cfg(test)]
mod tests {
    use schema::axis_angle;

    use super::*;

    const TABLE_M: f32 = 0.05;

    /// Points 3 mm apart at which something is so high above the table, if anything is, turned.
    fn surface(turn_rad: f32, above_m: impl Fn(Vec2) -> Option<f32>) -> Vec<Vec3> {
        let place = |n: usize| Vec2::new((n / 201) as f32, (n % 201) as f32) * 0.003 - 0.3;
        let at_m = |n: usize| Some(place(n).extend(TABLE_M + above_m(place(n))?));
        let turn = axis_angle(Vec3::Z, turn_rad);
        (0..201 * 201).filter_map(at_m).map(|at_m| turn * at_m).collect()
    }

    /// A tote with round corners and a wavy rim, 70 mm high, whose walls come in by 60 mm and have holes.
    fn tote(size: f32, at: Vec2) -> Option<f32> {
        let angle = libm::atan2f(at.y, at.x);
        let fourth = |share: f32| share * share * share * share;
        let corner = fourth(libm::cosf(angle) / 0.2) + fourth(libm::sinf(angle) / 0.15);
        let rim_m = size * libm::powf(corner, -0.25) + 0.004 * libm::cosf(6.0 * angle);
        let up = (at.length() - rim_m + 0.06) / 0.06;
        let is_hole = (0.3..0.8).contains(&up) && libm::cosf(7.0 * angle) > 0.0;
        (up <= 1.0 && !is_hole).then(|| 0.07 * up.max(0.0) * up.max(0.0))
    }

    fn is_box(at: Vec2, half: [f32; 2]) -> bool {
        at.x.abs() < half[0] && at.y.abs() < half[1]
    }

    #[test]
    fn walls_that_curve_and_have_holes_are_a_rim_and_things_inside_are_not() {
        for turn_rad in [0.0, 0.7] {
            let walls = surface(turn_rad, |at| tote(1.0, at).filter(|_| !is_box(at, [0.06, 0.04])));
            let thing = surface(turn_rad, |at| is_box(at, [0.06, 0.04]).then_some(0.05));
            let rim = Pieces::new(&[walls.clone(), thing.clone()].concat(), TABLE_M).rim().unwrap();
            let walls: Vec<Vec3> = walls.into_iter().filter(|at| at.z > TABLE_M + 0.01).collect();
            let share = walls.iter().filter(|at| rim.has(**at)).count() as f32 / walls.len() as f32;
            assert!(share > 0.97, "{share}");
            assert!(!thing.iter().any(|at| rim.has(*at) || rim.is_behind(*at)));
            assert!(rim.is_behind(Vec3::new(0.4, 0.0, 0.1)) && rim.edge_m.len() > 110, "{}", rim.edge_m.len());
        }
    }

    #[test]
    fn a_bowl_a_block_and_things_around_a_place_have_no_rim() {
        let rim = |above_m: &dyn Fn(Vec2) -> f32| Pieces::new(&surface(0.0, |at| Some(above_m(at))), TABLE_M).rim();
        assert!(rim(&|at: Vec2| tote(1.0, at).unwrap_or(0.0)).is_some());
        assert_eq!(rim(&|at: Vec2| tote(0.6, at).unwrap_or(0.0)), None, "what is so small is a thing");
        assert_eq!(rim(&|at: Vec2| if is_box(at, [0.2, 0.15]) { 0.1 } else { 0.0 }), None);
        let cells = |at: Vec2| (at / 0.09 - (at / 0.09).round()) * 0.09;
        let is_thing = |at: Vec2| is_box(at, [0.2, 0.2]) && is_box(cells(at), [0.03, 0.03]);
        assert_eq!(rim(&|at: Vec2| if is_thing(at) { 0.06 } else { 0.0 }), None);
    }
}
