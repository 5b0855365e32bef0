//! The table in what a camera saw, where nobody knows how the camera stands: of several planes the one that carries
//! things, is level as far as gravity is known, and has nothing of what it would hide below it.

use core::f32::consts::FRAC_PI_8;
use core::ops::RangeInclusive;

use rayon::prelude::*;
use schema::{Plane, Stream, Vec3};

use crate::fit::Coordinates;

/// Distances from the eye at which tables are looked for, in metres.
const SEEN_M: RangeInclusive<f32> = 0.1..=2.5;
/// Planes that are looked at.
const PLANES_MAX: usize = 6;
/// Random triples for each.
const TRIPLES: usize = 150;
/// The three points of a triple lie in one cube of this side: those of a whole room hardly ever share a plane.
const CUBE_M: f32 = 0.2;
/// Points among which planes are searched, about; they are fitted to all.
const SEARCHED: usize = 6_000;
/// A point belongs to a plane that is nearer than this, or than this much at a depth of a metre: the error of depth
/// cameras grows with the depth's square.
const NEAR_M: f32 = 0.006;
const NEAR_AT_A_METRE_M: f32 = 0.008;
/// Fewest points of a plane, as a share of all.
const SHARE_MIN: f32 = 0.01;
/// The ground of a plane: cells of this side that have points of it, and their neighbours.
const CELL_M: f32 = 0.03;
/// Points above a plane's ground, so high, are carried by it …
const CARRIED_M: [f32; 2] = [0.015, 0.4];
/// … and a table that carries nothing counts as if this share of all points were on it.
const BARE_SHARE: f32 = 0.0025;
/// Points so far below a plane's ground would be hidden by it.
const BELOW_M: f32 = 0.02;
/// A camera is rarely rolled, or pitched to look up from below the horizontal, by more than this sine.
const UPRIGHT: f32 = 0.35;
/// Tables are rarely further away from the camera of a robot.
const FAR_M: f32 = 1.5;
/// A table is level within this angle.
const LEVEL_RAD: f32 = FRAC_PI_8;
/// Planes are one that are turned and shifted by no more than this.
const SAME_RAD: f32 = FRAC_PI_8 / 4.0;
const SAME_M: f32 = 0.02;
/// Maximum number of fits to the points near a plane.
const FITS_MAX: usize = 20;

/// A plane that may be the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TableCandidate {
    /// In the points' frame; the normal points to the eye's side.
    pub plane: Plane,
    /// Root mean square of its points' distances, in metres.
    pub residual_m: f32,
    /// Share of the points that belong to it.
    pub share: f32,
    /// Share of the points that it carries.
    pub carried_share: f32,
    /// A point in the middle of what it carries or, if that is nothing, of itself; in metres.
    pub middle_m: Vec3,
    /// How well it answers; only ratios mean something.
    pub score: f32,
}

/// Planes in points that were seen from the origin of a camera's optical frame (x right, y down, z forward), the
/// likeliest table first. `down` is the direction of gravity in that frame; without it the camera is believed to stand
/// upright and to look down.
#[must_use]
pub fn find_tables(points_m: &[Vec3], down: Option<Vec3>, stream: &mut Stream) -> Vec<TableCandidate> {
    let points_m: Vec<Vec3> = points_m.iter().copied().filter(|at| SEEN_M.contains(&at.length())).collect();
    let mut searched: Vec<Vec3> = points_m.iter().step_by(points_m.len().div_ceil(SEARCHED).max(1)).copied().collect();
    searched.sort_by_cached_key(|point_m| cube(*point_m));
    let all = Coordinates::new(&points_m);
    let mut is_free = vec![true; searched.len()];
    let mut planes = Vec::new();
    for _ in 0..PLANES_MAX {
        let Some(first) = largest(&searched, &is_free, stream) else { break };
        for (is_free, point_m) in is_free.iter_mut().zip(&searched) {
            *is_free &= !belongs(&first, *point_m);
        }
        planes.push(first);
    }
    let candidates = planes.into_par_iter().map(|first| candidate(first, &all, &searched, down));
    let mut found: Vec<TableCandidate> = candidates.collect::<Vec<_>>().into_iter().flatten().collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    // What is left of a rough plane is no other plane.
    let mut apart: Vec<TableCandidate> = Vec::new();
    for candidate in found {
        if !apart.iter().any(|better| better.is_near(&candidate)) {
            apart.push(candidate);
        }
    }
    apart
}

impl TableCandidate {
    /// The point of the plane straight below the middle, in metres.
    #[must_use]
    pub fn foot_m(&self) -> Vec3 {
        self.middle_m - self.plane.normal * (self.plane.normal.dot(self.middle_m) - self.plane.offset_m)
    }

