//! Cuts off convex parts what they fill and the mesh does not.
//!
//! The hull of a piece of a round wall also fills the arc behind it. No further piece is needed to mend that: a plane
//! that cuts into the arc takes away more of the void than of the wall. Counted on a grid of points, void and what
//! another part fills too count as gained, wall that no other part fills as lost; the plane that gains most is cut,
//! again and again until nothing is worth it or too much would be lost.

use schema::{Plane, Polyhedron, Vec3, bounds_m};

use super::{FLAT_SHARE, simplified};

/// Points of the grid along the mesh's longest side.
const POINTS: f32 = 160.0;
/// A cut must gain at least this share of its part.
const GAIN_SHARE: f32 = 0.03;
/// A part loses at most this share of the wall that it fills alone: a wall with gaps is worse than a thick one.
const LOSS_SHARE: f32 = 0.2;
/// Most cuts of one part.
const CUTS_MAX: usize = 6;
/// What a point of the mesh loses, in halves of what a point of the void gains.
const SOLID_WEIGHT: i32 = 3;
/// Directions that are tried first, over the whole sphere.
const DIRECTIONS: usize = 128;
/// Rounds in which the best direction is turned by half as much as in the one before, beginning with this angle.
const TURNS: usize = 4;
const TURN_RAD: f32 = 0.2;
/// Offsets that are tried along a direction.
const OFFSETS: usize = 64;

/// The parts with what a closed mesh does not fill cut off, each with at most `corners_max` corners.
pub(super) fn trimmed(
    parts: Vec<Polyhedron>,
    corners_m: &[Vec3],
    triangles: &[[u32; 3]],
    corners_max: usize,
) -> Vec<Polyhedron> {
    let mut grid = Grid::of(corners_m, triangles);
    for part in &parts {
        grid.points_in(part).iter().for_each(|(i, _)| grid.parts[*i] += 1);
    }
    let cut = |mut part: Polyhedron| {
        let mut points = grid.points_in(&part);
        let alone =
            |grid: &Grid, points: &[(usize, Vec3)]| points.iter().filter(|(i, _)| grid.is_lost_without(*i)).count();
        let mut may_lose = (LOSS_SHARE * alone(&grid, &points) as f32) as usize;
        for _ in 0..CUTS_MAX {
            let Some(smaller) = grid.best_cut(&points, may_lose).and_then(|plane| below(&part, &plane, corners_max))
            else {
                break;
            };
            let left = grid.points_in(&smaller);
            may_lose = may_lose.saturating_sub(alone(&grid, &points).saturating_sub(alone(&grid, &left)));
            points.iter().for_each(|(i, _)| grid.parts[*i] -= 1);
            left.iter().for_each(|(i, _)| grid.parts[*i] += 1);
            (part, points) = (smaller, left);
        }
        part
    };
    parts.into_iter().map(cut).collect()
}

/// What lies below a plane. `None` if that is no hull or has too many corners.
fn below(part: &Polyhedron, plane: &Plane, corners_max: usize) -> Option<Polyhedron> {
    let above_m = |c: &Vec3| plane.normal.dot(*c) - plane.offset_m;
    let (above, kept): (Vec<Vec3>, Vec<Vec3>) = part.corners_m().iter().partition(|c| above_m(c) > 0.0);
    // Not only along edges: the others lie within the face that the edges leave.
    let crossing = |a: &Vec3, b: &Vec3| *b + (*a - *b) * (above_m(b) / (above_m(b) - above_m(a)));
    let crossings = above.iter().flat_map(|a| kept.iter().map(move |b| crossing(a, b)));
    let points: Vec<Vec3> = kept.iter().copied().chain(crossings).collect();
    let [low, high] = bounds_m(part.corners_m());
    simplified(&points, corners_max, FLAT_SHARE * (high - low).max_element()).ok().map(|(hull, _)| hull)
}

/// Points a step apart over a mesh's bounding box: whether they lie in the mesh, and in how many parts.
struct Grid {
    low: Vec3,
    step_m: f32,
    counts: [usize; 3],
    is_solid: Vec<bool>,
    parts: Vec<u16>,
}

