//! The walls of a bin, a tray or a shelf among the points of a surface.
//!
//! A wall is a straight and thin ridge: lower on both sides, and about as high all along. One ridge may be a book or a
//! handle. Two that face each other and are as long, three at right angles that meet, or two tall ones, enclose a
//! floor, and no object's width lies between them. The other walls are what was seen there, or where a board ends.

mod sides;

use core::f32::consts::{FRAC_PI_2, PI};

use schema::{Vec2, Vec3};

use crate::heights::{CELL_M, FLOOR_M, Heights};
use crate::table::median;
use sides::{below, board, completed, corner, enclosing};

/// Walls are compared up to this height above the table: of higher ones a view shows more here and less there.
const TALL_M: f32 = 0.10;
/// Beside a ridge it is lower by this …
const LOWER_M: f32 = 0.010;
/// … in these cells on both sides, 16 to 24 mm from it, along one of so many directions.
const BESIDE_CELLS: [f32; 3] = [4.0, 5.0, 6.0];
const DIRECTIONS: usize = 8;
/// Fewer cells are no wall.
const CELLS_MIN: usize = 40;
/// A ridge is as wide as its row of cells and so many on each side.
const ROW_CELLS: usize = 2;
/// Along a ridge it is looked at in steps, of which no more than this many are missing in a row.
const STEP_M: f32 = 0.008;
const GAP_STEPS: usize = 6;
/// Shortest ridge, and the least share of its steps that are seen.
const RIDGE_M_MIN: f32 = 0.10;
const SEEN_SHARE_MIN: f32 = 0.6;
/// Heights along a ridge, and those of a container's walls, differ by less than this, or than this share of the height.
const HEIGHT_OFF_M: f32 = 0.012;
const HEIGHT_OFF_SHARE: f32 = 0.3;
/// Of parallel ridges that are nearer than this only one counts.
const APART_M: f32 = 0.02;
/// Walls meet within this.
const CORNER_M: f32 = 0.03;
/// Less is no container: between walls, from a wall to the one across, and the seen length of all.
const INNER_M_MIN: f32 = 0.15;
const DEPTH_M_MIN: f32 = 0.10;
const LENGTH_M_MIN: f32 = 0.45;
/// A wall's edge was seen if this share of it was.
const EDGE_SHARE_MIN: f32 = 0.5;
/// Least part of a wall that lies between those that it connects.
const CONNECTED_SHARE: f32 = 0.6;
/// A wall's points are this near to it, and on its outer side so near.
pub(crate) const WALL_M: f32 = 0.008;
pub(crate) const OUTER_M: f32 = 0.020;
/// So far over its upper edge it may still be the wall: heights along it differ.
pub(crate) const OVER_M: f32 = 0.5 * HEIGHT_OFF_SHARE * TALL_M;
/// Walls lean outwards by at most this many metres a metre, tried in such steps.
const SLOPES: usize = 22;
const SLOPE_STEP: f32 = 0.025;
const SLOPE_MAX: f32 = SLOPES as f32 * SLOPE_STEP;
/// What hangs has nothing below it for this long.
const HANGING_M: f32 = 0.02;
/// Behind a wall, up to this far, nothing is to be had.
const BEHIND_M: f32 = 0.08;
/// So many points are seen through a wall that does not stand.
const THROUGH_MIN: usize = 100;

/// A wall of a container.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wall {
    /// From the wall into the container, level and of length 1; the wall runs along it turned to the left.
    pub inward: Vec2,
    /// Where the upper edge lies along `inward`, in metres.
    pub offset_m: f32,
    /// The ends of the wall along its own direction, in metres.
    pub ends_m: [f32; 2],
    /// Height of its upper edge in the cloud's frame, in metres.
    pub top_m: f32,
    /// Height of its lower edge, as far as it was seen without a gap; of a side that is open that of the upper one.
    pub bottom_m: f32,
    /// How far it comes inwards below that edge, in metres a metre.
    pub slope: f32,
    /// Whether most of its upper edge was seen; otherwise a board may lie there of which too little was seen.
    pub is_seen: bool,
}

impl Wall {
    /// How far a point is inwards of the upper edge, and where it is along the wall, in metres.
    pub(crate) fn place_m(&self, point_m: Vec3) -> [f32; 2] {
        let at = point_m.truncate();
        [at.dot(self.inward) - self.offset_m, at.dot(self.inward.perp())]
    }

    /// Whether a place along the wall is between its ends, or no further beyond one than this.
    fn is_along(&self, along_m: f32, beyond_m: f32) -> bool {
        along_m >= self.ends_m[0] - beyond_m && along_m <= self.ends_m[1] + beyond_m
    }