    /// Whether another plane is nearly the same.
    fn is_near(&self, other: &Self) -> bool {
        let [one, two] = [self.plane, other.plane];
        let apart_m = (one.normal.dot(other.foot_m()) - one.offset_m).abs();
        one.normal.dot(two.normal) > libm::cosf(SAME_RAD) && apart_m < SAME_M
    }
}

fn cube(point_m: Vec3) -> [i32; 3] {
    (point_m / CUBE_M).floor().to_array().map(|along| along as i32)
}

fn belongs(plane: &Plane, point_m: Vec3) -> bool {
    (plane.normal.dot(point_m) - plane.offset_m).abs() < NEAR_M.max(NEAR_AT_A_METRE_M * point_m.z * point_m.z)
}

/// A plane whose normal points to the side of the origin.
fn towards_eye(normal: Vec3, offset_m: f32) -> Plane {
    if offset_m > 0.0 { Plane { normal: -normal, offset_m: -offset_m } } else { Plane { normal, offset_m } }
}

/// Of the planes through random triples, the one with the most free points.
fn largest(points_m: &[Vec3], is_free: &[bool], stream: &mut Stream) -> Option<Plane> {
    let free: Vec<Vec3> = points_m.iter().zip(is_free).filter(|(_, is_free)| **is_free).map(|(at, _)| *at).collect();
    let least = (SHARE_MIN * points_m.len() as f32).max(3.0) as usize;
    if free.len() < least {
        return None;
    }
    let mut triple = || {
        let a = free[stream.index(free.len())];
        let near = free.partition_point(|at| cube(*at) < cube(a))..free.partition_point(|at| cube(*at) <= cube(a));
        let [b, c] = core::array::from_fn(|_| free[near.start + stream.index(near.len())]);
        let normal = (b - a).cross(c - a).try_normalize()?;
        Some(towards_eye(normal, normal.dot(a)))
    };
    let planes: Vec<Plane> = (0..TRIPLES).filter_map(|_| triple()).collect();
    let points = Coordinates::new(&free);
    let count = |plane: &Plane| points.count(|at| belongs(plane, at));
    let counted: Vec<(usize, Plane)> = planes.par_iter().map(|plane| (count(plane), *plane)).collect();
    let best = counted.into_iter().reduce(|best, next| if next.0 > best.0 { next } else { best })?;
    (best.0 >= least).then_some(best.1)
}

/// A plane, fitted to all of its points, and how well it answers.
fn candidate(first: Plane, all: &Coordinates, searched_m: &[Vec3], down: Option<Vec3>) -> Option<TableCandidate> {
    let (mut plane, mut members) = (first, vec![0; all.len()]);
    for _ in 0..FITS_MAX {
        let (sums, is_changed) = all.mark(|at| belongs(&plane, at), &mut members);
        let (normal, offset_m) = sums.plane()?;
        plane = towards_eye(normal, offset_m);
        if !is_changed {
            break;
        }
    }
    let height_m = |at: Vec3| plane.normal.dot(at) - plane.offset_m;
    let residual_m = all.residual_m(height_m, &members);
    let ground = Ground::of(&plane, searched_m);
    let [mut own, mut carried_m] = [Vec::new(), Vec::new()];
    let mut below = 0;
    for &at in searched_m {
        let height_m = height_m(at);
        if belongs(&plane, at) {
            own.push(at);
        } else if ground.is_under(at) {
            if (CARRIED_M[0]..CARRIED_M[1]).contains(&height_m) {
                carried_m.push(at);
            }
            below += usize::from(height_m < -BELOW_M);
        }
    }
    let share_of = |count: usize| count as f32 / searched_m.len() as f32;
    let (share, carried_share) = (share_of(own.len()), share_of(carried_m.len()));
    let hidden = below as f32 / own.len().max(1) as f32;
    let far = median(own.iter().map(|at| at.length())).unwrap_or(0.0) / FAR_M;
    let stands = down.map_or_else(|| upright(plane.normal), |down| level(plane.normal, down));
    Some(TableCandidate {
        residual_m,
        share,
        carried_share,
        middle_m: middle(if carried_m.is_empty() { &own } else { &carried_m }),
        score: share * (carried_share + BARE_SHARE) * stands * libm::expf(-hidden - far * far),
        plane,
    })
}

/// How likely a camera that stands upright and looks down sees a table with this normal.
fn upright(normal: Vec3) -> f32 {
    let square = |sine: f32| (sine / UPRIGHT) * (sine / UPRIGHT);
    libm::expf(-square(normal.x) - square(normal.y.max(0.0)))
}

/// Whether a plane is level.
fn level(normal: Vec3, down: Vec3) -> f32 {
    f32::from(u8::from(normal.dot(-down.normalize_or_zero()) >= libm::cosf(LEVEL_RAD)))
}

