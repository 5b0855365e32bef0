//! A triangle mesh from a file: merges equal corners and determines whether the mesh is closed.

use std::collections::{BTreeMap, BTreeSet};

use glamx::DVec3;

/// Triangles in space, in metres. Corners at exactly the same position are merged; if the mesh is open then, also those
/// within [`WELD_SHARE`] of its size, because CAD programs write the corners of neighbours one rounding step apart.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Mesh {
    /// The corners, in metres; each belongs to a triangle.
    pub(crate) corners_m: Vec<DVec3>,
    /// The triangles as corner indices.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// How the triangles meet at their edges.
    pub(crate) seams: Seams,
}

/// How a mesh's triangles meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Seams {
    /// Edges that do not belong to exactly two triangles.
    pub(crate) open_edges: usize,
    /// Edges that both triangles traverse in the same direction, so one of the two is inside out.
    pub(crate) twisted_edges: usize,
}

impl Seams {
    fn of(triangles: &[[u32; 3]]) -> Self {
        // For every edge, the number of triangles that traverse it in ascending and descending order of indices.
        let mut edges: BTreeMap<[u32; 2], [u32; 2]> = BTreeMap::new();
        for [a, b, c] in triangles {
            for (from, to) in [(*a, *b), (*b, *c), (*c, *a)] {
                let ways = edges.entry([from.min(to), from.max(to)]).or_default();
                ways[usize::from(from > to)] += 1;
            }
        }
        let open_edges = edges.values().filter(|[up, down]| up + down != 2).count();
        let twisted_edges = edges.values().filter(|[up, down]| up + down == 2 && up != down).count();
        Self { open_edges, twisted_edges }
    }

    /// Whether the mesh encloses a volume: every edge belongs to two triangles that traverse it in opposite directions.
    pub(crate) fn is_watertight(self) -> bool {
        self.open_edges == 0 && self.twisted_edges == 0
    }
}

/// Maximum number of triangles of a mesh.
pub(crate) const TRIANGLES_MAX: usize = 1_000_000;
/// Maximum number of corners: as many as triangles that share none have.
pub(crate) const CORNERS_MAX: usize = 3 * TRIANGLES_MAX;
/// A mesh covers the surface of its bounding box at most this often: each triangle is cut along all voxels that it
/// touches, so triangles across and across a body, which are no surface of one, would take minutes and hours.
const COVERS_MAX: f64 = 50.0;
/// Corners of an open mesh that are as near as this share of its longest side are one.
const WELD_SHARE: f64 = 1e-6;

impl Mesh {
    /// A mesh from corners in the file's units of `scale_m` metres, and triangles as corner indices.
    ///
    /// # Errors
    /// Why these are no mesh.
    pub(crate) fn new(corners: &[[f64; 3]], triangles: &[[u32; 3]], scale_m: f64) -> Result<Self, String> {
        let (count, triangle_count) = (corners.len(), triangles.len());
        if triangle_count > TRIANGLES_MAX {
            return Err(format!(
                "it must have at most {TRIANGLES_MAX} triangles, got {triangle_count}: simplify it first"
            ));
        }
        // Adding 0 makes 0 of −0.
        let all_m: Vec<DVec3> = corners.iter().map(|c| DVec3::from_array(*c) * scale_m + DVec3::ZERO).collect();
        // The first corner at a position stands for all that are there.
        let mut first_at: BTreeMap<[u64; 3], u32> = BTreeMap::new();
        let mut first_of = Vec::with_capacity(count);
        for (place, corner_m) in (0..).zip(&all_m) {
            if let Some(x) = corner_m.to_array().into_iter().find(|x| !x.is_finite()) {
                return Err(format!("its coordinates must be numbers, got {x} at corner {place}"));
            }
            first_of.push(*first_at.entry(corner_m.to_array().map(f64::to_bits)).or_insert(place));
        }
        let mut joined = Vec::with_capacity(triangle_count);
        for (place, triangle) in triangles.iter().enumerate() {
            if let Some(corner) = triangle.iter().find(|i| **i as usize >= count) {
                return Err(format!("triangle {place} names corner {corner}, and there are {count}"));
            }
            joined.push(triangle.map(|i| first_of[i as usize]));
        }
        let exact = Self::joined(&all_m, joined)?;
        let covers = exact.covers();
        if covers > COVERS_MAX {
            return Err(format!(
                "its triangles must cover the surface of its bounding box at most {COVERS_MAX} times, got {covers:.0}"
            ));
        }
        if exact.seams.is_watertight() { Ok(exact) } else { exact.welded() }
    }