    /// Whether a point belongs to the wall.
    #[must_use]
    pub fn has(&self, point_m: Vec3) -> bool {
        let ([in_m, along_m], below_m) = (self.place_m(point_m), self.top_m - point_m.z);
        let is_deep = in_m >= -OUTER_M && in_m <= self.slope * below_m.max(0.0) + WALL_M;
        self.is_along(along_m, WALL_M) && is_deep && below_m >= -OVER_M
    }

    /// Whether a point is behind the wall and near it, where flaps and frames are.
    #[must_use]
    pub fn is_behind(&self, point_m: Vec3) -> bool {
        let [in_m, along_m] = self.place_m(point_m);
        self.is_along(along_m, BEHIND_M) && (-BEHIND_M..0.0).contains(&in_m)
    }

    /// The front edge of a board that lies behind it, if it hangs over the table: an eye sees points between it and
    /// other walls through where it would be if it stood, however it leaned. If little of its edge was seen, as of a
    /// thin one or where the image ends below it, the board is over all that was seen, unless that is too high for
    /// these walls; it is seen if anything but walls was seen there.
    #[must_use]
    pub fn board(&self, walls: &[Self], points_m: &[Vec3], eyes_m: &[Vec3], table_z_m: f32) -> Option<Self> {
        (self.bottom_m > table_z_m + TALL_M).then_some(())?;
        let depth_m = walls.iter().flat_map(Self::edge_m).map(|at| self.place_m(at)[0]).fold(0.0, f32::max);
        // The heights of a line of sight at the wall and a little behind it.
        let through = |eye_m: Vec3, point_m: Vec3| {
            let [[before_m, _], [behind_m, _]] = [eye_m, point_m].map(|point_m| self.place_m(point_m));
            let at = |in_m: f32| eye_m.lerp(point_m, (before_m - in_m) / (before_m - behind_m));
            // Before the foot of a wall that leans outwards one sees ground under its edge.
            let nearest_m = OUTER_M + SLOPE_MAX * (self.top_m - point_m.z).max(0.0);
            // From above one sees the board's own top.
            let is_low = point_m.z < if eye_m.z < self.bottom_m { self.top_m } else { self.bottom_m };
            let is_in = is_low && (nearest_m..depth_m + OUTER_M).contains(&behind_m);
            (before_m < 0.0 && is_in && self.is_along(self.place_m(at(0.0))[1], 0.0))
                .then(|| [at(0.0).z, at(OUTER_M).z])
        };
        let lines = eyes_m.iter().flat_map(|eye_m| points_m.iter().filter_map(|point_m| through(*eye_m, *point_m)));
        let mut lines_m: Vec<[f32; 2]> = lines.collect();
        let below = lines_m.iter().filter(|[at_m, _]| *at_m < self.bottom_m - OUTER_M).count();
        if below < THROUGH_MIN {
            return None;
        }
        if self.is_seen {
            return Some(*self);
        }
        lines_m.sort_unstable_by(|a, b| b[1].total_cmp(&a[1]));
        let bottom_m = lines_m[THROUGH_MIN - 1][1];
        let board = Self { bottom_m, top_m: self.top_m.max(bottom_m), ..*self };
        let is_of_it = |at: &&Vec3| board.is_board(**at) && !walls.iter().any(|wall| wall.has(**at));
        let is_seen = points_m.iter().filter(is_of_it).count() >= THROUGH_MIN;
        (bottom_m < self.top_m + OUTER_M).then_some(Self { is_seen, ..board })
    }

    /// The ends of its upper edge, in metres.
    #[must_use]
    pub fn edge_m(&self) -> [Vec3; 2] {
        self.ends_m.map(|end_m| (self.offset_m * self.inward + end_m * self.inward.perp()).extend(self.top_m))
    }

    /// Whether a point is no lower than the wall's lower edge.
    fn is_level_with(&self, point_m: Vec3) -> bool {
        point_m.z > self.bottom_m - WALL_M
    }

