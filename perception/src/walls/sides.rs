//! Which ridges are the walls of one container, and where those are that were not seen.

use schema::{Vec2, Vec3};

use super::{
    CONNECTED_SHARE, CORNER_M, DEPTH_M_MIN, INNER_M_MIN, LENGTH_M_MIN, LOWER_M, OUTER_M, Ridge, TALL_M, THROUGH_MIN,
};
use crate::heights::{CELL_M, Heights};

/// Of the floor between two walls that meet at least this share is seen, or low things on it.
const FLOOR_SHARE_MIN: f32 = 0.3;

/// The cells of a wide and level board over what was seen below it, if there is one. It hides that its walls are
/// ridges.
pub(super) fn board(heights: &Heights, points_m: &[Vec3], table_z_m: f32) -> Option<Vec<Vec3>> {
    let cell_m = |cell: usize| heights.place_m(cell).extend(heights.top_m[cell]);
    let mut cells_m: Vec<Vec3> = (0..heights.top_m.len()).map(cell_m).filter(|at| at.z > table_z_m + TALL_M).collect();
    cells_m.sort_unstable_by(|a, b| a.z.total_cmp(&b.z));
    let level = |from: usize| cells_m[from..].partition_point(|at| at.z < cells_m[from].z + LOWER_M);
    let (count, from) = (0..cells_m.len()).map(|from| (level(from), from)).max()?;
    let cells_m: Vec<Vec3> = cells_m.drain(from..from + count).collect();
    let low_m = cells_m.first()?.z;
    let is_under =
        |at: &&Vec3| at.z < low_m - 0.5 * TALL_M && heights.at((at.truncate() - heights.low) / CELL_M - 0.5) >= low_m;
    let is_wide = count as f32 * CELL_M * CELL_M > INNER_M_MIN * DEPTH_M_MIN;
    (is_wide && points_m.iter().filter(is_under).count() >= THROUGH_MIN).then_some(cells_m)
}

/// Walls below a board whose faces are seen too askew: two sides, where it ends or a ridge runs below its far part.
pub(super) fn below(cells_m: &[Vec3], ridges: &[Ridge], axes: [Vec2; 2], table_z_m: f32) -> Vec<Ridge> {
    let mut ends_m = axes.map(|axis| {
        let offsets_m = cells_m.iter().map(|at| at.truncate().dot(axis));
        offsets_m.fold([f32::INFINITY, f32::NEG_INFINITY], |[low_m, high_m], at| [low_m.min(at), high_m.max(at)])
    });
    for ridge in ridges {
        let [low_m, high_m] = ends_m[ridge.axis];
        let beyond_m = (low_m - ridge.offset_m).max(ridge.offset_m - high_m);
        if beyond_m < INNER_M_MIN && ridge.between_m(ends_m[1 - ridge.axis]) >= DEPTH_M_MIN {
            ends_m[ridge.axis] = [low_m.min(ridge.offset_m), high_m.max(ridge.offset_m)];
        }
    }
    let (axis, top_m, cells, seen_m) = (0, table_z_m + TALL_M, 0, 0.0);
    ends_m[0].map(|offset_m| Ridge { axis, offset_m, ends_m: ends_m[1], top_m, cells, seen_m }).to_vec()
}

/// Two walls that face each other, or two with one that connects them and perhaps the one across from it: those of
/// which most was seen.
pub(super) fn enclosing(ridges: &[Ridge], table_z_m: f32) -> Vec<Ridge> {
    let mut best = (LENGTH_M_MIN, Vec::new());
    let mut is_best = |sides: Vec<Ridge>, width_m: f32| {
        let seen_m = |side: &Ridge| if side.axis == sides[0].axis { side.seen_m } else { side.seen_m.min(width_m) };
        let all_m = sides.iter().map(seen_m).sum::<f32>();
        if all_m > best.0 {
            best = (all_m, sides);
        }
    };
    for (place, one) in ridges.iter().enumerate() {
        let facing = ridges[place + 1..].iter().filter(|other| other.axis == one.axis);
        for other in facing.filter(|other| (other.offset_m - one.offset_m).abs() >= INNER_M_MIN) {
            let (left, right) = if one.offset_m < other.offset_m { (one, other) } else { (other, one) };
            if left.is_as_long(right) && left.is_as_high(right, table_z_m) {
                is_best(vec![*left, *right], 0.0);
            }
            let (between, width_m) = ([left.offset_m, right.offset_m], right.offset_m - left.offset_m);
            let connects = |base: &&Ridge| {
                let meets = |arm: &Ridge| {
                    arm.ends_m.iter().any(|end| (end - base.offset_m).abs() < CORNER_M)
                        && arm.is_as_high(base, table_z_m)
                };
                base.axis != one.axis
                    && meets(left)
                    && meets(right)
                    && left.side_of(base) == right.side_of(base)
                    && base.between_m(between) >= CONNECTED_SHARE * width_m
            };
            for base in ridges.iter().filter(connects) {
                let is_across = |wall: &&Ridge| {
                    // A heap's ridge lies across the bin, and the walls beside it go on beyond it.
                    let side = left.side_of(base);
                    let ends = |arm: &Ridge| arm.ends_m.iter().all(|end| (end - wall.offset_m) * side < CORNER_M);
                    wall.axis == base.axis
                        && wall.is_as_high(base, table_z_m)
                        && (wall.offset_m - base.offset_m) * side > DEPTH_M_MIN
                        && ends(left)
                        && ends(right)
                        && wall.between_m(between) > 0.5 * width_m
                };
                let across = ridges.iter().filter(is_across).max_by(|a, b| a.seen_m.total_cmp(&b.seen_m));
                is_best([*left, *right, *base].into_iter().chain(across.copied()).collect(), width_m);
            }
        }
    }
    best.1
}

