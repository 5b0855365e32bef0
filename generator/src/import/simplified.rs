//! A mesh of fewer triangles that is nowhere farther than a tenth of a millimetre from the one that it is made of.
//!
//! A corner is drawn onto a neighbour, and its triangles with it, if the triangles about it, seen along their mean
//! normal, tile the same outline before and after. Along that normal the distance between both surfaces is linear
//! wherever two triangles lie on each other: it is largest at the corner, or where an old edge crosses a new one, and
//! no point of either surface is farther from the other one. Distances add up, so each triangle keeps how far it may be
//! from the first mesh by now.

use glamx::DVec3;
use schema::TriangleMesh;

use crate::mesh::Mesh;

/// How far both surfaces may be from each other, in metres: 0.1 mm, less the rounding of corners, here and where a
/// catalogue is read.
const OFF_M: f64 = 0.000_099_7;
/// Shares of that, which corners may cost one after the other: what costs least goes first.
const SHARES: [f64; 3] = [1.0 / 16.0, 0.25, 1.0];
/// Corners with more triangles stay.
const ABOUT_MAX: usize = 16;
/// New triangles are no narrower: twice their area as a share of their longest side's square.
const NARROW_SHARE: f64 = 1e-3;
/// So are old ones, by which rounding would decide.
const ROUNDING_SHARE: f64 = 1e-9;

/// The simplified mesh about a point.
///
/// # Errors
/// If its corners lie so far from that point that a catalogue cannot have them.
pub(super) fn simplified(mesh: &Mesh, origin_m: DVec3) -> Result<TriangleMesh, String> {
    let mut about = vec![Vec::new(); mesh.corners_m.len()];
    for (number, triangle) in (0..).zip(&mesh.triangles) {
        triangle.iter().for_each(|corner| about[*corner as usize].push(number));
    }
    let off_m = vec![0.0; mesh.triangles.len()];
    let mut thinned = Thinned { corners_m: &mesh.corners_m, triangles: mesh.triangles.clone(), about, off_m };
    for share in SHARES {
        (0..mesh.corners_m.len() as u32).for_each(|corner| thinned.draw_in(corner, share * OFF_M));
    }
    let (mut corners_m, mut number_of) = (Vec::new(), vec![0; mesh.corners_m.len()]);
    for (corner, _) in thinned.about.iter().enumerate().filter(|(_, about)| !about.is_empty()) {
        number_of[corner] = corners_m.len() as u32;
        corners_m.push((mesh.corners_m[corner] - origin_m).as_vec3());
    }
    let left = thinned.triangles.iter().zip(&thinned.off_m).filter(|(_, off_m)| off_m.is_finite());
    let triangles = left.map(|(triangle, _)| triangle.map(|corner| number_of[corner as usize])).collect();
    TriangleMesh::new(&corners_m, triangles)
}

/// A mesh while corners are taken away.
struct Thinned<'a> {
    corners_m: &'a [DVec3],
    triangles: Vec<[u32; 3]>,
    /// The triangles at each corner; none once it is away.
    about: Vec<Vec<u32>>,
    /// How far each triangle may be from the first mesh, in metres; infinite if it is away.
    off_m: Vec<f64>,
}

/// The neighbours of a corner, counter-clockwise, and where they are from it: across the mean normal, and along it (z).
struct Star {
    ring: Vec<u32>,
    at_m: Vec<DVec3>,
}

