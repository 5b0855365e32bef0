//! What was seen apart from each other: the connected parts of a surface, each of which gets its share of candidates.

use std::collections::BTreeMap;
use std::iter::repeat_n;

use schema::{Vec3, bounds_m};

use crate::Wanted;
use crate::space::Space;

/// Side of the cubes into which points are sorted: those in cubes that touch are of one thing. Things are apart if
/// there are two sides between them, and one thing where there is none.
const CUBE_M: f32 = 0.006;
/// Most cubes along a side: wide clouds get wider cubes.
const SIDE_MAX: f32 = 200.0;
/// A thing has points in at least this many cubes, 6 cm² of it. What has fewer is noise, or too little to be held.
const CUBES_MIN: usize = 16;
/// What is longer than so many cubes are things that touch: each square of so many cubes counts as one of them.
const LONG: usize = 12;
const SQUARE: usize = 9;
/// Points of the smallest things are drawn so many times as often as without shares.
const TIMES_MAX: usize = 16;

/// A cube with points of no thing yet, and one that is about to get its thing.
const OPEN: u32 = u32::MAX;
const TAKEN: u32 = u32::MAX - 1;

/// The things of a scene; none if fewer than two are apart.
#[derive(Debug, Default)]
pub(crate) struct Things {
    low_m: Vec3,
    per_m: f32,
    counts: [usize; 3],
    /// Of each cube one more than its thing, 0 where none is.
    of_cube: Vec<u32>,
    /// How many times as often a point of each thing is drawn.
    times: Vec<usize>,
    /// The middle of what was seen of each thing.
    middles_m: Vec<Vec3>,
}

impl Things {
    /// Those among the `wanted` points of the surfaces, or all of them where there are none.
    pub(crate) fn new(space: &Space<'_>, wanted: &Wanted) -> Self {
        let points_m: Vec<Vec3> = match &wanted[0][..] {
            [] => space.surfaces[0].iter().map(|(at_m, _)| *at_m).collect(),
            wanted => wanted.iter().map(|number| space.surfaces[0][*number].0).collect(),
        };
        let things = Self::of_points(&points_m);
        if things.count() > 1 { things } else { Self::default() }
    }

    fn of_points(points_m: &[Vec3]) -> Self {
        let [low_m, high_m] = bounds_m(points_m);
        let extent_m = (high_m - low_m).max(Vec3::ZERO);
        let per_m = 1.0 / CUBE_M.max(extent_m.max_element() / SIDE_MAX);
        // One more on each side, so that each cube with points has all its neighbours.
        let counts = (extent_m * per_m).to_array().map(|along| along as usize + 3);
        let of_cube = vec![0; counts.iter().product()];
        let mut things = Self { low_m, per_m, counts, of_cube, ..Self::default() };
        let cubes: Vec<usize> = points_m.iter().filter_map(|at_m| things.cube(*at_m)).collect();
        cubes.iter().for_each(|cube| things.of_cube[*cube] = OPEN);
        let mut sizes: Vec<usize> = Vec::new();
        for cube in cubes {
            if things.of_cube[cube] == OPEN {
                let part = things.part(cube);
                things.divide(part, &mut sizes);
            }
        }
        // One half of the draws by area, the other half the same for each thing.
        let even = sizes.iter().sum::<usize>() as f32 / sizes.len().max(1) as f32;
        things.times = sizes.iter().map(|size| ((1.0 + even / *size as f32).round() as usize).min(TIMES_MAX)).collect();
        things
    }

    /// The cube of a point; `None` beyond all points.
    fn cube(&self, at_m: Vec3) -> Option<usize> {
        let at = ((at_m - self.low_m) * self.per_m).to_array();
        let [i, j, k] = [0, 1, 2].map(|axis| at[axis] as usize + 1);
        let is_inside = (0..3).all(|axis| at[axis] >= 0.0 && (at[axis] as usize) < self.counts[axis].saturating_sub(2));
        is_inside.then_some((i * self.counts[1] + j) * self.counts[2] + k)
    }

    /// The cubes with points that are connected with one of them.
    fn part(&mut self, first: usize) -> Vec<usize> {
        let [_, wide, high] = self.counts;
        let (mut part, mut done) = (vec![first], 0);
        self.of_cube[first] = TAKEN;
        while let Some(cube) = part.get(done).copied() {
            done += 1;
            let corner = cube - (wide * high + high + 1);
            for near in (0..27).map(|number| corner + number / 9 * wide * high + number / 3 % 3 * high + number % 3) {
                if self.of_cube[near] == OPEN {
                    self.of_cube[near] = TAKEN;
                    part.push(near);
                }
            }
        }
        part
    }