/// The upper one of the middle two of an even number; none of none.
pub(crate) fn median(values: impl Iterator<Item = f32>) -> Option<f32> {
    let mut values: Vec<f32> = values.collect();
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied()
}

fn middle(points_m: &[Vec3]) -> Vec3 {
    Vec3::from_array([0, 1, 2].map(|axis| median(points_m.iter().map(|at| at[axis])).unwrap_or(0.0)))
}

/// Cells of a plane that have points of it.
struct Ground {
    across: [Vec3; 2],
    low: [i32; 2],
    counts: [usize; 2],
    is_own: Vec<bool>,
}

impl Ground {
    fn of(plane: &Plane, points_m: &[Vec3]) -> Self {
        let first = plane.normal.any_orthonormal_vector();
        let across = [first, plane.normal.cross(first)];
        let own: Vec<[i32; 2]> =
            points_m.iter().filter(|at| belongs(plane, **at)).map(|at| cell(across, *at)).collect();
        let range = |axis: usize| {
            let low = own.iter().map(|cell| cell[axis]).min().unwrap_or(0) - 1;
            (low, own.iter().map(|cell| cell[axis] + 2 - low).max().unwrap_or(0) as usize)
        };
        let [(low_x, count_x), (low_y, count_y)] = [range(0), range(1)];
        let mut ground =
            Self { across, low: [low_x, low_y], counts: [count_x, count_y], is_own: vec![false; count_x * count_y] };
        for [x, y] in own {
            for (x, y) in (x - 1..=x + 1).flat_map(|x| (y - 1..=y + 1).map(move |y| (x, y))) {
                if let Some(place) = ground.place([x, y]) {
                    ground.is_own[place] = true;
                }
            }
        }
        ground
    }

    fn place(&self, [x, y]: [i32; 2]) -> Option<usize> {
        let [x, y] = [usize::try_from(x - self.low[0]).ok()?, usize::try_from(y - self.low[1]).ok()?];
        (x < self.counts[0] && y < self.counts[1]).then(|| x * self.counts[1] + y)
    }

    /// Whether the plane has points straight under or above a point.
    fn is_under(&self, point_m: Vec3) -> bool {
        self.place(cell(self.across, point_m)).is_some_and(|place| self.is_own[place])
    }
}

fn cell(across: [Vec3; 2], point_m: Vec3) -> [i32; 2] {
    across.map(|axis| (axis.dot(point_m) / CELL_M).floor() as i32)
}

#[cfg(test)]
mod tests {
    use schema::{Pose, Purpose, Quat, axis_angle};

    use super::*;

    /// Points of a rectangle, from a corner along two edges.
    fn sheet(corner: Vec3, edges: [Vec3; 2], step_m: f32) -> Vec<Vec3> {
        let [across, down] = edges.map(|edge| (edge.length() / step_m) as usize + 1);
        let at = |n: usize, count: usize| n as f32 / count as f32;
        (0..across * down)
            .map(|n| corner + edges[0] * at(n % across, across) + edges[1] * at(n / across, down))
            .collect()
    }

    /// The sides and the top of a box that a camera at y < 0 sees.
    fn block(low: Vec3, size: Vec3) -> Vec<Vec3> {
        let [x, y, z] = [Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z];
        [sheet(low + z, [x, y], 0.004), sheet(low, [x, z], 0.004), sheet(low, [y, z], 0.004)].concat()
    }

    /// What a camera sees that stands above y < 0 and looks along +y and down; `roll_rad` about its axis. The table's
    /// normal and offset in its frame are returned, too.
    fn seen(points: &[Vec3], down_rad: f32, roll_rad: f32, noise_m: f32) -> (Vec<Vec3>, Vec3, f32) {
        // Optical axes: x right, y down, z forward.
        let forward = Vec3::new(0.0, libm::cosf(down_rad), -libm::sinf(down_rad));
        let down = forward.cross(Vec3::X);
        let rotation = Quat::from_mat3(&schema::Mat3::from_cols(Vec3::X, down, forward));
        let pose = Pose::from_parts(-0.7 * forward, rotation * axis_angle(Vec3::Z, roll_rad));
        let (camera, mut stream) = (pose.inverse(), Stream::new(3, 0, Purpose::DepthNoise, 0));
        let noisy = |at: &Vec3| {
            let at = camera * *at;
            at * (1.0 + stream.normal(0.0, noise_m) / at.z)
        };
        let up = camera.rotation * Vec3::Z;
        (points.iter().map(noisy).collect(), up, up.dot(camera.translation))
    }

