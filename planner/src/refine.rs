//! Refinement beyond the paper: the network proposes positions; hand poses are searched on a finer cloud.
//!
//! A box can be gripped across either pair of its sides, and a network with one orientation per voxel predicts the mean
//! of both. Therefore a detection's position and quality are kept, and its hand pose is searched on the cloud: from
//! several directions, in several turns, at several depths. The best pose is the one whose fingers lie flattest, with a
//! free way.
//!
//! Along a straight approach a cloud is a height map: a hand can reach a pose if nothing under its fingers, or under
//! its palm one finger length behind them, is higher. A collision test thus costs about a hundred look-ups for any
//! cloud. Where nothing was seen, the table is assumed to continue.

use rayon::prelude::*;
use schema::{Grasp, Gripper, Plane, Quat, Vec3, axis_angle, pose_from_parts};

use crate::config::{CollisionParams, RefinementParams};
use crate::hand::WRIST_DOWN;
use crate::plan::SegmentedCloud;

/// Points closer to the table than this belong to the table.
const TABLE_M: f32 = 0.004;
/// Resolution of positions along the closing direction.
const BIN_M: f32 = 0.000_25;
/// Side of the cells of the point index.
const CELL_M: f32 = 0.01;
/// Range beside the fingers in which the middle of the held object is determined.
const MIDDLE_M: f32 = 0.05;

/// A hand pose that closes on a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hand {
    /// Pose and width.
    pub grasp: Grasp,
    /// Support: the smaller number of points at a finger, reduced with the distance from the middle.
    pub support: f32,
}

/// A cloud prepared for the hand search from all directions.
pub struct Searched<'a> {
    gripper: &'a Gripper,
    params: &'a RefinementParams,
    /// Clearance that the way must have beyond the hand.
    margin_m: f32,
    /// Cosine of the maximum angle between normal and closing direction.
    normal_cos_min: f32,
    seen: Vec<Seen>,
}

impl<'a> Searched<'a> {
    /// Transforms the cloud and its normals to every approach. `pitch_m` is the spacing of its points.
    #[must_use]
    pub fn new(
        cloud: (&SegmentedCloud, &[Vec3]),
        pitch_m: f32,
        gripper: &'a Gripper,
        params: &'a RefinementParams,
        collision: &CollisionParams,
    ) -> Self {
        let seen = approaches(params).into_par_iter().map(|approach| Seen::new(cloud, pitch_m, approach)).collect();
        let margin_m = gripper.clearance_m + collision.margin_m;
        Self { gripper, params, margin_m, normal_cos_min: libm::cosf(params.normal_rad_max), seen }
    }

    /// The flattest hand at a position, or `None` if no way is free or nothing flat is between the fingers. Of equal
    /// hands the first wins; the vertical approach comes first.
    #[must_use]
    pub fn hand_at(&self, origin_m: Vec3) -> Option<Hand> {
        self.seen.iter().fold(None, |best, seen| self.hand_along(seen, origin_m, best))
    }

    /// The flattest hand along one approach, if it is flatter than `best`; else `best`.
    fn hand_along(&self, seen: &Seen, origin_m: Vec3, mut best: Option<Hand>) -> Option<Hand> {
        let origin = seen.approach.inverse() * origin_m;
        let half_y_m = 0.5 * self.gripper.opening_m_max;
        let around = seen.things.within(origin, libm::hypotf(MIDDLE_M, half_y_m));
        let reach_m = libm::hypotf(0.5 * self.gripper.finger_width_m, half_y_m);
        let near: Vec<Point> = around.iter().copied().filter(|p| p.is_within(reach_m)).collect();
        if near.len() < 2 * self.params.points_min {
            return best;
        }
        for step in 0..self.params.turns {
            let turn = axis_angle(Vec3::Z, core::f32::consts::PI * step as f32 / self.params.turns as f32);
            best = self.turned(seen, origin, turn, [&near, &around], best);
        }
        best
    }