    /// Numbers a part, or its squares if it is long, after those whose `sizes` are known, and adds theirs, in cubes.
    fn divide(&mut self, part: Vec<usize>, sizes: &mut Vec<usize>) {
        let [_, wide, high] = self.counts;
        let along = |cube: usize| [cube / (wide * high), cube / high % wide];
        let ends = [0, 1].map(|axis| {
            let each = part.iter().map(|cube| along(*cube)[axis]);
            each.fold([usize::MAX, 0], |[first, last], at| [first.min(at), last.max(at)])
        });
        let side = if ends.iter().any(|[first, last]| last - first > LONG) { SQUARE } else { usize::MAX };
        let mut squares = BTreeMap::<[usize; 2], Vec<usize>>::new();
        for cube in part {
            let at = along(cube);
            squares.entry([0, 1].map(|axis| (at[axis] - ends[axis][0]) / side)).or_default().push(cube);
        }
        for cubes in squares.into_values() {
            let is_thing = cubes.len() >= CUBES_MIN;
            sizes.extend(is_thing.then_some(cubes.len()));
            self.middles_m.extend(is_thing.then(|| self.middle_of_m(&cubes)));
            let number = if is_thing { sizes.len() as u32 } else { 0 };
            cubes.into_iter().for_each(|cube| self.of_cube[cube] = number);
        }
    }

    /// The middle of some cubes.
    fn middle_of_m(&self, cubes: &[usize]) -> Vec3 {
        let [_, wide, high] = self.counts;
        // Cubes are counted from one before the first with points.
        let along = |cube: usize| [cube / (wide * high), cube / high % wide, cube % high].map(|at| at as f32 - 0.5);
        let sum: Vec3 = cubes.iter().map(|cube| Vec3::from_array(along(*cube))).sum();
        self.low_m + sum / (self.per_m * cubes.len() as f32)
    }

    /// The middle of what was seen of a thing.
    pub(crate) fn middle_m(&self, thing: usize) -> Vec3 {
        self.middles_m[thing]
    }

    /// How many there are; none if fewer than two are apart.
    pub(crate) fn count(&self) -> usize {
        self.times.len()
    }

    /// The thing at a point of the surface.
    pub(crate) fn at(&self, at_m: Vec3) -> Option<usize> {
        self.of_cube.get(self.cube(at_m)?)?.checked_sub(1).map(|thing| thing as usize)
    }

    /// Of the `wanted` points of the surfaces those of things, or of none, that are meant, each as many times as its
    /// thing's share says; what is wanted itself where there are no things.
    pub(crate) fn shared(
        &self,
        space: &Space<'_>,
        wanted: &Wanted,
        is_meant: impl Fn(Option<usize>) -> bool,
    ) -> Wanted {
        if self.count() == 0 {
            return wanted.clone();
        }
        [0, 1].map(|surface| {
            let (points, wanted) = (&space.surfaces[surface], &wanted[surface]);
            let all = (0..points.len()).filter(|_| wanted.is_empty()).chain(wanted.iter().copied());
            let thing = |number: usize| self.at(points[number].0);
            let meant = all.map(|number| (number, thing(number))).filter(|(_, thing)| is_meant(*thing));
            meant.flat_map(|(number, thing)| repeat_n(number, thing.map_or(1, |thing| self.times[thing]))).collect()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points on a lattice of 5 mm in a rectangle.
    fn plate(low_m: Vec3, wide: u8, deep: u8) -> Vec<Vec3> {
        let at = |n: u16| Vec3::new(f32::from(n % u16::from(wide)), f32::from(n / u16::from(wide)), 0.0) * 0.005;
        (0..u16::from(wide) * u16::from(deep)).map(|n| low_m + at(n)).collect()
    }

    #[test]
    fn things_are_apart_where_a_gap_is_between_them() {
        let (large, small) = (plate(Vec3::ZERO, 14, 14), plate(Vec3::new(0.12, 0.0, 0.0), 6, 6));
        let noise = plate(Vec3::new(0.2, 0.1, 0.1), 3, 3);
        let all = [large.clone(), small.clone(), noise.clone()].concat();
        let things = Things::of_points(&all);
        assert_eq!(things.count(), 2, "noise is no thing");
        assert!(large.iter().all(|at_m| things.at(*at_m) == Some(0)));
        assert!(small.iter().all(|at_m| things.at(*at_m) == Some(1)));
        assert!(noise.iter().all(|at_m| things.at(*at_m).is_none()));
        assert!((things.middle_m(0) - Vec3::new(0.0325, 0.0325, 0.0)).abs().max_element() < 0.004);
        assert!((things.middle_m(1) - Vec3::new(0.1325, 0.0125, 0.0)).abs().max_element() < 0.004);
        assert_eq!([Vec3::splat(-1.0), Vec3::splat(9.0)].map(|at_m| things.at(at_m)), [None; 2], "beyond all points");
        // Half of the draws by area, half the same for each: 121 to 144 cubes and 25 to 30.
        assert!(things.times[0] == 2 && (3..=5).contains(&things.times[1]), "{:?}", things.times);
        // Nearer than a cube's side they are one.
        let near = [plate(Vec3::ZERO, 8, 8), plate(Vec3::new(0.04, 0.0, 0.0), 5, 5)];
        assert_eq!(Things::of_points(&near.concat()).count(), 1);
        assert_eq!(Things::of_points(&[]).count(), 0);
    }

    #[test]
    fn what_is_long_counts_as_several_things_and_what_is_not_as_one() {
        assert_eq!(Things::of_points(&plate(Vec3::ZERO, 14, 10)).count(), 1, "65 mm");
        // 0.3 m by 0.15 m: six squares of 54 mm along it, three across it.
        assert_eq!(Things::of_points(&plate(Vec3::ZERO, 61, 31)).count(), 18);
    }
}
