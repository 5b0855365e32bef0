//! The table in what a camera saw, where nobody knows how the camera stands: of several planes the one that carries
//! things, is level as far as gravity is known, and has nothing of what it would hide below it.
//!
//! Walls, shelves and people behind a table cross its plane, and most of what is seen above it may be theirs. They go
//! on above all that a gripper takes, or the image ends before they do: what lies in cells of the plane over which
//! something does is no thing.

use core::f32::consts::FRAC_PI_8;
use core::ops::RangeInclusive;

use rayon::prelude::*;
use schema::{Plane, Stream, Vec2, Vec3};

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
/// A camera is pointed at what is to be grasped: things nearer to its axis than this many metres a metre count first.
/// 0.15 to 0.3 find the same.
const AHEAD: f32 = 0.2;
/// Things further from those are out of reach: half the widest workspace.
const REACH_M: f32 = 0.6;
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
    /// A point in the middle of the things on it that the camera is pointed at or, if there are none, of itself; in
    /// metres.
    pub middle_m: Vec3,
    /// What goes on above all that a gripper takes, or is cut by the image above the plane, as a wall: its point that
    /// is nearest to the middle, in metres.
    pub structure_m: Option<Vec3>,
    /// How well it answers, however it lies: the product of its share and what it carries, less for what is behind it
    /// and far away.
    pub evidence: f32,
    /// How well it answers as it lies; only ratios mean something.
    pub score: f32,
}

/// Where an image begins and ends: the least and the greatest x/z and y/z of what its camera can see.
pub type Sides = [Vec2; 2];