    /// Points all over the inner side of a wall that stands on a table.
    pub fn face_m(&self, table_z_m: f32) -> impl Iterator<Item = Vec3> + '_ {
        let [along, up] = [self.ends_m[1] - self.ends_m[0], self.top_m - table_z_m];
        let [columns, rows] = [along, up].map(|side_m| (side_m / CELL_M).max(0.0) as usize);
        (0..columns * rows).map(move |cell| {
            let along_m = self.ends_m[0] + ((cell / rows) as f32 + 0.5) * CELL_M;
            let below_m = ((cell % rows) as f32 + 0.5) * CELL_M;
            let at = (self.offset_m + self.slope * below_m) * self.inward + along_m * self.inward.perp();
            at.extend(self.top_m - below_m)
        })
    }

    /// Whether a point is of the board behind this edge.
    #[must_use]
    pub fn is_board(&self, point_m: Vec3) -> bool {
        let [in_m, along_m] = self.place_m(point_m);
        let is_in = in_m >= -OUTER_M && self.is_along(along_m, OUTER_M);
        is_in && self.is_level_with(point_m) && point_m.z < self.top_m + LOWER_M
    }

    /// Whether a point is where the board is, or over it, behind this edge.
    #[must_use]
    pub fn is_over(&self, point_m: Vec3) -> bool {
        self.is_level_with(point_m) && self.place_m(point_m)[0] > 0.0
    }
}

/// The walls that enclose a floor, those of which most was seen, or none if there is no such container. Two or three of
/// them are ridges, the others what was seen as high where those end.
/// `points_m` are a surface above and on a level table, at most 4 mm apart where it was seen.
#[must_use]
pub fn walls(points_m: &[Vec3], table_z_m: f32) -> Vec<Wall> {
    let above_m: Vec<Vec3> = points_m.iter().copied().filter(|point| point.z > table_z_m + FLOOR_M).collect();
    let whole = Heights::new(&above_m);
    let board = board(&whole, points_m, table_z_m);
    let below_m = |z_m: f32| -> Vec<Vec3> { above_m.iter().copied().filter(|at| at.z < z_m).collect() };
    let heights = board.as_ref().map_or(whole, |board_m| Heights::new(&below_m(board_m[0].z - OUTER_M)));
    let cells_m = heights.ridges(table_z_m + TALL_M);
    if cells_m.len() < CELLS_MIN {
        return Vec::new();
    }
    let axes = direction(&cells_m);
    let mut ridges: Vec<Ridge> = (0..2).flat_map(|axis| along(&cells_m, axes, axis, table_z_m)).collect();
    ridges.sort_by_key(|ridge| core::cmp::Reverse(ridge.cells));
    let mut kept: Vec<Ridge> = Vec::new();
    for ridge in ridges {
        if !kept.iter().any(|better| better.is_beside(&ridge)) {
            kept.push(ridge);
        }
    }
    let mut sides =
        board.map_or_else(|| enclosing(&kept, table_z_m), |cells_m| below(&cells_m, &kept, axes, table_z_m));
    if sides.is_empty() {
        sides = corner(&kept, axes, points_m, table_z_m);
    }
    let sides = completed(sides);
    let middle = |axis: usize| {
        let across = sides.iter().filter(|side| side.axis == axis).map(|side| side.offset_m);
        let along = sides.iter().filter(|side| side.axis != axis).flat_map(|side| side.ends_m);
        let all: Vec<f32> = across.chain(along).collect();
        all.iter().sum::<f32>() / all.len() as f32
    };
    let inside = [middle(0), middle(1)];
    let wall = |side: &Ridge| side.wall(axes, inside[side.axis], &above_m, table_z_m);
    let (seen, ends): (Vec<Ridge>, Vec<Ridge>) = sides.iter().partition(|side| side.cells > 0);
    let mut walls: Vec<Wall> = seen.iter().map(|side| Wall { is_seen: true, ..wall(side) }).collect();
    let lowest_m = walls.iter().fold(f32::INFINITY, |lowest_m, wall| lowest_m.min(wall.top_m));
    let of = |side: &Ridge| {
        let wall = wall(side);
        let top_m = wall.top_m.min(table_z_m + TALL_M);
        let is_alike = (top_m - side.top_m).abs() < height_off_m(side.top_m - table_z_m);
        match (is_alike, !wall.is_seen && lowest_m > table_z_m + TALL_M) {
            (_, false) => is_alike.then_some(Wall { is_seen: true, ..wall }),
            // Walls that stand open in front may carry a board.
            (true, true) => Some(Wall { bottom_m: lowest_m.min(wall.top_m) - CELL_M, ..wall }),
            (false, true) => Some(Wall { bottom_m: lowest_m, top_m: lowest_m, ..wall }),
        }
    };
    walls.extend(ends.iter().filter_map(of));
    walls
}

impl Heights {
    fn at(&self, cell: Vec2) -> f32 {
        let [x, y] = cell.round().to_array();
        let is_inside = x >= 0.0 && y >= 0.0 && (x as usize) < self.counts[0] && (y as usize) < self.counts[1];
        if is_inside { self.top_m[x as usize * self.counts[1] + y as usize] } else { f32::NEG_INFINITY }
    }