    /// The flattest hand at one turn, if it is flatter than `best`; else `best`. Of the points, some may be between the
    /// fingers, and others show what is beside them.
    fn turned(
        &self,
        seen: &Seen,
        origin: Vec3,
        turn: Quat,
        [near, around]: [&[Point]; 2],
        mut best: Option<Hand>,
    ) -> Option<Hand> {
        let (gripper, params) = (self.gripper, self.params);
        let (half_x_m, half_y_m, back) = (0.5 * gripper.finger_width_m, 0.5 * gripper.opening_m_max, turn.inverse());
        let is_between = |p: &Point| p.at.x.abs() < half_x_m && p.at.y.abs() < half_y_m;
        let between: Vec<Point> = near.iter().map(|p| p.turned(back)).filter(is_between).collect();
        // A finger's support is at most the number of points that face it.
        let facing = |side: f32| between.iter().filter(|p| side * p.normal.y > self.normal_cos_min).count();
        let support_max = facing(-1.0).min(facing(1.0));
        let is_better = |support: f32, best: Option<Hand>| best.is_none_or(|hand| support > hand.support);
        if support_max < params.points_min || !is_better(support_max as f32, best) {
            return best;
        }
        let nearest_z_m = between.iter().map(|p| p.at.z).fold(f32::INFINITY, f32::min);
        let mut closing = Closing::new(half_y_m, params.flat_m);
        for depth in 1..=params.depths {
            let [before_m, tips_z_m] = [depth - 1, depth].map(|steps| nearest_z_m + params.depth_m * steps as f32);
            let newly = between.iter().filter(|p| (before_m..tips_z_m).contains(&p.at.z));
            newly.for_each(|point| closing.add(point, self.normal_cos_min));
            let touch = closing.touch(params.points_min, gripper.span_m());
            let Some(touch) = touch.filter(|touch| is_better(touch.support as f32, best)) else { continue };
            let support = touch.support as f32 / (1.0 + square(arm_m(around, back, &touch) / params.arm_m));
            if !is_better(support, best) {
                continue;
            }
            let at = origin + turn * Vec3::new(0.0, 0.5 * (touch.low_m + touch.high_m), 0.0);
            let tips = Vec3::new(at.x, at.y, origin.z + tips_z_m);
            // A deeper hand may have other contacts along the closing direction, and a free way.
            if !self.is_free(seen, tips, turn) {
                continue;
            }
            let workspace_from_grasp = pose_from_parts(seen.approach * turn, seen.approach * tips);
            best = Some(Hand { grasp: Grasp { workspace_from_grasp, width_m: touch.high_m - touch.low_m }, support });
        }
        best
    }

    /// Whether the open hand reaches `tips` (in the approach's frame) without passing through a point.
    fn is_free(&self, seen: &Seen, tips: Vec3, turn: Quat) -> bool {
        let (gripper, margin_m) = (self.gripper, self.margin_m);
        let under = |centre_y_m: f32, half_m: [f32; 2], z_m: f32, map: &Heights| {
            let half_m = half_m.map(|half| half + margin_m);
            let corners = [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]];
            let above_table = corners.into_iter().all(|[x, y]| {
                let corner = Vec3::new(x * half_m[0], centre_y_m + y * half_m[1], z_m + margin_m - tips.z);
                seen.is_above_table(tips + turn * corner)
            });
            above_table && map.is_lower(tips, turn, centre_y_m, half_m, z_m + margin_m)
        };
        let beside_m = 0.5 * (gripper.opening_m_max + gripper.finger_thickness_m);
        let finger = [0.5 * gripper.finger_width_m, 0.5 * gripper.finger_thickness_m];
        let palm = [0.5 * gripper.palm_width_m, 0.5 * gripper.palm_breadth_m];
        under(beside_m, finger, tips.z, &seen.fine)
            && under(-beside_m, finger, tips.z, &seen.fine)
            && under(0.0, palm, tips.z - gripper.finger_length_m, &seen.coarse)
    }
}

struct Touch {
    low_m: f32,
    high_m: f32,
    support: usize,
}

/// Histogram of the points between two fingers along the closing direction.
struct Closing {
    half_m: f32,
    flat_bins: usize,
    all: Vec<u32>,
    /// Of these, the points that face the finger at the low end, and at the high end.
    facing_low: Vec<u32>,
    facing_high: Vec<u32>,
    count: usize,
}

impl Closing {
    fn new(half_m: f32, flat_m: f32) -> Self {
        let bins = (2.0 * half_m / BIN_M) as usize + 1;
        let empty = vec![0; bins];
        let flat_bins = (flat_m / BIN_M).round().max(1.0) as usize;
        Self { half_m, flat_bins, all: empty.clone(), facing_low: empty.clone(), facing_high: empty, count: 0 }
    }