impl Grid {
    fn of(corners_m: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let [low, high] = bounds_m(corners_m);
        let step_m = (high - low).max_element() / POINTS;
        let counts = ((high - low) / step_m).ceil().max(Vec3::ONE).to_array().map(|n| n as usize);
        let points = counts.iter().product();
        let mut grid = Self { low, step_m, counts, is_solid: vec![false; points], parts: vec![0; points] };
        for (column, mut crossings) in grid.crossings(corners_m, triangles).into_iter().enumerate() {
            crossings.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut winding = 0;
            for pair in crossings.windows(2) {
                winding += pair[0].1;
                if winding != 0 {
                    let [from, to] = [pair[0].0, pair[1].0].map(|z| grid.first_above(z, 2));
                    grid.is_solid[column * counts[2] + from..column * counts[2] + to].fill(true);
                }
            }
        }
        grid
    }

    /// Where vertical lines through the columns cross the mesh: z in metres, 1 upwards into it and −1 out of it.
    fn crossings(&self, corners_m: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec<(f32, i32)>> {
        let mut columns = vec![Vec::new(); self.counts[0] * self.counts[1]];
        for triangle in triangles {
            let corners = triangle.map(|i| corners_m[i as usize]);
            // Twice the area to the left of an edge; an edge of two triangles gives the same number but for its sign.
            let edge = |a: usize, b: usize, x: f64, y: f64| {
                let (from, to, sign) = if triangle[a] < triangle[b] { (a, b, 1.0) } else { (b, a, -1.0) };
                let ([ax, ay, _], [bx, by, _]) = (corners[from].to_array(), corners[to].to_array());
                let [ax, ay, bx, by] = [ax, ay, bx, by].map(f64::from);
                let area = (bx - ax) * (y - ay) - (by - ay) * (x - ax);
                (sign * area, if area == 0.0 { sign > 0.0 } else { sign * area > 0.0 })
            };
            let [low, high] = bounds_m(&corners);
            for i in self.first_above(low.x, 0)..self.first_above(high.x, 0) {
                for j in self.first_above(low.y, 1)..self.first_above(high.y, 1) {
                    let at = self.at([i, j, 0]);
                    let edges = [(1, 2), (2, 0), (0, 1)].map(|(a, b)| edge(a, b, at.x.into(), at.y.into()));
                    let is_left = edges.map(|(_, is_left)| is_left);
                    if is_left == [true; 3] || is_left == [false; 3] {
                        let areas = edges.map(|(area, _)| area);
                        let all: f64 = areas.iter().sum();
                        if all != 0.0 {
                            let z: f64 = areas.iter().zip(corners).map(|(area, c)| area * f64::from(c.z)).sum();
                            columns[i * self.counts[1] + j].push(((z / all) as f32, if all > 0.0 { -1 } else { 1 }));
                        }
                    }
                }
            }
        }
        columns
    }

    fn at(&self, indices: [usize; 3]) -> Vec3 {
        self.low + (Vec3::from_array(indices.map(|i| i as f32)) + 0.5) * self.step_m
    }

    /// The first index along an axis whose point is not below this coordinate.
    fn first_above(&self, coordinate_m: f32, axis: usize) -> usize {
        let index = ((coordinate_m - self.low[axis]) / self.step_m - 0.5).ceil().max(0.0) as usize;
        index.min(self.counts[axis])
    }

    /// The points in a part, with their numbers.
    fn points_in(&self, part: &Polyhedron) -> Vec<(usize, Vec3)> {
        let planes: Vec<Plane> = part.planes().collect();
        let [low, high] = bounds_m(part.corners_m());
        let range = |axis: usize| self.first_above(low[axis], axis)..self.first_above(high[axis], axis);
        let mut points = Vec::new();
        for i in range(0) {
            for j in range(1) {
                for k in range(2) {
                    let at = self.at([i, j, k]);
                    if planes.iter().all(|plane| plane.normal.dot(at) <= plane.offset_m) {
                        points.push(((i * self.counts[1] + j) * self.counts[2] + k, at));
                    }
                }
            }
        }
        points
    }

    /// Whether a point is in the mesh and in one part only.
    fn is_lost_without(&self, point: usize) -> bool {
        self.is_solid[point] && self.parts[point] == 1
    }

    /// The plane above which most is gained and at most so many points of the mesh are lost. `None` if that is too
    /// little.
    fn best_cut(&self, points: &[(usize, Vec3)], may_lose: usize) -> Option<Plane> {
        let are_lost: Vec<bool> = points.iter().map(|(i, _)| self.is_lost_without(*i)).collect();
        let best = |directions: Vec<Vec3>| {
            let cuts = directions.into_iter().map(|direction| cut_along(direction, points, &are_lost, may_lose));
            cuts.max_by_key(|(gain, _)| *gain)
        };
        let golden = core::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
        let mut cut = best(
            (0..DIRECTIONS)
                .map(|i| {
                    let z = 1.0 - (2.0 * i as f32 + 1.0) / DIRECTIONS as f32;
                    let (sin, cos) = libm::sincosf(golden * i as f32);
                    Vec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
                })
                .collect(),
        )?;
        for turn in 0..TURNS {
            let normal = cut.1.normal;
            let (u, v) = normal.any_orthonormal_pair();
            let angle = TURN_RAD / (1 << turn) as f32;
            let turned = [u, -u, v, -v].map(|side| (normal + angle * side).normalize());
            let better = best(turned.to_vec())?;
            if better.0 > cut.0 {
                cut = better;
            }
        }
        let (gain, plane) = cut;
        (gain as f32 > GAIN_SHARE * 2.0 * points.len() as f32).then_some(plane)
    }
}

/// The best plane across one direction, and what is gained above it.
fn cut_along(direction: Vec3, points: &[(usize, Vec3)], are_lost: &[bool], may_lose: usize) -> (i32, Plane) {
    let heights: Vec<f32> = points.iter().map(|(_, at)| direction.dot(*at)).collect();
    let low = heights.iter().copied().fold(f32::INFINITY, f32::min);
    let high = heights.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let bin_m = (high - low) / OFFSETS as f32;
    // Points that are gained and that are lost.
    let mut bins = [[0, 0]; OFFSETS];
    for (height, is_lost) in heights.iter().zip(are_lost) {
        bins[(((height - low) / bin_m) as usize).min(OFFSETS - 1)][usize::from(*is_lost)] += 1;
    }
    let mut best = (0, high);
    let [mut gained, mut lost] = [0, 0];
    // Never all of it.
    for bin in (1..OFFSETS).rev() {
        gained += bins[bin][0];
        lost += bins[bin][1];
        let gain = 2 * gained - SOLID_WEIGHT * lost;
        if gain > best.0 && lost as usize <= may_lose {
            best = (gain, low + bin as f32 * bin_m);
        }
    }
    (best.0, Plane { normal: direction, offset_m: best.1 })
}

#[cfg(test)]
mod tests {
    use core::f32::consts::PI;