    /// The middles of the cells that are ridges, no higher than `tall_z_m`.
    fn ridges(&self, tall_z_m: f32) -> Vec<Vec3> {
        let directions: Vec<Vec2> = (0..DIRECTIONS)
            .map(|turn| {
                let (sin, cos) = libm::sincosf(PI * turn as f32 / DIRECTIONS as f32);
                Vec2::new(cos, sin)
            })
            .collect();
        let mut found = Vec::new();
        for (index, top_m) in self.top_m.iter().enumerate().filter(|(_, top_m)| top_m.is_finite()) {
            let cell = Vec2::new((index / self.counts[1]) as f32, (index % self.counts[1]) as f32);
            let z = top_m.min(tall_z_m);
            let is_lower = |way: Vec2| BESIDE_CELLS.iter().all(|far| self.at(cell + way * *far) < z - LOWER_M);
            if directions.iter().any(|way| is_lower(*way) && is_lower(-*way)) {
                found.push((self.low + (cell + 0.5) * CELL_M).extend(z));
            }
        }
        found
    }
}

/// Two level directions at right angles along which most cells lie in rows: where the histogram of their offsets has
/// its highest peaks.
fn direction(cells_m: &[Vec3]) -> [Vec2; 2] {
    let axes = |angle: f32| {
        let (sin, cos) = libm::sincosf(angle);
        [Vec2::new(cos, sin), Vec2::new(-sin, cos)]
    };
    let peaks = |angle: f32| -> u64 {
        let squares = axes(angle).map(|axis| {
            let offsets = || cells_m.iter().map(|cell| cell.truncate().dot(axis));
            let (low, high) = offsets().fold((f32::MAX, f32::MIN), |(low, high), at| (low.min(at), high.max(at)));
            let mut rows = vec![0_u64; ((high - low) / CELL_M) as usize + 1];
            offsets().for_each(|at| rows[((at - low) / CELL_M) as usize] += 1);
            rows.iter().map(|count| count * count).sum::<u64>()
        });
        squares[0] + squares[1]
    };
    // The first of equals, so that a bin along the axes is along the axes.
    let best = |angles: Vec<f32>| {
        let scored = angles.into_iter().map(|angle| (peaks(angle), angle));
        scored.reduce(|best, next| if next.0 > best.0 { next } else { best }).map_or(0.0, |(_, angle)| angle)
    };
    let about = best((0..60).map(|step| FRAC_PI_2 * step as f32 / 60.0).collect());
    axes(best(
        [0, 1, -1, 2, -2, 3, -3, 4, -4, 5, -5, 6, -6].map(|step| about + FRAC_PI_2 * step as f32 / 360.0).to_vec(),
    ))
}

/// A straight row of cells.
#[derive(Debug, Clone, Copy)]
struct Ridge {
    /// Which of the two directions it lies across.
    axis: usize,
    offset_m: f32,
    /// Its ends along the other direction.
    ends_m: [f32; 2],
    /// Height of its cells, up to [`TALL_M`] above the table.
    top_m: f32,
    cells: usize,
    /// How much of it was seen.
    seen_m: f32,
}

/// The ridges across one of two directions.
fn along(cells_m: &[Vec3], axes: [Vec2; 2], axis: usize, table_z_m: f32) -> Vec<Ridge> {
    let [across, along] = [axes[axis], axes[1 - axis]];
    let places: Vec<[f32; 3]> =
        cells_m.iter().map(|cell| [cell.truncate().dot(across), cell.truncate().dot(along), cell.z]).collect();
    let low = |part: usize| places.iter().fold(f32::MAX, |low, place| low.min(place[part]));
    let (low_m, start_m) = (low(0), low(1));
    let row_of = |place: &[f32; 3]| ((place[0] - low_m) / CELL_M) as usize;
    let mut rows: Vec<Vec<[f32; 3]>> = vec![Vec::new(); places.iter().map(row_of).max().map_or(0, |row| row + 1)];
    places.iter().for_each(|place| rows[row_of(place)].push(*place));
    let ridge = |row: usize| {
        let near = rows[row.saturating_sub(ROW_CELLS)..rows.len().min(row + ROW_CELLS + 1)].concat();
        let mut steps: Vec<f32> = Vec::new();
        for place in &near {
            let step = ((place[1] - start_m) / STEP_M) as usize;
            steps.resize(steps.len().max(step + 1), f32::NEG_INFINITY);
            steps[step] = steps[step].max(place[2]);
        }
        let offset_m = median(near.iter().map(|place| place[0]))?;
        let top_m = median(steps.iter().copied().filter(|top_m| top_m.is_finite()))?;
        let alike = |top: &f32| (top - top_m).abs() <= height_off_m(top_m - table_z_m);
        let (first, last, seen) = longest_run(steps.iter().map(alike))?;
        let (length_m, seen_m) = ((last + 1 - first) as f32 * STEP_M, seen as f32 * STEP_M);
        let ends_m = [first, last + 1].map(|step| start_m + step as f32 * STEP_M);
        let is_long = length_m >= RIDGE_M_MIN && seen_m >= SEEN_SHARE_MIN * length_m;
        is_long.then_some(Ridge { axis, offset_m, ends_m, top_m, cells: near.len(), seen_m })
    };
    (0..rows.len()).filter_map(ridge).collect()
}