impl Thinned<'_> {
    /// Takes a corner away where that costs least, if it may cost so much.
    fn draw_in(&mut self, corner: u32, most_m: f64) {
        let about = &self.about[corner as usize];
        let before_m = about.iter().map(|number| self.off_m[*number as usize]).fold(0.0, f64::max);
        if before_m > most_m {
            return;
        }
        let Some(star) = self.star(corner) else { return };
        let costs = (0..star.ring.len()).filter_map(|onto| Some((before_m + star.moved_m(onto)?, star.ring[onto])));
        let fits = costs.filter(|(off_m, onto)| *off_m <= most_m && self.stays_whole(corner, &star.ring, *onto));
        let Some((off_m, onto)) = fits.min_by(|a, b| a.0.total_cmp(&b.0)) else { return };
        for number in core::mem::take(&mut self.about[corner as usize]) {
            let (place, triangle) = (number as usize, self.triangles[number as usize]);
            if triangle.contains(&onto) {
                triangle.iter().for_each(|other| self.about[*other as usize].retain(|of| *of != number));
                self.off_m[place] = f64::INFINITY;
            } else {
                self.triangles[place] = triangle.map(|other| if other == corner { onto } else { other });
                self.about[onto as usize].push(number);
                self.off_m[place] = off_m;
            }
        }
    }

    /// The other two corners of a triangle, in its order.
    fn side(&self, number: u32, corner: u32) -> [u32; 2] {
        match self.triangles[number as usize] {
            [a, b, c] if a == corner => [b, c],
            [a, b, c] if b == corner => [c, a],
            [a, b, _] => [a, b],
        }
    }

    /// The neighbours of a corner in order, if its triangles close around it and have no others there.
    fn ring(&self, corner: u32) -> Option<Vec<u32>> {
        let about = &self.about[corner as usize];
        if !(3..=ABOUT_MAX).contains(&about.len()) {
            return None;
        }
        let sides: Vec<[u32; 2]> = about.iter().map(|number| self.side(*number, corner)).collect();
        let after = |corner: u32| sides.iter().find(|[from, _]| *from == corner).map(|[_, to]| *to);
        let mut ring = vec![sides[0][0]];
        while ring.len() < sides.len() {
            let next = after(*ring.last()?).filter(|next| !ring.contains(next))?;
            ring.push(next);
        }
        (after(*ring.last()?)? == ring[0]).then_some(ring)
    }

    /// The star of a corner, if its triangles tile an outline around it once.
    fn star(&self, corner: u32) -> Option<Star> {
        let ring = self.ring(corner)?;
        let ways_m: Vec<DVec3> =
            ring.iter().map(|other| self.corners_m[*other as usize] - self.corners_m[corner as usize]).collect();
        let around = ways_m.iter().zip(ways_m.iter().cycle().skip(1));
        let normal = around.map(|(a, b)| a.cross(*b)).sum::<DVec3>().try_normalize()?;
        let x = normal.any_orthonormal_vector();
        let y = normal.cross(x);
        let at_m: Vec<DVec3> = ways_m.iter().map(|m| DVec3::new(x.dot(*m), y.dot(*m), normal.dot(*m))).collect();
        let (mut turns, mut is_tiled) = (0, true);
        for (a, b) in at_m.iter().zip(at_m.iter().cycle().skip(1)).map(|(a, b)| (a.truncate(), b.truncate())) {
            is_tiled &= a.perp_dot(b) > ROUNDING_SHARE * a.length_squared().max(b.length_squared());
            turns += u32::from(a.y <= 0.0 && b.y > 0.0);
        }
        (is_tiled && turns == 1).then_some(Star { ring, at_m })
    }

    /// Whether the surface stays one where a corner is drawn onto a neighbour: they have no others in common but the
    /// two beside their edge.
    fn stays_whole(&self, corner: u32, ring: &[u32], onto: u32) -> bool {
        let is_beside = |other: &u32| {
            let others = self.about[corner as usize].iter().map(|number| self.triangles[*number as usize]);
            others.filter(|triangle| triangle.contains(&onto)).any(|triangle| triangle.contains(other))
        };
        let beyond = self.about[onto as usize].iter().filter(|number| !self.about[corner as usize].contains(number));
        beyond.map(|number| self.side(*number, onto)).all(|side| {
            let is_closed = ring.len() == 3 && side.iter().all(is_beside);
            !is_closed && side.iter().all(|other| !ring.contains(other) || is_beside(other))
        })
    }
}