    /// How often its triangles cover the surface of its bounding box.
    fn covers(&self) -> f64 {
        let [low, high] = self.bounds_m();
        let size_m = high - low;
        let box_m2 = 2.0 * (size_m.x * size_m.y + size_m.y * size_m.z + size_m.z * size_m.x);
        let area_m2 = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a).length();
        self.triangles_about(low).map(area_m2).sum::<f64>() / box_m2
    }

    /// The mesh of corners and triangles, whose equal corners have one number, that of the first.
    fn joined(all_m: &[DVec3], mut joined: Vec<[u32; 3]>) -> Result<Self, String> {
        joined.retain(|[a, b, c]| a != b && b != c && a != c);
        if joined.is_empty() {
            return Err("it has no triangles".to_owned());
        }
        // A triangle that is there once more, with the same side outside, is dropped.
        let mut seen = BTreeSet::new();
        joined.retain(|[a, b, c]| seen.insert([[*a, *b, *c], [*b, *c, *a], [*c, *a, *b]].into_iter().min()));
        // Corners of a scan that belong to no triangle are dropped.
        let mut used = joined.as_flattened().to_vec();
        used.sort_unstable();
        used.dedup();
        let number = |place: u32| used.partition_point(|other| *other < place) as u32;
        let triangles: Vec<[u32; 3]> = joined.into_iter().map(|triangle| triangle.map(number)).collect();
        Ok(Self {
            corners_m: used.iter().map(|place| all_m[*place as usize]).collect(),
            seams: Seams::of(&triangles),
            triangles,
        })
    }

    /// The mesh with one corner for all that are nearly at the same position: the first of them.
    fn welded(self) -> Result<Self, String> {
        let [low, high] = self.bounds_m();
        let near_m = (high - low).max_element() * WELD_SHARE;
        // Wide cells: few corners are near to a second one.
        let cell = |at_m: f64| (at_m / (8.0 * near_m)).floor() as i64;
        let mut kept: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
        let mut first_of = Vec::with_capacity(self.corners_m.len());
        for (place, corner_m) in (0..).zip(&self.corners_m) {
            let around = (*corner_m - low).to_array().map(|x| cell(x - near_m)..=cell(x + near_m));
            let [xs, ys, zs] = around;
            let cells = xs.flat_map(|x| {
                ys.clone().flat_map({
                    let zs = zs.clone();
                    move |y| zs.clone().map(move |z| [x, y, z])
                })
            });
            let is_near = |other: &u32| self.corners_m[*other as usize].distance_squared(*corner_m) <= near_m * near_m;
            let first = cells.filter_map(|cell| kept.get(&cell)?.iter().copied().find(is_near)).min();
            if first.is_none() {
                kept.entry((*corner_m - low).to_array().map(cell)).or_default().push(place);
            }
            first_of.push(first.unwrap_or(place));
        }
        let joined = self.triangles.iter().map(|triangle| triangle.map(|corner| first_of[corner as usize])).collect();
        Self::joined(&self.corners_m, joined)
    }

    /// The lower and the upper corner of the bounding box, in metres.
    pub(crate) fn bounds_m(&self) -> [DVec3; 2] {
        let corners_m = || self.corners_m.iter().copied();
        [corners_m().fold(DVec3::INFINITY, DVec3::min), corners_m().fold(DVec3::NEG_INFINITY, DVec3::max)]
    }

    /// Every triangle's corners about a point, in metres.
    pub(crate) fn triangles_about(&self, origin_m: DVec3) -> impl Iterator<Item = [DVec3; 3]> {
        self.triangles.iter().map(move |triangle| triangle.map(|i| self.corners_m[i as usize] - origin_m))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A box at the origin, as a closed mesh oriented outwards.
    pub(crate) fn closed_box(size: [f64; 3]) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
        let corner = |c: usize| core::array::from_fn(|axis| if c >> axis & 1 == 1 { size[axis] } else { 0.0 });
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        ((0..8).map(corner).collect(), triangles)
    }

    #[test]
    fn corners_that_no_triangle_has_are_not_of_the_object() {
        let (mut corners, mut triangles) = closed_box([1.0, 2.0, 3.0]);
        corners.insert(3, [9.0, 9.0, 9.0]);
        corners.push([7.0, 7.0, 7.0]);
        triangles.iter_mut().flatten().for_each(|corner| *corner += u32::from(*corner >= 3));
        let mesh = Mesh::new(&corners, &triangles, 1.0).unwrap();
        let (corners, triangles) = closed_box([1.0, 2.0, 3.0]);
        let corners: Vec<DVec3> = corners.into_iter().map(DVec3::from_array).collect();
        assert_eq!((mesh.corners_m, mesh.triangles), (corners, triangles));
    }

    #[test]
    fn a_box_is_watertight_and_with_a_hole_or_a_turned_triangle_it_is_not() {
        let (corners, triangles) = closed_box([1.0, 2.0, 3.0]);
        let seams = |triangles: &[[u32; 3]]| Mesh::new(&corners, triangles, 1.0).unwrap().seams;
        assert_eq!(seams(&triangles), Seams { open_edges: 0, twisted_edges: 0 });
        assert_eq!(seams(&triangles[1..]), Seams { open_edges: 3, twisted_edges: 0 });
        let mut turned = triangles.clone();
        turned[3].swap(0, 1);
        assert_eq!(seams(&turned), Seams { open_edges: 0, twisted_edges: 3 });
        assert!(!seams(&turned).is_watertight());
    }

    #[test]
    fn corners_repeated_for_every_triangle_are_one() {
        let (corners, triangles) = closed_box([1.0, 1.0, 1.0]);
        let soup: Vec<[f64; 3]> = triangles.iter().flatten().map(|i| corners[*i as usize]).collect();
        let numbers: Vec<[u32; 3]> = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let mesh = Mesh::new(&soup, &numbers, 0.001).unwrap();
        assert_eq!(mesh.corners_m.len(), 8);
        assert!(mesh.seams.is_watertight());
        assert_eq!(mesh.bounds_m(), [DVec3::ZERO, DVec3::splat(0.001)]);
    }

    #[test]
    fn corners_a_rounding_step_apart_are_one_and_those_of_a_thin_wall_are_not() {
        let (corners, triangles) = closed_box([1.0, 2.0, 3.0]);
        let apart = |step: f64| {
            let soup: Vec<[f64; 3]> = (0..)
                .zip(triangles.iter().flatten())
                .map(|(place, i)| corners[*i as usize].map(|x| x + step * f64::from(place % 3)))
                .collect();
            let numbers: Vec<[u32; 3]> = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
            Mesh::new(&soup, &numbers, 1.0).unwrap()
        };
        let welded = apart(6e-7); // the farthest are 1.2e-6 · √3 apart, of 3e-6
        assert_eq!((welded.corners_m.len(), welded.seams.is_watertight()), (8, true));
        assert!(!apart(3e-6).seams.is_watertight());
        let (thin, _) = closed_box([1.0, 2.0, 1e-7]);
        assert_eq!(Mesh::new(&thin, &triangles, 1.0).unwrap().corners_m.len(), 8, "a closed mesh is left alone");
    }

    #[test]
    fn triangles_across_a_body_are_no_surface() {
        let mut state = 1_u64;
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f64 / f64::from(1 << 24)
        };
        let corners: Vec<[f64; 3]> = (0..9_000).map(|_| [draw(), draw(), draw()]).collect();
        let triangles: Vec<[u32; 3]> = (0..3_000).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let error = Mesh::new(&corners, &triangles, 1.0).unwrap_err();
        assert!(error.contains("at most 50 times"), "{error}");
        Mesh::new(&corners[..600], &triangles[..200], 1.0).unwrap();
    }

    #[test]
    fn triangles_given_many_times_count_once_and_their_backs_are_others() {
        let (corners, triangles) = closed_box([1.0, 2.0, 3.0]);
        let turned = |[a, b, c]: &[u32; 3]| [*b, *c, *a];
        let doubled = [triangles.clone(), triangles.iter().map(turned).collect(), triangles.clone()].concat();
        let mesh = Mesh::new(&corners, &doubled, 1.0).unwrap();
        assert_eq!(mesh.triangles.len(), 12);
        assert!(mesh.seams.is_watertight());
        let backs: Vec<[u32; 3]> = triangles.iter().map(|[a, b, c]| [*c, *b, *a]).collect();
        let mesh = Mesh::new(&corners, &[triangles, backs].concat(), 1.0).unwrap();
        assert_eq!(mesh.triangles.len(), 24);
    }

    #[test]
    fn what_is_no_mesh_is_refused() {
        let (mut corners, mut triangles) = closed_box([1.0, 1.0, 1.0]);
        assert!(Mesh::new(&corners, &[], 1.0).is_err());
        assert!(Mesh::new(&corners, &[[0, 0, 1]], 1.0).is_err(), "none has an area");
        triangles[4] = [0, 1, 8];
        let error = Mesh::new(&corners, &triangles, 1.0).unwrap_err();
        assert!(error.contains("triangle 4") && error.contains("corner 8"), "{error}");
        corners[5][1] = f64::NAN;
        let error = Mesh::new(&corners, &triangles, 1.0).unwrap_err();
        assert!(error.contains("NaN") && error.contains("corner 5"), "{error}");
        let many = vec![[0, 1, 2]; TRIANGLES_MAX + 1];
        let error = Mesh::new(&corners, &many, 1.0).unwrap_err();
        assert!(error.contains("1000000") && error.contains("1000001"), "{error}");
    }
}