/// By how much walls of about this height differ.
pub(crate) fn height_off_m(height_m: f32) -> f32 {
    HEIGHT_OFF_M.max(HEIGHT_OFF_SHARE * height_m)
}

/// The lowest and the highest of the heights that lie above the first gap from the top.
fn upper_run(heights_m: &mut [f32]) -> Option<[f32; 2]> {
    heights_m.sort_unstable_by(|a, b| b.total_cmp(a));
    let top_m = *heights_m.first()?;
    let bottom_m =
        heights_m.windows(2).find(|pair| pair[0] - pair[1] > HANGING_M).map_or(heights_m.last()?, |pair| &pair[0]);
    Some([*bottom_m, top_m])
}

/// First and last of the steps that are seen with no gap above [`GAP_STEPS`], and their number: of the run that has
/// most.
fn longest_run(is_seen: impl Iterator<Item = bool>) -> Option<(usize, usize, usize)> {
    let mut runs: Vec<(usize, usize, usize)> = Vec::new();
    for (step, _) in is_seen.enumerate().filter(|(_, is_seen)| *is_seen) {
        match runs.last_mut() {
            Some((_, last, seen)) if step - *last <= GAP_STEPS => (*last, *seen) = (step, *seen + 1),
            _ => runs.push((step, step, 1)),
        }
    }
    runs.into_iter().reduce(|best, next| if next.2 > best.2 { next } else { best })
}

impl Ridge {
    /// Whether another runs next to it, at most a wall's width away.
    fn is_beside(&self, other: &Self) -> bool {
        self.axis == other.axis
            && (self.offset_m - other.offset_m).abs() <= APART_M
            && self.ends_m[0].max(other.ends_m[0]) <= self.ends_m[1].min(other.ends_m[1])
    }

    fn is_as_high(&self, other: &Self, table_z_m: f32) -> bool {
        (self.top_m - other.top_m).abs() < height_off_m(other.top_m - table_z_m)
    }

    /// Whether both begin and end at the same places.
    fn is_as_long(&self, other: &Self) -> bool {
        self.ends_m.iter().zip(other.ends_m).all(|(one, other)| (one - other).abs() < CORNER_M)
    }

    /// On which side of a ridge across it lies, 1 or -1.
    fn side_of(&self, across: &Self) -> f32 {
        (0.5 * (self.ends_m[0] + self.ends_m[1]) - across.offset_m).signum()
    }

    /// How much of it lies between two offsets.
    fn between_m(&self, [from_m, to_m]: [f32; 2]) -> f32 {
        self.ends_m[1].min(to_m) - self.ends_m[0].max(from_m)
    }