    use schema::{Purpose, Stream};

    use super::super::{PartsParams, convex_parts};
    use super::*;

    const AROUND: u32 = 64;

    /// A closed mesh: an outline of radii and heights, in millimetres, turned about z. What touches the axis has
    /// corners there that coincide.
    fn revolved(outline_mm: &[[f32; 2]]) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let about = |[r, z]: [f32; 2]| {
            (0..AROUND).map(move |k| {
                let (sin, cos) = libm::sincosf(2.0 * PI * k as f32 / AROUND as f32);
                Vec3::new(r * cos, r * sin, z) * 1e-3
            })
        };
        let rings = outline_mm.len() as u32;
        let triangles = (0..rings).flat_map(|ring| {
            (0..AROUND).flat_map(move |k| {
                let [a, b] = [k, (k + 1) % AROUND].map(|k| ring * AROUND + k);
                let [d, c] = [k, (k + 1) % AROUND].map(|k| (ring + 1) % rings * AROUND + k);
                [[a, b, c], [a, c, d]]
            })
        });
        (outline_mm.iter().flat_map(|point| about(*point)).collect(), triangles.collect())
    }

    fn quarter(radius_mm: f32, centre_mm: f32) -> impl DoubleEndedIterator<Item = [f32; 2]> {
        (0..=16).map(move |i| {
            let (sin, cos) = libm::sincosf(0.5 * PI * i as f32 / 16.0);
            [radius_mm * sin, centre_mm - radius_mm * cos]
        })
    }