    fn add(&mut self, point: &Point, normal_cos_min: f32) {
        let bin = (((point.at.y + self.half_m) / BIN_M) as usize).min(self.all.len() - 1);
        self.all[bin] += 1;
        self.facing_low[bin] += u32::from(-point.normal.y > normal_cos_min);
        self.facing_high[bin] += u32::from(point.normal.y > normal_cos_min);
        self.count += 1;
    }

    /// The contacts of both fingers, if each has enough support and they are at most `width_m_max` apart.
    fn touch(&self, points_min: usize, width_m_max: f32) -> Option<Touch> {
        if self.count < 2 * points_min {
            return None;
        }
        // A few stray points must not stop a finger.
        let stray = (points_min / 4) as u32;
        let past_stray = |seen: &mut u32, count: &u32| {
            *seen += count;
            Some(*seen > stray)
        };
        let low = self.all.iter().scan(0, past_stray).position(|is_past| is_past)?;
        let high = self.all.len() - 1 - self.all.iter().rev().scan(0, past_stray).position(|is_past| is_past)?;
        let edge_m = |bin: usize| bin as f32 * BIN_M - self.half_m;
        let (low_m, high_m) = (edge_m(low), edge_m(high + 1));
        if high < low || high_m - low_m > width_m_max {
            return None;
        }
        let from_low = |bins: &[u32]| bins.iter().skip(low).take(self.flat_bins).sum::<u32>();
        let from_high = |bins: &[u32]| bins[..=high].iter().rev().take(self.flat_bins).sum::<u32>();
        let support = from_low(&self.facing_low).min(from_high(&self.facing_high)) as usize;
        (support >= points_min).then_some(Touch { low_m, high_m, support })
    }
}

/// Distance beside the fingers of the middle of the points between the contacts, within [`MIDDLE_M`].
fn arm_m(around: &[Point], back: Quat, touch: &Touch) -> f32 {
    let turned = around.iter().map(|p| back * p.at);
    let held = turned.filter(|at| touch.low_m <= at.y && at.y <= touch.high_m);
    let (sum, count) = held.fold((0.0, 0), |(sum, count), at| (sum + at.x, count + 1));
    sum / count.max(1) as f32
}

fn square(x: f32) -> f32 {
    x * x
}

/// The vertical approach and the tilted ones.
fn approaches(params: &RefinementParams) -> Vec<Quat> {
    let tilted = |number: usize| {
        let azimuth_rad = core::f32::consts::TAU * number as f32 / params.tilts as f32;
        let around = axis_angle(Vec3::Z, azimuth_rad);
        (around * axis_angle(Vec3::X, params.tilt_rad) * around.inverse() * WRIST_DOWN).normalize()
    };
    core::iter::once(WRIST_DOWN).chain((0..params.tilts).map(tilted)).collect()
}

/// A point of the surface and its normal.
#[derive(Debug, Clone, Copy)]
struct Point {
    at: Vec3,
    normal: Vec3,
}

impl Point {
    fn turned(&self, turn: Quat) -> Self {
        Self { at: turn * self.at, normal: turn * self.normal }
    }

    /// Whether the point is within this distance of the line along the approach through the origin.
    fn is_within(&self, reach_m: f32) -> bool {
        square(self.at.x) + square(self.at.y) < square(reach_m)
    }
}

/// Square cells perpendicular to an approach, over all points of a cloud.
struct Squares {
    side_m: f32,
    low_m: Vec3,
    rows: usize,
    columns: usize,
}

impl Squares {
    fn over(points_m: impl Iterator<Item = Vec3> + Clone, side_m: f32) -> Self {
        let low_m = points_m.clone().fold(Vec3::INFINITY, Vec3::min);
        let high_m = points_m.fold(Vec3::NEG_INFINITY, Vec3::max);
        let [rows, columns] = [high_m.x - low_m.x, high_m.y - low_m.y].map(|m| (m.max(0.0) / side_m) as usize + 1);
        Self { side_m, low_m, rows, columns }
    }

    /// The number of the cell of one of the points.
    fn at(&self, point_m: Vec3) -> usize {
        let [row, column] = [point_m.x - self.low_m.x, point_m.y - self.low_m.y].map(|m| (m / self.side_m) as usize);
        row * self.columns + column
    }
}

/// The points of each cell.
struct Things {
    squares: Squares,
    cells: Vec<Vec<Point>>,
}