    /// The wall whose upper edge it is. `inside_m` is an offset in the container.
    fn wall(&self, axes: [Vec2; 2], inside_m: f32, points_m: &[Vec3], table_z_m: f32) -> Wall {
        let sign = if inside_m < self.offset_m { -1.0 } else { 1.0 };
        let inward = sign * axes[self.axis];
        // The other direction is to the left of the first, and to the right of the second.
        let turn = sign * if self.axis == 0 { 1.0 } else { -1.0 };
        let mut ends_m = self.ends_m.map(|end| turn * end);
        ends_m.sort_unstable_by(f32::total_cmp);
        let offset_m = sign * self.offset_m;
        let (top_m, bottom_m, slope, is_seen) = (f32::MAX, f32::MIN, 0.0, true);
        let mut wall = Wall { inward, offset_m, ends_m, top_m, bottom_m, slope, is_seen };
        let edge: Vec<&Vec3> = points_m.iter().filter(|point| wall.has(**point)).collect();
        let (from_m, steps) = (ends_m[0] - WALL_M, ((ends_m[1] - ends_m[0] + 2.0 * WALL_M) / STEP_M) as usize + 1);
        let mut columns = vec![Vec::new(); steps];
        for point in &edge {
            let step = ((point.truncate().dot(inward.perp()) - from_m) / STEP_M).max(0.0) as usize;
            columns[step.min(steps - 1)].push(point.z);
        }
        let spans: Vec<[f32; 2]> = columns.iter_mut().filter_map(|heights_m| upper_run(heights_m)).collect();
        let least_m = self.top_m - height_off_m(self.top_m - table_z_m);
        wall.is_seen = spans.iter().filter(|span| span[1] > least_m).count() as f32 >= EDGE_SHARE_MIN * steps as f32;
        let middle = |end: usize| median(spans.iter().map(|span| span[end]));
        wall.bottom_m = middle(0).unwrap_or(self.top_m);
        wall.top_m = middle(1).unwrap_or(self.top_m);
        let is_upper = |point: &&&Vec3| wall.top_m - point.z < LOWER_M;
        let upper = edge.iter().filter(is_upper).map(|point| point.truncate().dot(inward));
        wall.offset_m = median(upper).unwrap_or(wall.offset_m);
        let widest = Wall { slope: SLOPE_MAX, ..wall };
        let near = points_m.iter().filter(|point| widest.has(**point) && point.z < wall.top_m);
        let near_m: Vec<[f32; 2]> = near.map(|point| [wall.place_m(*point)[0], wall.top_m - point.z]).collect();
        let on_it =
            |slope: f32| near_m.iter().filter(|[in_m, below_m]| (in_m - slope * below_m).abs() <= 0.5 * WALL_M).count();
        let slopes = (0..SLOPES).map(|step| step as f32 * SLOPE_STEP).map(|slope| (on_it(slope), slope));
        wall.slope = slopes.reduce(|best, next| if next.0 > best.0 { next } else { best }).map_or(0.0, |(_, s)| s);
        wall
    }
}

#[cfg(test)]
mod tests {
    use schema::axis_angle;

    use super::*;

    const TABLE_M: f32 = 0.05;

    /// Points 3 mm apart on an upright rectangle from a point.
    fn sheet(from: Vec3, along: Vec3, up: Vec3) -> impl Iterator<Item = Vec3> {
        let [columns, rows] = [along, up].map(|side| (side.length() / 0.003) as usize);
        (0..=columns * (rows + 1) + rows).map(move |n| {
            let (column, row) = (n / (rows + 1), n % (rows + 1));
            from + along * (column as f32 / columns as f32) + up * (row as f32 / rows.max(1) as f32)
        })
    }

    /// A bin of 0.24 by 0.20 m, 0.06 m high, with walls that lean outwards; some of its four sides.
    fn bin(sides: usize, slope: f32) -> Vec<Vec3> {
        let corners = [[0.0, 0.0], [0.24, 0.0], [0.24, 0.20], [0.0, 0.20]].map(|[x, y]| Vec3::new(x, y, TABLE_M));
        let middle = Vec3::new(0.12, 0.10, TABLE_M);
        let wall = |side: usize| {
            let (from, to) = (corners[side], corners[(side + 1) % 4]);
            let outward = (0.5 * (from + to) - middle).normalize();
            sheet(from, to - from, 0.06 * (Vec3::Z + slope * outward))
        };
        (0..sides).flat_map(wall).collect()
    }

    /// A box of which a camera sees top and sides.
    fn cuboid(low: Vec3, size: Vec3) -> Vec<Vec3> {
        let [x, y, z] = [Vec3::X * size, Vec3::Y * size, Vec3::Z * size];
        let sides = [(low, x, z), (low, y, z), (low + x, y, z), (low + y, x, z), (low + z, x, y)];
        sides.into_iter().flat_map(|(from, along, up)| sheet(from, along, up)).collect()
    }

    #[test]
    fn the_walls_of_a_bin_are_found_wherever_it_stands() {
        let things = cuboid(Vec3::new(0.05, 0.06, TABLE_M), Vec3::new(0.08, 0.05, 0.07));
        for turn in [0.0, 0.3, 1.2] {
            let turned = |point: &Vec3| axis_angle(Vec3::Z, turn) * *point + Vec3::new(0.4, -0.1, 0.0);
            for (sides, slope) in [(3, 0.1), (4, 0.0), (4, 0.4)] {
                let [sheets, things] =
                    [&bin(sides, slope), &things].map(|of| of.iter().map(turned).collect::<Vec<Vec3>>());
                let found = walls(&[sheets.clone(), things.clone()].concat(), TABLE_M);
                assert_eq!(found.len(), 4, "{turn} {sides}: {found:?}");
                let share = |points: &[Vec3]| {
                    let walls = points.iter().filter(|point| found.iter().any(|wall| wall.has(**point)));
                    walls.count() as f32 / points.len() as f32
                };
                assert!(share(&sheets) > 0.97, "{}", share(&sheets));
                assert_eq!(share(&things), 0.0);
                assert!(found.iter().all(|wall| (wall.top_m - 0.11).abs() < 0.004), "{found:?}");
                assert!(found.iter().all(|wall| (wall.slope - slope).abs() < 0.11), "{found:?}");
            }
        }
    }