/// Planes in points that were seen from the origin of a camera's optical frame (x right, y down, z forward), the
/// likeliest table first. `down` is the direction of gravity in that frame; without it the camera is believed to stand
/// upright and to look down. Without the image's sides it ends where the points do.
#[must_use]
pub fn find_tables(
    points_m: &[Vec3],
    down: Option<Vec3>,
    sides: Option<Sides>,
    stream: &mut Stream,
) -> Vec<TableCandidate> {
    let sides = sides.unwrap_or_else(|| sides_of(points_m));
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
    let candidates = planes.into_par_iter().map(|first| candidate(first, &all, &searched, down, sides));
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
fn candidate(
    first: Plane,
    all: &Coordinates,
    searched_m: &[Vec3],
    down: Option<Vec3>,
    sides: Sides,
) -> Option<TableCandidate> {
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
    let (own, others): (Vec<Vec3>, Vec<Vec3>) = searched_m.iter().partition(|at| belongs(&plane, **at));
    let ground = Ground::of(plane.normal, &own);
    let over: Vec<Vec3> = others.into_iter().filter(|at| ground.is_under(*at)).collect();
    let below = over.iter().filter(|at| height_m(**at) < -BELOW_M).count();
    let is_cut = |at: Vec3| is_within(sides, at) && !is_within(sides, at + plane.normal * CELL_M);
    let [mut carried_m, mut structure_m] = [Vec::new(), Vec::new()];
    for at in over.into_iter().filter(|at| height_m(*at) >= CARRIED_M[0]) {
        if height_m(at) >= CARRIED_M[1] || is_cut(at) {
            structure_m.push(at);
        }
        if height_m(at) < CARRIED_M[1] {
            carried_m.push(at);
        }
    }
    let structure = Ground::of(plane.normal, &structure_m);
    let things_m = those(if carried_m.is_empty() { &own } else { &carried_m }, |at| !structure.is_under(at));
    let ahead_m = middle(&those(&things_m, |at| at.truncate().length() < AHEAD * at.z));
    let middle_m = middle(&those(&things_m, |at| at.distance(ahead_m) < REACH_M));
    let nearer = |a: &Vec3, b: &Vec3| a.distance(middle_m).total_cmp(&b.distance(middle_m));
    let share_of = |count: usize| count as f32 / searched_m.len() as f32;
    let (share, carried_share) = (share_of(own.len()), share_of(carried_m.len()));
    let hidden = below as f32 / own.len().max(1) as f32;
    let far = median(own.iter().map(|at| at.length())).unwrap_or(0.0) / FAR_M;
    let stands = down.map_or_else(|| upright(plane.normal), |down| level(plane.normal, down));
    Some(TableCandidate {
        residual_m,
        share,
        carried_share,
        middle_m,
        structure_m: structure_m.into_iter().min_by(nearer),
        evidence: share * (carried_share + BARE_SHARE) * libm::expf(-hidden - far * far),
        score: share * (carried_share + BARE_SHARE) * stands * libm::expf(-hidden - far * far),
        plane,
    })
}

/// The sides of an image whose border shows something.
fn sides_of(points_m: &[Vec3]) -> Sides {
    let seen = points_m.iter().filter(|at| at.is_finite() && at.z >= *SEEN_M.start());
    let rays = seen.map(|at| at.truncate() / at.z);
    rays.fold([Vec2::INFINITY, Vec2::NEG_INFINITY], |[low, high], ray| [low.min(ray), high.max(ray)])
}

/// Whether a point lies before a camera, and not beyond a side of its image.
fn is_within([low, high]: Sides, at: Vec3) -> bool {
    let ray = at.truncate() / at.z;
    at.z > 0.0 && ray.cmpge(low).all() && ray.cmple(high).all()
}

/// Those points that are meant or, if none is, all.
fn those(points_m: &[Vec3], is_meant: impl Fn(Vec3) -> bool) -> Vec<Vec3> {
    let meant: Vec<Vec3> = points_m.iter().copied().filter(|at| is_meant(*at)).collect();
    if meant.is_empty() { points_m.to_vec() } else { meant }
}

/// How likely a camera that stands upright and looks down sees a table with this normal.
#[must_use]
pub fn upright(normal: Vec3) -> f32 {
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
    let middle = values.len() / 2;
    (middle < values.len()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

fn middle(points_m: &[Vec3]) -> Vec3 {
    Vec3::from_array([0, 1, 2].map(|axis| median(points_m.iter().map(|at| at[axis])).unwrap_or(0.0)))
}

/// Cells of a plane that have points straight under or above them, and their neighbours.
struct Ground {
    across: [Vec3; 2],
    low: [i32; 2],
    counts: [usize; 2],
    is_own: Vec<bool>,
}

impl Ground {
    fn of(normal: Vec3, points_m: &[Vec3]) -> Self {
        let first = normal.any_orthonormal_vector();
        let across = [first, normal.cross(first)];
        let own: Vec<[i32; 2]> = points_m.iter().map(|at| cell(across, *at)).collect();
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

    /// Whether there are points straight under or above a point.
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

    /// A camera that stands above y < 0, 0.7 m from the origin, and looks there along +y and down; `roll_rad` about its
    /// axis.
    fn eye(down_rad: f32, roll_rad: f32) -> Pose {
        // Optical axes: x right, y down, z forward.
        let forward = Vec3::new(0.0, libm::cosf(down_rad), -libm::sinf(down_rad));
        let down = forward.cross(Vec3::X);
        let rotation = Quat::from_mat3(&schema::Mat3::from_cols(Vec3::X, down, forward));
        Pose::from_parts(-0.7 * forward, rotation * axis_angle(Vec3::Z, roll_rad))
    }

    /// What such a camera sees. The table's normal and offset in its frame are returned, too.
    fn seen(points: &[Vec3], down_rad: f32, roll_rad: f32, noise_m: f32) -> (Vec<Vec3>, Vec3, f32) {
        let camera = eye(down_rad, roll_rad).inverse();
        let mut stream = Stream::new(3, 0, Purpose::DepthNoise, 0);
        let noisy = |at: &Vec3| {
            let at = camera * *at;
            at * (1.0 + stream.normal(0.0, noise_m) / at.z)
        };
        let up = camera.rotation * Vec3::Z;
        (points.iter().map(noisy).collect(), up, up.dot(camera.translation))
    }

    fn found(points: &[Vec3], down: Option<Vec3>) -> Vec<TableCandidate> {
        find_tables(points, down, None, &mut Stream::new(1, 0, Purpose::Plane, 1))
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

    /// Two opposite corners of a box.
    type Block = [Vec3; 2];

    const fn between(low: [f32; 3], high: [f32; 3]) -> Block {
        [Vec3::from_array(low), Vec3::from_array(high)]
    }

    /// A depth image of boxes as points in the frame of such a camera, and the image's sides. The noise is that at a
    /// depth of a metre.
    fn shot(blocks: &[Block], down_rad: f32, noise_m: f32) -> (Vec<Vec3>, Sides) {
        let (pose, mut stream) = (eye(down_rad, 0.0), Stream::new(3, 0, Purpose::DepthNoise, 0));
        let ray = |u: usize, v: usize| Vec3::new(u as f32 - 79.5, v as f32 - 59.5, 135.0) / 135.0;
        let depth_m = |way: Vec3, block: &Block| {
            let [one, two] = block.map(|corner| (corner - pose.translation) / way);
            let (near_m, far_m) = (one.min(two).max_element(), one.max(two).min_element());
            (near_m > 0.0 && near_m <= far_m).then_some(near_m)
        };
        let point = |n: usize| {
            let ray = ray(n % 160, n / 160);
            let way = pose.rotation * ray;
            let first_m = blocks.iter().filter_map(|block| depth_m(way, block)).min_by(f32::total_cmp)?;
            Some(ray * (first_m + first_m * first_m * stream.normal(0.0, noise_m)))
        };
        ((0..160 * 120).filter_map(point).collect(), [ray(0, 0), ray(159, 119)].map(Vec3::truncate))
    }

    /// Things, the middle of which is about x = 0, y = 0.04 m.
    const THINGS: [Block; 3] = [
        between([-0.12, -0.05, 0.0], [-0.06, 0.02, 0.10]),
        between([0.02, -0.06, 0.0], [0.09, -0.02, 0.06]),
        between([-0.03, 0.08, 0.0], [0.03, 0.14, 0.14]),
    ];
    const FLOOR: Block = between([-4.0, -4.0, -0.80], [4.0, 6.0, -0.75]);

    /// A table that ends here, and a wall.
    const fn top(back_m: f32) -> Block {
        between([-1.0, -1.0, -0.02], [1.0, back_m, 0.0])
    }

    const fn wall(at_m: f32) -> Block {
        between([-4.0, at_m, -1.0], [4.0, at_m + 0.1, 2.0])
    }

    /// Finds the table in a shot of the things and what stands around them; its middle must be that of the things.
    /// Where the structure is that was found.
    fn structure_about(blocks: &[Block], down_rad: f32, noise_m: f32) -> Option<Vec3> {
        let (points, sides) = shot(&[&THINGS[..], blocks].concat(), down_rad, noise_m);
        let best = find_tables(&points, None, Some(sides), &mut Stream::new(1, 0, Purpose::Plane, 1))[0];
        let pose = eye(down_rad, 0.0);
        assert!(is_table(&best, pose.rotation.inverse() * Vec3::Z, -pose.translation.z), "{down_rad} {best:?}");
        let middle_m = pose * best.foot_m();
        assert!(middle_m.distance(Vec3::Y * 0.04) < 0.12, "{blocks:?} from {down_rad}: {middle_m}");
        best.structure_m.map(|at_m| pose * at_m)
    }

    #[test]
    fn a_wall_is_no_thing_wherever_it_crosses_the_tables_plane() {
        for at_m in [0.35, 0.6, 0.85, 1.35, 2.35] {
            for noise_m in [0.0, 0.004] {
                for down_rad in [0.35, 0.6, 0.9] {
                    let around = [vec![top(at_m), wall(at_m)], vec![top(0.3), FLOOR, wall(at_m)]];
                    for blocks in around {
                        let found = structure_about(&blocks, down_rad, noise_m);
                        // From higher up it is out of sight, and so far away nothing counts.
                        let is_seen = down_rad < 0.4 && at_m < 2.0;
                        assert!(
                            !is_seen || found.is_some_and(|there| (there.y - at_m).abs() < 0.1),
                            "{at_m} {found:?}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn what_stands_behind_draws_the_middle_from_no_things() {
        let board = |z_m: f32| between([-0.5, 0.9, z_m], [0.5, 1.2, z_m + 0.02]);
        let stored = |x_m: f32, z_m: f32| between([x_m, 0.95, z_m + 0.02], [x_m + 0.15, 1.05, z_m + 0.2]);
        let back = between([-0.5, 1.18, 0.0], [0.5, 1.2, 0.9]);
        let mut shelf = vec![top(3.0), back];
        for z_m in [0.0, 0.3, 0.6] {
            shelf.extend([board(z_m), stored(-0.4, z_m), stored(-0.1, z_m), stored(0.2, z_m)]);
        }
        let second = [between([-0.7, 0.9, -0.02], [0.7, 1.6, 0.0]), between([-0.4, 1.0, 0.0], [-0.2, 1.2, 0.3])];
        let second = [&second[..], &[between([0.1, 0.95, 0.0], [0.4, 1.1, 0.25]), FLOOR, top(0.5), wall(1.8)]].concat();
        let person = vec![between([-0.3, 0.8, -0.75], [0.15, 1.05, 0.6]), FLOOR, top(0.5)];
        let cupboard = vec![between([-2.0, 0.7, 0.0], [2.0, 1.2, 1.1]), top(3.0)];
        for blocks in [shelf, second, person, cupboard] {
            for down_rad in [0.35, 0.6] {
                assert!(structure_about(&blocks, down_rad, 0.002).is_some());
            }
        }
        for blocks in [vec![top(3.0)], vec![top(0.3), FLOOR]] {
            assert_eq!(structure_about(&blocks, 0.35, 0.0), None);
        }
    }

    /// The highest of things before nothing is cut by no image; without its sides nobody knows.
    #[test]
    fn an_image_may_show_nothing_above_things() {
        let (points, sides) = shot(&[&THINGS[..], &[top(0.3)]].concat(), 0.35, 0.0);
        let found = |sides| find_tables(&points, None, sides, &mut Stream::new(1, 0, Purpose::Plane, 1))[0].structure_m;
        assert!(found(Some(sides)).is_none() && found(None).is_some());
    }
}