impl Things {
    fn new(points: &[Point]) -> Self {
        let squares = Squares::over(points.iter().map(|p| p.at), CELL_M);
        let mut cells = vec![Vec::new(); squares.rows * squares.columns];
        for point in points {
            cells[squares.at(point.at)].push(*point);
        }
        Self { squares, cells }
    }

    /// The points near the line along the approach through `origin`, relative to `origin`.
    fn within(&self, origin: Vec3, reach_m: f32) -> Vec<Point> {
        let Squares { low_m, rows, columns, .. } = self.squares;
        let at = origin - low_m;
        let near = |at: f32, count: usize| {
            let [first, last] = [at - reach_m, at + reach_m].map(|m| (m.max(0.0) / CELL_M) as usize);
            first.min(count)..(last + 1).min(count)
        };
        let cells = near(at.x, rows).flat_map(|row| &self.cells[row * columns..][near(at.y, columns)]);
        cells.flatten().map(|p| Point { at: p.at - origin, ..*p }).filter(|p| p.is_within(reach_m)).collect()
    }
}

/// A cloud in the frame of an approach.
struct Seen {
    /// Rotation from the frame whose z is the approach to the workspace.
    approach: Quat,
    /// Points above the table, in that frame.
    things: Things,
    table: Option<Plane>,
    fine: Heights,
    coarse: Heights,
}

impl Seen {
    fn new((cloud, normals): (&SegmentedCloud, &[Vec3]), pitch_m: f32, approach: Quat) -> Self {
        let back = approach.inverse();
        let points_m: Vec<Vec3> = cloud.points_m.iter().map(|point| back * *point).collect();
        let (fine, coarse) = (Heights::new(&points_m, pitch_m), Heights::new(&points_m, 2.0 * pitch_m));
        let turned = |plane: &Plane| Plane { normal: back * plane.normal, offset_m: plane.offset_m };
        let table = cloud.plane.as_ref().map(|found| turned(&found.plane));
        let points = points_m.into_iter().zip(normals).map(|(at, normal)| Point { at, normal: back * *normal });
        let is_thing = |p: &Point| table.is_none_or(|plane| plane.normal.dot(p.at) > plane.offset_m + TABLE_M);
        Self { approach, things: Things::new(&points.filter(is_thing).collect::<Vec<_>>()), table, fine, coarse }
    }

    /// Whether a point is above the table, or there is no table.
    fn is_above_table(&self, point: Vec3) -> bool {
        self.table.is_none_or(|plane| plane.normal.dot(point) > plane.offset_m)
    }
}

/// The height map: the nearest point's z for each cell.
struct Heights {
    squares: Squares,
    nearest_z_m: Vec<f32>,
}

impl Heights {
    fn new(points_m: &[Vec3], side_m: f32) -> Self {
        let squares = Squares::over(points_m.iter().copied(), side_m);
        let mut nearest_z_m = vec![f32::INFINITY; squares.rows * squares.columns];
        for point in points_m {
            let slot = &mut nearest_z_m[squares.at(*point)];
            *slot = slot.min(point.z);
        }
        Self { squares, nearest_z_m }
    }