    #[test]
    fn a_board_lies_behind_an_edge_that_hangs() {
        let at = |x, y, z| Vec3::new(x, y, TABLE_M + z);
        let (side, back) = (|x| sheet(at(x, 0.0, 0.0), 0.2 * Vec3::Y, 0.2 * Vec3::Z), at(0.0, 0.2, 0.0));
        let stands = side(0.0).chain(side(0.25)).chain(sheet(back, 0.25 * Vec3::X, 0.2 * Vec3::Z));
        let stands: Vec<Vec3> = stands.collect();
        let floor = sheet(at(0.02, 0.05, 0.0), 0.2 * Vec3::X, 0.1 * Vec3::Y);
        let stands: Vec<Vec3> = stands.into_iter().chain(floor).collect();
        let [before, above] = [at(0.12, -0.5, 0.2), at(0.12, 0.05, 0.6)];
        let hanging = |points: &[Vec3], eye: Vec3| -> Vec<Wall> {
            {
                let found = walls(points, TABLE_M);
                found.iter().filter_map(|wall| wall.board(&found, points, &[eye], TABLE_M)).collect()
            }
        };
        // Whether a thin one lies on three walls is seen from where an eye would look through it.
        assert_eq!(hanging(&stands, before).len(), 1);
        let high = at(0.12, -0.3, 0.5);
        assert_eq!((hanging(&stands, high), hanging(&stands, above)), (vec![], vec![]));
        let edge = sheet(at(0.0, 0.0, 0.19), 0.25 * Vec3::X, 0.02 * Vec3::Z);
        let found: Vec<Vec3> = stands.into_iter().chain(edge).collect();
        // From above it may as well be the rim of a wall whose inside nobody sees.
        assert_eq!(hanging(&found, above), []);
        let hanging = hanging(&found, before);
        let [edge] = hanging[..] else { panic!("{found:?}") };
        assert!((edge.bottom_m - TABLE_M - 0.19).abs() < 0.004, "{edge:?}");
        assert!(edge.is_over(at(0.1, 0.1, 0.2)) && !edge.is_over(at(0.1, -0.02, 0.2)));
        assert!(!edge.is_over(at(0.1, 0.1, 0.17)));
    }

    /// Of a shelf from its left: floor, the right side and the back, but for what the board hides from an eye.
    fn shelf(eye: Vec3) -> Vec<Vec3> {
        let at = |x, y, z| Vec3::new(x, y, TABLE_M + z);
        let right = sheet(at(0.25, 0.0, 0.0), 0.24 * Vec3::Y, 0.2 * Vec3::Z);
        let back = sheet(at(0.0, 0.24, 0.0), 0.25 * Vec3::X, 0.2 * Vec3::Z);
        let floor = sheet(at(0.01, 0.01, 0.0), 0.23 * Vec3::X, 0.22 * Vec3::Y);
        let is_hidden = |point: &Vec3| {
            let share = (TABLE_M + 0.2 - eye.z) / (point.z - eye.z);
            let board = eye.lerp(*point, share);
            (0.0..1.0).contains(&share) && (0.0..0.24).contains(&board.y)
        };
        right.chain(back).chain(floor).filter(|point| !is_hidden(point)).collect()
    }

    #[test]
    fn the_near_side_of_a_shelf_is_where_its_back_ends_and_a_board_may_be_over_what_was_seen() {
        let eye = Vec3::new(-0.1, -0.4, TABLE_M + 0.25);
        let points = shelf(eye);
        let found = walls(&points, TABLE_M);
        let is_near = |at: Vec3| found.iter().any(|wall| wall.has(at));
        let [side, thing] = [0.0, 0.12].map(|x| Vec3::new(x, 0.12, TABLE_M + 0.05));
        assert!(found.len() == 4 && is_near(side) && !is_near(thing), "{found:?}");
        let boards: Vec<Wall> = found.iter().filter_map(|wall| wall.board(&found, &points, &[eye], TABLE_M)).collect();
        let [board] = boards[..] else { panic!("{found:?}") };
        assert!(!board.is_seen && (board.bottom_m - TABLE_M - 0.2).abs() < 0.02 && board.inward.y > 0.9, "{board:?}");
        let carton: Vec<Vec3> = points.into_iter().filter(|at| at.x > 0.24 || at.y > 0.23).collect();
        assert_eq!(walls(&carton, TABLE_M), [], "without a floor it is the outside of a carton");
    }