/// Two tall walls that meet at a right angle with low things or floor between them, as of a shelf whose near side is
/// seen askew, and the one across from the first, where a ridge is or the second ends. Those of which most was seen.
pub(super) fn corner(ridges: &[Ridge], axes: [Vec2; 2], points_m: &[Vec3], table_z_m: f32) -> Vec<Ridge> {
    let is_tall = |ridge: &&Ridge| ridge.top_m >= table_z_m + TALL_M - LOWER_M && ridge.seen_m >= DEPTH_M_MIN;
    let tall = || ridges.iter().filter(is_tall);
    let found = tall().flat_map(|side| tall().map(move |base| (side, base))).filter_map(|(side, base)| {
        // Where it ends, if it begins at the other.
        let end = |of: &Ridge, from: &Ridge| {
            let off_m = of.ends_m.map(|end| (end - from.offset_m).abs());
            let is_met = of.axis != from.axis && off_m[0].min(off_m[1]) < CORNER_M;
            is_met.then_some(of.ends_m[usize::from(off_m[1] > off_m[0])])
        };
        let (across_m, front_m) = (end(base, side)?, end(side, base)?);
        let beyond = |other: &Ridge| (other.offset_m - across_m) * (across_m - side.offset_m).signum();
        let faces = |it: &&Ridge| it.axis == side.axis && it.between_m(side.ends_m) > 0.0 && beyond(it) > -CORNER_M;
        let facing = tall().filter(faces).max_by(|a, b| beyond(a).total_cmp(&beyond(b)));
        let (offset_m, seen_m) = facing.map_or((across_m, 0.0), |other| (other.offset_m, other.seen_m));
        let ends = [Vec2::new(side.offset_m, base.offset_m), Vec2::new(offset_m, front_m)];
        let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        let is_in = |point_m: &Vec3| {
            let at = Vec2::from_array([side, base].map(|wall| point_m.truncate().dot(axes[wall.axis])));
            let is_low = point_m.z < table_z_m + TALL_M - LOWER_M;
            is_low && at.cmpgt(low + OUTER_M).all() && at.cmplt(high - OUTER_M).all()
        };
        let floor = Heights::new(&points_m.iter().copied().filter(is_in).collect::<Vec<_>>());
        let seen = floor.top_m.iter().filter(|top_m| top_m.is_finite()).count() as f32 * CELL_M * CELL_M;
        let (size, all_m) = (high - low, side.seen_m + base.seen_m + seen_m);
        let is_wide = size.min_element() > DEPTH_M_MIN && all_m > LENGTH_M_MIN;
        (is_wide && seen > FLOOR_SHARE_MIN * size.element_product())
            .then(|| (all_m, vec![*side, Ridge { offset_m, cells: 0, ..*side }, *base]))
    });
    found.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, sides)| sides).unwrap_or_default()
}

/// The same walls, of which the first two face each other, and those that were not seen: where these end.
pub(super) fn completed(mut sides: Vec<Ridge>) -> Vec<Ridge> {
    let [left, right, others @ ..] = &sides[..] else { return sides };
    // The end of the one may be hidden.
    let mut unseen_m = vec![left.ends_m[0].min(right.ends_m[0]), left.ends_m[1].max(right.ends_m[1])];
    for other in others {
        // The end at which it is not.
        unseen_m.sort_by(|a, b| (b - other.offset_m).abs().total_cmp(&(a - other.offset_m).abs()));
        unseen_m.pop();
    }
    let (axis, ends_m) = (1 - left.axis, [left.offset_m, right.offset_m]);
    let unseen = Ridge { axis, ends_m, cells: 0, seen_m: 0.0, ..*left };
    sides.extend(unseen_m.into_iter().map(|offset_m| Ridge { offset_m, ..unseen }));
    sides
}
