//! The rim of a container whose walls lean, curve or have holes: a piece that goes all around, is about as high
//! everywhere, and hollow.

use schema::Vec3;

use crate::heights::{Pieces, SECTORS, sector};
use crate::table::median;
use crate::walls::{OUTER_M, OVER_M, WALL_M, Wall, height_off_m};

/// What is lower or less wide than this is no container.
const HIGH_M_MIN: f32 = 0.03;
const WIDE_M_MIN: f32 = 0.22;
/// The rim is about as high in so many directions from its middle …
const ALIKE_MIN: usize = 27;
/// … and in the middle, up to this share of the way to its ends, is no more than this share of the piece.
const HOLLOW: f32 = 0.5;
const INSIDE_SHARE: f32 = 0.05;

/// Two walls meet in a curve that is no wider than this.
const ROUND_M_MAX: f32 = 0.08;

/// A rim, and what is joined to it.
#[derive(Debug, Clone, PartialEq)]
pub struct Rim {
    piece: usize,
    /// The highest places in some directions, in metres.
    pub edge_m: Vec<Vec3>,
}

impl Pieces {
    /// The rim of a container, if there is one.
    #[must_use]
    pub fn rim(&self) -> Option<Rim> {
        (0..self.pieces.len()).find_map(|piece| self.rim_of(piece))
    }

    /// Whether a point above the table belongs to a rim.
    #[must_use]
    pub fn is_of(&self, rim: &Rim, point_m: Vec3) -> bool {
        self.heights.cell(point_m.truncate()).is_some_and(|cell| self.piece_of[cell] == Some(rim.piece))
    }

    fn rim_of(&self, piece: usize) -> Option<Rim> {
        let cells = &self.pieces[piece];
        let [low, high] = self.bounds_m(cells);
        if (high - low).min_element() < WIDE_M_MIN {
            return None;
        }
        let (mut tops, mut inside) = ([None::<usize>; SECTORS], 0);
        for cell in cells.iter().copied() {
            let off = (self.heights.place_m(cell) - 0.5 * (low + high)) / (0.5 * (high - low));
            let top = &mut tops[sector(off)];
            *top = top.filter(|other| self.above_m(*other) >= self.above_m(cell)).or(Some(cell));
            inside += usize::from(off.length() < HOLLOW);
        }
        let high_m = median(tops.iter().flatten().map(|top| self.above_m(*top)))?;
        let is_alike = |top: &&usize| (self.above_m(**top) - high_m).abs() <= height_off_m(high_m);
        let at_m = |top: &usize| self.heights.place_m(*top).extend(self.heights.top_m[*top]);
        let edge_m: Vec<Vec3> = tops.iter().flatten().filter(is_alike).map(at_m).collect();
        let is_hollow = inside as f32 <= INSIDE_SHARE * cells.len() as f32;
        (is_hollow && high_m >= HIGH_M_MIN && edge_m.len() >= ALIKE_MIN).then_some(Rim { piece, edge_m })
    }
}

impl Wall {
    /// Whether a point belongs to the curve in which this wall goes over into one at a right angle to it: it is nearer
    /// to the corner than the near ends of both.
    #[must_use]
    pub fn turns_into(&self, next: &Self, point_m: Vec3) -> bool {
        let gap_m = |one: &Self, other: &Self| {
            let [first, last] = one.edge_m().map(|end| other.place_m(end)[0]);
            first.min(last)
        };
        let wide_m = gap_m(self, next).max(gap_m(next, self));
        let [in_m, next_in_m] = [self, next].map(|wall| wall.place_m(point_m)[0]);
        let below_m = self.top_m - point_m.z;
        // A curve leaves the lines of its walls before these end.
        let deep_m = OUTER_M + (self.slope + next.slope) * below_m.max(0.0);
        let is_corner = self.inward.dot(next.inward).abs() < 0.1 && (WALL_M..ROUND_M_MAX).contains(&wide_m);
        is_corner && in_m.min(next_in_m) > -OUTER_M && in_m + next_in_m < wide_m + deep_m && below_m >= -OVER_M
    }
}

#[cfg(test)]
mod tests {
    use schema::{Vec2, axis_angle};

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
            let pieces = Pieces::new(&[walls.clone(), thing.clone()].concat(), TABLE_M);
            let rim = pieces.rim().unwrap();
            let walls: Vec<Vec3> = walls.into_iter().filter(|at| at.z > TABLE_M + 0.01).collect();
            let share = walls.iter().filter(|at| pieces.is_of(&rim, **at)).count() as f32 / walls.len() as f32;
            assert!(share > 0.97, "{share}");
            assert!(!thing.iter().any(|at| pieces.is_of(&rim, *at)));
            assert!(rim.edge_m.len() > 30 && rim.edge_m.iter().all(|at| at.z > TABLE_M + 0.05), "{:?}", rim.edge_m);
        }
    }

    #[test]
    fn walls_that_meet_in_a_curve_have_its_points_and_none_of_what_stands_in_the_corner() {
        let wall = |inward: Vec2, ends_m: [f32; 2]| Wall {
            inward,
            offset_m: -0.1,
            ends_m,
            top_m: 0.1,
            bottom_m: 0.0,
            slope: 0.2,
            is_seen: true,
        };
        // They stand at x = -0.1 and y = -0.1, and end 40 mm before the corner.
        let (one, next) = (wall(Vec2::X, [-0.06, 0.1]), wall(Vec2::Y, [-0.1, 0.06]));
        let curve = |angle: f32, in_m: f32, z_m: f32| {
            let way_m = Vec2::new(libm::cosf(angle), libm::sinf(angle)) * (0.04 - in_m);
            (Vec2::splat(-0.06) - way_m).extend(z_m)
        };
        for angle in [0.1, 0.5, 0.8, 1.2, 1.5] {
            for (at_m, is_wall) in [
                (curve(angle, 0.0, 0.1), true),
                (curve(angle, 0.01, 0.08), true),
                (curve(angle, 0.035, 0.08), false),
                (curve(angle, 0.0, 0.13), false),
            ] {
                assert_eq!(one.turns_into(&next, at_m), is_wall, "{at_m} at {angle}");
                assert_eq!(next.turns_into(&one, at_m), is_wall, "{at_m} at {angle}");
            }
            assert!(!one.turns_into(&one, curve(angle, 0.0, 0.1)));
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