impl Star {
    /// How far the surface moves along the normal where the corner is drawn onto a neighbour, in metres; `None` if it
    /// would fold, or triangles would be too narrow.
    fn moved_m(&self, onto: usize) -> Option<f64> {
        let (count, from_m) = (self.at_m.len(), self.at_m[onto]);
        let to_corner = -from_m.truncate();
        let others: Vec<usize> = (1..count).map(|step| (onto + step) % count).collect();
        let ways_m: Vec<DVec3> = others.iter().map(|other| self.at_m[*other] - from_m).collect();
        let mut most_m: Option<f64> = None;
        for pair in ways_m.windows(2) {
            let [a, b] = [pair[0].truncate(), pair[1].truncate()];
            let area_m2 = a.perp_dot(b);
            let longest_m2 = a.length_squared().max(b.length_squared()).max(a.distance_squared(b));
            if area_m2 <= NARROW_SHARE * longest_m2 {
                return None;
            }
            let [share_a, share_b] = [to_corner.perp_dot(b) / area_m2, a.perp_dot(to_corner) / area_m2];
            if share_a >= 0.0 && share_b >= 0.0 {
                let height_m = from_m.z + share_a * pair[0].z + share_b * pair[1].z;
                most_m = Some(height_m.abs().max(most_m.unwrap_or(0.0)));
            }
        }
        // The first and the last of the new edges are of the outline.
        let inner = 1..ways_m.len() - 1;
        for (other, way_m) in others[inner.clone()].iter().zip(&ways_m[inner]) {
            let ends = [onto, *other];
            for (_, old_m) in self.at_m.iter().enumerate().filter(|(place, _)| !ends.contains(place)) {
                let (way, old) = (way_m.truncate(), old_m.truncate());
                let share = old.perp_dot(to_corner) / old.perp_dot(way);
                let old_share = (way * share - to_corner).dot(old) / old.length_squared();
                if (0.0..=1.0).contains(&share) && (0.0..=1.0).contains(&old_share) {
                    let height_m = from_m.z + share * way_m.z - old_share * old_m.z;
                    most_m = most_m.map(|most_m| most_m.max(height_m.abs()));
                }
            }
        }
        most_m
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use schema::{Purpose, Stream};

    use super::*;

    type Raw = (Vec<[f64; 3]>, Vec<[u32; 3]>);

    /// Both sides of a sheet of squares, and its rims: closed, and bent by `z_of`.
    fn slab(side: u32, z_of: impl Fn(f64, f64) -> f64) -> Raw {
        let at = |layer: u32, i: u32, j: u32| layer * (side + 1) * (side + 1) + i * (side + 1) + j;
        let along = |i: u32| 0.05 * (f64::from(i) / f64::from(side) - 0.5);
        let places = (0..=side).flat_map(|i| (0..=side).map(move |j| (along(i), along(j))));
        let corners = [0.0, 0.01].into_iter().flat_map(|up| places.clone().map(move |(x, y)| (x, y, up)));
        let corners = corners.map(|(x, y, up)| [x, y, z_of(x, y) + up]).collect();
        let quad = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
        let mut triangles = Vec::new();
        for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
            let corners = |layer| [at(layer, i, j), at(layer, i + 1, j), at(layer, i + 1, j + 1), at(layer, i, j + 1)];
            let [a, b, c, d] = corners(0);
            triangles.extend(quad([d, c, b, a]));
            triangles.extend(quad(corners(1)));
        }
        let rim: Vec<[u32; 2]> = (0..side).flat_map(|k| [[k, 0], [side, k], [side - k, side], [0, side - k]]).collect();
        let after = |[i, j]: [u32; 2]| match (i, j) {
            (i, 0) if i < side => [i + 1, 0],
            (i, j) if i == side && j < side => [i, j + 1],
            (i, j) if j == side && i > 0 => [i - 1, j],
            (i, j) => [i, j - 1],
        };
        for [i, j] in rim {
            let [k, l] = after([i, j]);
            triangles.extend(quad([at(0, i, j), at(0, k, l), at(1, k, l), at(1, i, j)]));
        }
        (corners, triangles)
    }

    /// A ball of 80 mm.
    fn ball(around: u32) -> Raw {
        let rings = around / 2 - 1;
        let corner = |ring: u32, side: u32| {
            let (down, turn) =
                (PI * f64::from(ring + 1) / f64::from(rings + 1), 2.0 * PI * f64::from(side) / f64::from(around));
            [libm::sin(down) * libm::cos(turn), libm::sin(down) * libm::sin(turn), libm::cos(down)].map(|x| 0.04 * x)
        };
        let mut corners = vec![[0.0, 0.0, 0.04], [0.0, 0.0, -0.04]];
        corners.extend((0..rings).flat_map(|ring| (0..around).map(move |side| corner(ring, side))));
        let at = |ring: u32, side: u32| 2 + ring * around + side % around;
        let mut triangles = Vec::new();
        for side in 0..around {
            triangles.extend([[0, at(0, side), at(0, side + 1)], [1, at(rings - 1, side + 1), at(rings - 1, side)]]);
            for ring in 0..rings - 1 {
                let [a, b, c, d] = [at(ring, side), at(ring, side + 1), at(ring + 1, side), at(ring + 1, side + 1)];
                triangles.extend([[a, c, b], [b, c, d]]);
            }
        }
        (corners, triangles)
    }

    fn mesh((corners, triangles): &Raw) -> Mesh {
        Mesh::new(corners, triangles, 1.0).unwrap()
    }

    /// The mesh again, with its corners in the order of a catalogue.
    fn as_mesh(made: &TriangleMesh) -> Mesh {
        let corners: Vec<[f64; 3]> = made.corners_m().iter().map(|m| m.as_dvec3().to_array()).collect();
        Mesh::new(&corners, made.triangles(), 1.0).unwrap()
    }