    /// Whether all points under a rectangle around `centre_y_m` along the turned y are beyond `z_m`.
    fn is_lower(&self, tips: Vec3, turn: Quat, centre_y_m: f32, half_m: [f32; 2], z_m: f32) -> bool {
        let Squares { side_m, low_m, columns, .. } = self.squares;
        let steps = half_m.map(|half| (2.0 * half / side_m).ceil() as usize);
        let (along_x, along_y) = (turn * Vec3::X, turn * Vec3::Y);
        let at = |half: f32, step: usize, steps: usize| half * (2.0 * step as f32 / steps as f32 - 1.0);
        let centre = tips + along_y * centre_y_m - low_m;
        (0..=steps[0]).all(|i| {
            let line = centre + along_x * at(half_m[0], i, steps[0]);
            (0..=steps[1]).all(|j| {
                let place = (line + along_y * at(half_m[1], j, steps[1])) / side_m;
                // Outside the map there is nothing. A cast of a negative number gives 0, so the sign is tested first.
                if place.x < 0.0 || place.y < 0.0 || place.y as usize >= columns {
                    return true;
                }
                let cell = place.x as usize * columns + place.y as usize;
                self.nearest_z_m.get(cell).is_none_or(|nearest| *nearest > z_m)
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BuiltIn;
    use crate::hand::Sweep;
    use crate::segment::segment;

    const LAW: RefinementParams = RefinementParams {
        turns: 12,
        tilts: 6,
        tilt_rad: 0.5,
        depths: 5,
        depth_m: 0.008,
        flat_m: 0.002,
        normal_rad_max: 0.5,
        arm_m: 0.02,
        points_min: 16,
    };

    /// A box of these millimetres, turned by `yaw_rad`, on a table at 0.05 m, on a lattice of 2.5 mm.
    fn scene(size: [usize; 3], yaw_rad: f32) -> Vec<Point> {
        let [x, y, z] = size.map(|side| side * 2 / 5);
        let turn = axis_angle(Vec3::Z, yaw_rad);
        let mut points = Vec::new();
        for i in 0..=x {
            for j in 0..=y {
                for k in 1..=z {
                    if i % x == 0 || j % y == 0 || k == z {
                        let middle = Vec3::new(x as f32, y as f32, 0.0) * 0.5;
                        let local = (Vec3::new(i as f32, j as f32, k as f32) - middle) * 0.0025;
                        let side =
                            |at: usize, last: usize| f32::from(u8::from(at == last)) - f32::from(u8::from(at == 0));
                        let normal = Vec3::new(side(i, x), side(j, y), if k == z { 1.0 } else { 0.0 }).normalize();
                        points.push(Point { at: turn * local + Vec3::new(0.15, 0.15, 0.05), normal: turn * normal });
                    }
                }
            }
        }
        let table = |n: u16| Vec3::new(f32::from(n / 120) * 0.0025, f32::from(n % 120) * 0.0025, 0.05);
        points.extend((0..14_400).map(|n| Point { at: table(n), normal: Vec3::Z }));
        points
    }

    fn places(points: &[Point]) -> Vec<Vec3> {
        points.iter().map(|p| p.at).collect()
    }

    fn hand(points: &[Point], origin_m: Vec3) -> Option<Hand> {
        let config = BuiltIn::Paper.config().unwrap();
        let (cloud, _) = segment(places(points), &config);
        let normals: Vec<Vec3> = points.iter().map(|p| p.normal).collect();
        let collision = CollisionParams { margin_m: 0.002, ..config.collision };
        Searched::new((&cloud, &normals), 0.0025, &config.gripper, &LAW, &collision).hand_at(origin_m)
    }

    /// The closing direction of the found hand, in the box's frame.
    fn closing(yaw_rad: f32, grasp: &Grasp) -> Vec3 {
        axis_angle(Vec3::Z, -yaw_rad) * (grasp.workspace_from_grasp.rotation * Vec3::Y)
    }

    #[test]
    fn a_hand_is_put_on_the_faces_and_into_the_middle() {
        for yaw_rad in [0.0, 0.3, 1.0, 2.0] {
            let off = axis_angle(Vec3::Z, yaw_rad) * Vec3::new(0.004, 0.005, 0.0);
            let found = hand(&scene([40, 60, 50], yaw_rad), Vec3::new(0.15, 0.15, 0.08) + off).unwrap();
            let along = closing(yaw_rad, &found.grasp).abs();
            // Within half a step of 15 degrees of one of the two possible closing directions.
            assert!(along.max_element() > libm::cosf(0.14), "{yaw_rad}: closes along {along}");
            let width_m = if along.x > along.y { 0.04 } else { 0.06 };
            assert!((found.grasp.width_m - width_m).abs() < 0.008, "{yaw_rad}: {} m", found.grasp.width_m);
            let at = found.grasp.workspace_from_grasp.translation;
            let off = axis_angle(Vec3::Z, -yaw_rad) * (at - Vec3::new(0.15, 0.15, at.z));
            assert!(off.dot(along).abs() < 0.003, "{yaw_rad}: off the middle by {off}");
            assert!(found.support > 0.0);
        }
    }

    /// A way that is free on the map is free for the sweep over all points, up to the width of a cell.
    #[test]
    fn a_way_on_the_map_is_a_way_through_the_points() {
        let config = BuiltIn::Paper.config().unwrap();
        let sweep = Sweep::new(&config.gripper, &CollisionParams { margin_m: 0.0, ..config.collision });
        let mut found = 0;
        for n in 0..60_u8 {
            let share = f32::from(n) / 60.0;
            let mut points = scene([35, 55, 30], 2.0 * share);
            // A wall beside the box, closer and closer.
            let wall_x_m = 0.15 + 0.1 - 0.07 * share;
            let at = |p: u16| Vec3::new(wall_x_m, 0.05 + f32::from(p % 80) * 0.0025, 0.05 + f32::from(p / 80) * 0.0025);
            points.extend((0..2_400).map(|p| Point { at: at(p), normal: -Vec3::X }));
            if let Some(hand) = hand(&points, Vec3::new(0.15, 0.15, 0.07)) {
                found += 1;
                let hits = sweep.points_hit(&hand.grasp.workspace_from_grasp, &places(&points));
                assert_eq!(hits, 0, "{n}: {hand:?}");
            }
        }
        assert!(found > 30, "{found}");
    }

    #[test]
    fn a_closing_that_is_blocked_gives_way_to_the_other() {
        let mut points = scene([40, 60, 50], 0.0);
        let at = Vec3::new(0.15, 0.15, 0.08);
        let free = closing(0.0, &hand(&points, at).unwrap().grasp).abs();
        // Posts on both sides of the box, in the way of the fingers.
        let axis = if free.x > free.y { Vec3::X } else { Vec3::Y };
        for side in [-1.0, 1.0] {
            let foot = Vec3::new(0.15, 0.15, 0.05) + axis * side * 0.047;
            let post = |k: u8| Point { at: foot + Vec3::Z * (f32::from(k) * 0.0025), normal: axis };
            points.extend((0..40).map(post));
        }
        let now = closing(0.0, &hand(&points, at).unwrap().grasp).abs();
        assert!(now.dot(axis) < 0.6, "still closes along {now}");
    }

    /// 16 mm high: the fingers must come close to the table without touching it.
    #[test]
    fn a_flat_thing_is_held_just_above_the_table() {
        let found = hand(&scene([50, 40, 16], 0.4), Vec3::new(0.15, 0.15, 0.06)).unwrap();
        let z_m = found.grasp.workspace_from_grasp.translation.z;
        assert!((0.0525..0.06).contains(&z_m), "{z_m}");
    }

    /// The table is seen only below the object, and continues: a tilted hand beside the object must not pass through
    /// it.
    #[test]
    fn the_table_goes_on_where_it_was_not_seen() {
        let mut points = scene([60, 30, 20], 0.0);
        points.retain(|p| p.at.z > 0.051 || (p.at - Vec3::new(0.15, 0.15, 0.05)).length() < 0.045);
        let config = BuiltIn::Paper.config().unwrap();
        let hands = [Vec3::new(0.15, 0.15, 0.06), Vec3::new(0.17, 0.15, 0.06), Vec3::new(0.15, 0.19, 0.055)];
        let found: Vec<Hand> = hands.into_iter().filter_map(|at| hand(&points, at)).collect();
        assert!(!found.is_empty());
        for hand in found {
            let pose = hand.grasp.workspace_from_grasp;
            for part in config.gripper.open_hand() {
                let side = |corner: u8, bit: u8| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
                let corner = |n: u8| part.centre_m + part.half_m * Vec3::new(side(n, 0), side(n, 1), side(n, 2));
                assert!((0..8).all(|n| (pose * corner(n)).z > 0.0505), "{hand:?}");
            }
        }
    }

    /// Across the corners of a box as many points are within reach of the fingers as on its faces, but they do not face
    /// them.
    #[test]
    fn what_does_not_face_the_fingers_does_not_count() {
        let mut points = scene([40, 40, 50], 0.0);
        for point in &mut points {
            // All sides as if cut at 45 degrees.
            point.normal = axis_angle(Vec3::Z, core::f32::consts::FRAC_PI_4) * point.normal;
        }
        let found = hand(&points, Vec3::new(0.15, 0.15, 0.08));
        let along = found.map(|hand| closing(0.0, &hand.grasp).abs());
        assert!(along.is_none_or(|along| along.max_element() < libm::cosf(0.2)), "{along:?}");
    }

    #[test]
    fn what_is_too_wide_or_not_there_has_no_hand() {
        assert!(hand(&[], Vec3::new(0.15, 0.15, 0.08)).is_none());
        assert!(hand(&scene([100, 120, 50], 0.0), Vec3::new(0.15, 0.15, 0.08)).is_none());
        assert!(hand(&scene([40, 60, 50], 0.0), Vec3::new(0.05, 0.05, 0.08)).is_none());
    }
}