    fn is_within(outline_mm: &[[f32; 2]], point: Vec3) -> bool {
        let [r, z] = [point.truncate().length() * 1e3, point.z * 1e3];
        let next = outline_mm.iter().cycle().skip(1);
        let crossed = outline_mm
            .iter()
            .zip(next)
            .filter(|([r0, z0], [r1, z1])| (*z0 > z) != (*z1 > z) && r < r0 + (z - z0) / (z1 - z0) * (r1 - r0));
        crossed.count() % 2 == 1
    }

    /// Asked of points by formula: whether the parts fill the wall, and nothing but the wall.
    #[test]
    fn thin_round_walls_are_followed() {
        let ring = vec![[24.0, 0.0], [30.0, 0.0], [30.0, 20.0], [24.0, 20.0]];
        let mug = vec![[0.0, 0.0], [40.0, 0.0], [40.0, 90.0], [36.0, 90.0], [36.0, 4.0], [0.0, 4.0]];
        let bowl = quarter(50.0, 50.0).chain(quarter(45.0, 50.0).rev()).collect();
        let outside =
            [[0.0, 0.0], [30.0, 0.0], [30.0, 90.0], [26.0, 105.0], [14.0, 120.0], [12.0, 130.0], [12.0, 150.0]];
        let inside = [[9.0, 150.0], [9.0, 129.0], [11.3, 118.0], [23.6, 103.5], [27.0, 89.0], [27.0, 3.0], [0.0, 3.0]];
        let bottle = [outside, inside].concat();
        let [mut all_before, mut all_after] = [0.0_f32; 2];
        for (name, outline) in [("ring", ring), ("mug", mug), ("bowl", bowl), ("bottle", bottle)] {
            let (corners, triangles) = revolved(&outline);
            let params =
                PartsParams { parts_max: 32, corners_max: 32, resolution: 96, concavity: 0.002, is_closed: true };
            let share = |params: &PartsParams| {
                let parts = convex_parts(&corners, &triangles, params).unwrap().hulls;
                assert!(parts.len() <= 32 && parts.iter().all(|part| part.corners_m().len() <= 32), "{name}");
                let planes: Vec<Vec<Plane>> = parts.iter().map(|part| part.planes().collect()).collect();
                let [low, high] = bounds_m(&corners);
                let mut stream = Stream::new(5, 0, Purpose::Objects, 0);
                let [mut wall, mut filled, mut void] = [0.0_f32; 3];
                for _ in 0..60_000 {
                    let at = stream.point(low, high);
                    let parts =
                        planes.iter().filter(|p| p.iter().all(|p| p.normal.dot(at) <= p.offset_m)).count() as f32;
                    match is_within(&outline, at) {
                        true => (wall, filled) = (wall + 1.0, filled + parts.min(1.0)),
                        false => void += parts,
                    }
                }
                [filled / wall, void / wall]
            };
            let [filled, void] = share(&params);
            assert!(filled > 0.85 && void < 0.13, "{name}: {filled} of the wall, {void} of void");
            assert!((filled + void - 1.0).abs() < 0.1, "{name}: {filled} of the wall, {void} of void");
            let [_, before] = share(&PartsParams { is_closed: false, ..params });
            assert!(before >= void, "{name}: {before} of void without cuts, {void} with them");
            [all_before, all_after] = [all_before + before, all_after + void];
        }
        // Of the ring so many voxels leave nothing to cut.
        assert!(all_before > 2.0 * all_after, "{all_before} of void without cuts, {all_after} with them");
    }
}