    fn distance_m(at: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let is_over = |[from, to]: [DVec3; 2]| normal.dot((to - from).cross(at - from)) >= 0.0;
        if [[a, b], [b, c], [c, a]].into_iter().all(is_over) {
            return normal.dot(at - a).abs();
        }
        let to_edge = |[from, to]: [DVec3; 2]| {
            let along = ((at - from).dot(to - from) / (to - from).length_squared()).clamp(0.0, 1.0);
            at.distance(from + (to - from) * along)
        };
        [[a, b], [b, c], [c, a]].map(to_edge).into_iter().fold(f64::INFINITY, f64::min)
    }

    /// How far points of one surface are from another, at most.
    fn farthest_m(from: &Mesh, to: &Mesh) -> f64 {
        let mut stream = Stream::new(3, 0, Purpose::Objects, 0);
        let mut point = |[a, b, c]: [DVec3; 3]| {
            let [u, v] = [0, 1].map(|_| f64::from(stream.uniform(0.0, 1.0)));
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            a + (b - a) * u + (c - a) * v
        };
        let some = from.triangles.len().div_ceil(400);
        let points: Vec<DVec3> = from.triangles_about(DVec3::ZERO).step_by(some).map(&mut point).collect();
        let nearest =
            |at: &DVec3| to.triangles_about(DVec3::ZERO).map(|t| distance_m(*at, t)).fold(f64::INFINITY, f64::min);
        points.iter().map(nearest).fold(0.0, f64::max)
    }

    /// Flat faces become two triangles each, or hardly more, and stay where they are.
    #[test]
    fn a_box_of_many_triangles_is_one_of_few() {
        let given = mesh(&slab(12, |_, _| 0.0));
        assert!(given.seams.is_watertight() && given.triangles.len() == 2 * 2 * 144 + 8 * 12);
        let made = as_mesh(&simplified(&given, DVec3::ZERO).unwrap());
        assert!((12..=20).contains(&made.triangles.len()) && made.seams == given.seams, "{}", made.triangles.len());
        assert!(farthest_m(&given, &made).max(farthest_m(&made, &given)) < 1e-7);
    }

    #[test]
    fn round_surfaces_lose_triangles_and_stay_within_the_bound_both_ways() {
        let wave = |x: f64, y: f64| 0.004 * libm::sin(150.0 * x) * libm::cos(90.0 * y);
        // Fewer than were given: a share, and a distance that is really used.
        for (given, most_share, least_m) in [(ball(64), 0.8, 2e-5), (slab(48, wave), 0.5, 2e-5), (ball(12), 1.0, 0.0)] {
            let given = mesh(&given);
            let made = as_mesh(&simplified(&given, DVec3::ZERO).unwrap());
            assert_eq!(made.seams, given.seams);
            let share = made.triangles.len() as f64 / given.triangles.len() as f64;
            assert!(share <= most_share, "{share} of {}", given.triangles.len());
            let off_m = [farthest_m(&given, &made), farthest_m(&made, &given)];
            assert!(off_m.iter().all(|off_m| (least_m..=1e-4).contains(off_m)), "{off_m:?}");
            // What is as coarse as that already is as it was.
            assert!(given.triangles.len() > 200 || made.triangles.len() == given.triangles.len());
        }
    }

    /// Rims of open meshes, and corners where two sheets meet, stay where they are; the frame is that of the point.
    #[test]
    fn rims_and_touching_sheets_stay() {
        let (corners, triangles) = slab(8, |_, _| 0.0);
        let open = mesh(&(corners, triangles[..256].iter().copied().filter(|[a, ..]| *a >= 81).collect()));
        let middle_m = DVec3::new(0.0, 0.0, 0.01);
        let made = simplified(&open, middle_m).unwrap();
        assert!(made.triangles().len() < 60, "{} of 128", made.triangles().len());
        assert_eq!(as_mesh(&made).seams.open_edges, 32, "no edge of the rim is gone");
        assert!(made.corners_m().iter().all(|corner_m| corner_m.z == 0.0));
        // Four triangles at one edge: two tents that share their ridge.
        let tents = (
            vec![
                [0.0, 0.0, 0.0],
                [0.0, 0.02, 0.0],
                [0.02, 0.01, 0.0],
                [-0.02, 0.01, 0.0],
                [0.0, 0.01, 0.02],
                [0.0, 0.01, -0.02],
            ],
            vec![[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 1, 5]],
        );
        assert_eq!(simplified(&mesh(&tents), DVec3::ZERO).unwrap().triangles().len(), 4);
    }
}