    fn found(points: &[Vec3], down: Option<Vec3>) -> Vec<TableCandidate> {
        find_tables(points, down, &mut Stream::new(1, 0, Purpose::Plane, 1))
    }

    fn is_table(candidate: &TableCandidate, up: Vec3, offset_m: f32) -> bool {
        candidate.plane.normal.dot(up) > libm::cosf(0.01) && (candidate.plane.offset_m - offset_m).abs() < 0.002
    }

    fn table(side_m: f32, z_m: f32) -> Vec<Vec3> {
        let half = 0.5 * side_m;
        sheet(Vec3::new(-half, -half, z_m), [Vec3::X * side_m, Vec3::Y * side_m], 0.006)
    }

    #[test]
    fn a_table_with_things_is_found_however_the_camera_looks_down() {
        let things =
            [block(Vec3::new(-0.1, 0.0, 0.0), Vec3::new(0.06, 0.05, 0.1)), block(Vec3::ZERO, Vec3::splat(0.08))];
        let scene = [&table(0.6, 0.0)[..], &things.concat()].concat();
        for down_rad in [0.4, 0.8, 1.2, 1.57] {
            for roll_rad in [-0.2, 0.0, 0.2] {
                let (points, up, offset_m) = seen(&scene, down_rad, roll_rad, 0.002);
                let all = found(&points, None);
                assert!(is_table(&all[0], up, offset_m), "{down_rad} {roll_rad}: {:?} {up} {offset_m}", all[0]);
                assert!(all.iter().skip(1).all(|other| other.score < 0.5 * all[0].score), "{all:?}");
                assert!(all[0].residual_m < 0.0035 && all[0].carried_share > 0.05, "{:?}", all[0]);
            }
        }
    }

    #[test]
    fn a_table_is_found_above_a_floor_and_the_floor_of_a_bin_inside_its_walls() {
        let things = block(Vec3::new(-0.05, 0.0, 0.0), Vec3::new(0.1, 0.08, 0.1));
        // The floor is larger, and carries the table.
        let floor = sheet(Vec3::new(-1.0, 0.35, -0.7), [Vec3::X * 2.0, Vec3::Y * 1.2], 0.01);
        let (points, up, offset_m) = seen(&[&table(0.5, 0.0)[..], &things, &floor].concat(), 0.6, 0.0, 0.002);
        assert!(is_table(&found(&points, None)[0], up, offset_m));
        let walls = [
            sheet(Vec3::new(-0.25, 0.25, 0.0), [Vec3::X * 0.5, Vec3::Z * 0.2], 0.004),
            sheet(Vec3::new(-0.25, -0.25, 0.0), [Vec3::Y * 0.5, Vec3::Z * 0.2], 0.004),
            sheet(Vec3::new(0.25, -0.25, 0.0), [Vec3::Y * 0.5, Vec3::Z * 0.2], 0.004),
        ];
        let (points, up, offset_m) = seen(&[&table(0.5, 0.0)[..], &things, &walls.concat()].concat(), 0.9, 0.0, 0.002);
        assert!(is_table(&found(&points, None)[0], up, offset_m));
    }

    /// A camera on its side believes a wall to be the table, unless it knows where down is.
    #[test]
    fn gravity_decides_between_planes() {
        let wall = sheet(Vec3::new(0.3, -0.3, 0.0), [Vec3::Y * 0.6, Vec3::Z * 0.6], 0.006);
        let things = block(Vec3::new(-0.05, 0.0, 0.0), Vec3::splat(0.08));
        let (points, up, offset_m) = seen(&[&table(0.6, 0.0)[..], &wall, &things].concat(), 0.7, -1.57, 0.001);
        assert!(!is_table(&found(&points, None)[0], up, offset_m));
        assert!(is_table(&found(&points, Some(-5.0 * up))[0], up, offset_m));
        let all = found(&points, Some(-up));
        assert!(
            all.iter()
                .all(|other| is_table(other, up, offset_m) || other.score == 0.0 || other.plane.normal.dot(up) > 0.9)
        );
    }

    #[test]
    fn where_there_is_no_plane_none_is_found() {
        let mut stream = Stream::new(7, 0, Purpose::Plane, 0);
        let cloud: Vec<Vec3> = (0..5_000).map(|_| stream.point(Vec3::splat(-0.5), Vec3::splat(0.5))).collect();
        assert!(found(&cloud, None).iter().all(|candidate| candidate.share < 0.1), "{:?}", found(&cloud, None));
        assert!(found(&[], None).is_empty() && found(&[Vec3::NAN; 50], None).is_empty());
        // Millimetres are too far away.
        let far: Vec<Vec3> = table(0.6, 0.5).into_iter().map(|at| at * 1e3).collect();
        assert!(found(&far, None).is_empty());
    }
}