    #[test]
    fn below_a_board_that_is_seen_from_above_walls_are_where_it_ends() {
        let eye = Vec3::new(-0.1, -0.4, TABLE_M + 0.35);
        let board = sheet(Vec3::new(-0.004, -0.004, TABLE_M + 0.2), 0.258 * Vec3::X, 0.248 * Vec3::Y);
        let front = sheet(Vec3::new(0.0, 0.0, TABLE_M + 0.194), 0.25 * Vec3::X, 0.006 * Vec3::Z);
        let points: Vec<Vec3> = shelf(eye).into_iter().chain(board).chain(front).collect();
        let found = walls(&points, TABLE_M);
        let is_near = |at: Vec3| found.iter().any(|wall| wall.has(at));
        let places = [[0.0, 0.12], [0.25, 0.12], [0.12, 0.24], [0.12, 0.12]];
        let near = places.map(|[x, y]| is_near(Vec3::new(x, y, TABLE_M + 0.05)));
        assert_eq!((found.len(), near), (4, [true, true, true, false]), "{found:?}");
        let boards: Vec<Wall> = found.iter().filter_map(|wall| wall.board(&found, &points, &[eye], TABLE_M)).collect();
        let [board] = boards[..] else { panic!("{found:?}") };
        let places = [[0.12, 0.1, 0.2], [0.12, 0.1, 0.15], [0.12, -0.05, 0.2]];
        let of_it = places.map(|[x, y, z]| board.is_board(Vec3::new(x, y, TABLE_M + z)));
        assert_eq!((board.is_seen, of_it), (true, [true, false, false]), "{board:?}");
    }

    /// Of the wall next to the eye only the rim is seen, which hides most behind it, and the ground under the rim.
    #[test]
    fn a_rim_over_a_foot_does_not_hang() {
        let size = |point: &Vec3| *point * Vec3::new(1.0, 1.0, 2.0) - TABLE_M * Vec3::Z;
        let is_seen = |point: &&Vec3| point.z + 0.7 * point.y > TABLE_M + 0.09;
        let points: Vec<Vec3> = bin(4, 0.5).iter().map(size).collect();
        let ground = sheet(Vec3::new(0.0, -0.06, TABLE_M), 0.24 * Vec3::X, 0.06 * Vec3::Y);
        let points: Vec<Vec3> = points.iter().filter(is_seen).copied().chain(ground).collect();
        let (eye, found) = (Vec3::new(0.12, -0.5, 0.5), walls(&points, TABLE_M));
        assert_eq!(found.len(), 4, "{found:?}");
        assert!(!found.iter().any(|wall| wall.board(&found, &points, &[eye], TABLE_M).is_some()), "{found:?}");
    }

    #[test]
    fn a_heap_across_a_bin_is_no_wall() {
        let heap = sheet(Vec3::new(0.12, 0.02, TABLE_M), 0.16 * Vec3::Y, 0.06 * Vec3::Z);
        let found = walls(&bin(3, 0.1).into_iter().chain(heap).collect::<Vec<_>>(), TABLE_M);
        let [on_heap, behind] = [0.12, 0.06].map(|x_m| Vec3::new(x_m, 0.1, TABLE_M + 0.03));
        assert!(found.len() >= 3 && !found.iter().any(|wall| wall.has(on_heap) || wall.is_behind(behind)), "{found:?}");
    }

    #[test]
    fn two_walls_and_things_are_no_container() {
        assert_eq!(walls(&bin(2, 0.1), TABLE_M), []);
        assert_eq!(walls(&[], TABLE_M), []);
        let carton = cuboid(Vec3::new(0.0, 0.0, TABLE_M), Vec3::new(0.25, 0.20, 0.10));
        assert_eq!(walls(&carton, TABLE_M), []);
        // A frame of 0.12 m is a thing.
        let small: Vec<Vec3> = bin(4, 0.1).iter().map(|point| *point * Vec3::new(0.5, 0.6, 1.0)).collect();
        assert_eq!(walls(&small, TABLE_M), []);
    }
}
