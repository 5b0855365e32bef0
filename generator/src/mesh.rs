//! A triangle mesh from a file: merges equal corners and determines whether the mesh is closed.

use std::collections::BTreeMap;

use schema::Vec3;

/// Triangles in space, in metres. Corners at exactly the same position are merged.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    corners_m: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    degenerate_count: usize,
}

/// How a mesh's triangles meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Seams {
    /// Edges that do not belong to exactly two triangles.
    pub open_edges: usize,
    /// Edges that both triangles traverse in the same direction, so one of the two is inside out.
    pub twisted_edges: usize,
}

impl Seams {
    /// Whether the mesh encloses a volume: every edge belongs to two triangles that traverse it in opposite directions.
    #[must_use]
    pub fn is_watertight(self) -> bool {
        self.open_edges == 0 && self.twisted_edges == 0
    }
}

/// Why triangles are refused as a mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// There are none.
    #[error("it has no triangles")]
    Empty,
    /// There are too many.
    #[error("it must have at most {TRIANGLES_MAX} triangles, got {0}: simplify it first")]
    TooMany(usize),
    /// A coordinate is not finite.
    #[error("its coordinates must be numbers, got {1} at corner {0}")]
    NotANumber(usize, f64),
    /// A triangle has an index without a corner.
    #[error("triangle {triangle} names corner {corner}, and there are {count}")]
    NoSuchCorner {
        /// The triangle, from 0.
        triangle: usize,
        /// The index, from 0.
        corner: u32,
        /// How many there are.
        count: usize,
    },
}

/// Maximum number of triangles of a mesh.
pub const TRIANGLES_MAX: usize = 1_000_000;

impl Mesh {
    /// A mesh from corners in the file's units of `scale_m` metres, and triangles as corner indices.
    ///
    /// # Errors
    /// [`MeshError`].
    pub fn new(corners: &[[f64; 3]], triangles: &[[u32; 3]], scale_m: f64) -> Result<Self, MeshError> {
        if triangles.is_empty() {
            return Err(MeshError::Empty);
        }
        if triangles.len() > TRIANGLES_MAX {
            return Err(MeshError::TooMany(triangles.len()));
        }
        let mut numbers: BTreeMap<[u64; 3], u32> = BTreeMap::new();
        let mut corners_m = Vec::new();
        let mut number_of = Vec::with_capacity(corners.len());
        for (place, corner) in corners.iter().enumerate() {
            let metres = corner.map(|x| x * scale_m + 0.0); // −0 is 0
            if let Some(x) = metres.into_iter().find(|x| !x.is_finite()) {
                return Err(MeshError::NotANumber(place, x));
            }
            number_of.push(*numbers.entry(metres.map(f64::to_bits)).or_insert_with(|| {
                corners_m.push(metres);
                corners_m.len() as u32 - 1
            }));
        }
        let mut joined = Vec::with_capacity(triangles.len());
        for (place, triangle) in triangles.iter().enumerate() {
            if let Some(corner) = triangle.iter().copied().find(|i| *i as usize >= number_of.len()) {
                return Err(MeshError::NoSuchCorner { triangle: place, corner, count: number_of.len() });
            }
            joined.push(triangle.map(|i| number_of[i as usize]));
        }
        let is_flat = |[a, b, c]: &[u32; 3]| a == b || b == c || a == c;
        let mut triangles: Vec<[u32; 3]> = joined.iter().copied().filter(|t| !is_flat(t)).collect();
        let degenerate_count = joined.len() - triangles.len();
        let corners_m = used_alone(&corners_m, &mut triangles);
        if triangles.is_empty() { Err(MeshError::Empty) } else { Ok(Self { corners_m, triangles, degenerate_count }) }
    }

    /// The corners, in metres.
    #[must_use]
    pub fn corners_m(&self) -> &[[f64; 3]] {
        &self.corners_m
    }

    /// The triangles as corner indices.
    #[must_use]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Number of the file's triangles with two equal corners; they are dropped.
    #[must_use]
    pub fn degenerate_count(&self) -> usize {
        self.degenerate_count
    }

    /// The lower and the upper corner of the bounding box of all triangles, in metres.
    #[must_use]
    pub fn bounds_m(&self) -> [[f64; 3]; 2] {
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for corner in self.triangles.iter().flatten().map(|i| self.corners_m[*i as usize]) {
            for (axis, x) in corner.into_iter().enumerate() {
                bounds[0][axis] = bounds[0][axis].min(x);
                bounds[1][axis] = bounds[1][axis].max(x);
            }
        }
        bounds
    }

    /// Every triangle's corners about a point, in metres.
    pub fn triangles_about(&self, origin_m: [f64; 3]) -> impl Iterator<Item = [[f64; 3]; 3]> + '_ {
        let about = move |i: u32| core::array::from_fn(|axis| self.corners_m[i as usize][axis] - origin_m[axis]);
        self.triangles.iter().map(move |triangle| triangle.map(about))
    }

    /// The corners about a point in single precision, in metres.
    #[must_use]
    pub fn corners_about(&self, origin_m: [f64; 3]) -> Vec<Vec3> {
        let about = |c: &[f64; 3]| Vec3::from_array(core::array::from_fn(|axis| (c[axis] - origin_m[axis]) as f32));
        self.corners_m.iter().map(about).collect()
    }

    /// The same surface with reversed orientation.
    #[must_use]
    pub fn turned_inside_out(mut self) -> Self {
        self.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        self
    }

    /// How the triangles meet at their edges.
    #[must_use]
    pub fn seams(&self) -> Seams {
        // For every edge, the number of triangles that traverse it in ascending and descending order of indices.
        let mut edges: BTreeMap<[u32; 2], [u32; 2]> = BTreeMap::new();
        for [a, b, c] in &self.triangles {
            for (from, to) in [(*a, *b), (*b, *c), (*c, *a)] {
                let ways = edges.entry([from.min(to), from.max(to)]).or_default();
                ways[usize::from(from > to)] += 1;
            }
        }
        let open_edges = edges.values().filter(|[up, down]| up + down != 2).count();
        let twisted_edges = edges.values().filter(|[up, down]| up + down == 2 && up != down).count();
        Seams { open_edges, twisted_edges }
    }
}

/// The corners that belong to a triangle, in order; unused corners of a scan are dropped.
fn used_alone(corners_m: &[[f64; 3]], triangles: &mut [[u32; 3]]) -> Vec<[f64; 3]> {
    let mut used = vec![false; corners_m.len()];
    triangles.iter().flatten().for_each(|corner| used[*corner as usize] = true);
    let mut next = 0;
    let mut number = |used: &bool| {
        next += u32::from(*used);
        next.saturating_sub(1) // index of the last kept corner; never read for an unused corner
    };
    let numbers: Vec<u32> = used.iter().map(&mut number).collect();
    triangles.iter_mut().flatten().for_each(|corner| *corner = numbers[*corner as usize]);
    corners_m.iter().zip(&used).filter(|(_, used)| **used).map(|(corner, _)| *corner).collect()
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
        assert_eq!((mesh.corners_m(), mesh.triangles()), (&corners[..], &triangles[..]));
    }

    #[test]
    fn a_box_is_watertight_and_with_a_hole_or_a_turned_triangle_it_is_not() {
        let (corners, triangles) = closed_box([1.0, 2.0, 3.0]);
        let seams = |triangles: &[[u32; 3]]| Mesh::new(&corners, triangles, 1.0).unwrap().seams();
        assert_eq!(seams(&triangles), Seams { open_edges: 0, twisted_edges: 0 });
        assert_eq!(seams(&triangles[1..]), Seams { open_edges: 3, twisted_edges: 0 });
        let mut turned = triangles.clone();
        turned[3].swap(0, 1);
        assert_eq!(seams(&turned), Seams { open_edges: 0, twisted_edges: 3 });
        assert!(!seams(&turned).is_watertight());
    }

    #[test]
    fn corners_told_for_every_triangle_are_one() {
        let (corners, triangles) = closed_box([1.0, 1.0, 1.0]);
        let soup: Vec<[f64; 3]> = triangles.iter().flatten().map(|i| corners[*i as usize]).collect();
        let numbers: Vec<[u32; 3]> = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let mesh = Mesh::new(&soup, &numbers, 0.001).unwrap();
        assert_eq!(mesh.corners_m().len(), 8);
        assert!(mesh.seams().is_watertight());
        assert_eq!(mesh.bounds_m(), [[0.0; 3], [0.001; 3]]);
    }

    #[test]
    fn what_is_no_mesh_is_refused() {
        let (mut corners, mut triangles) = closed_box([1.0, 1.0, 1.0]);
        assert_eq!(Mesh::new(&corners, &[], 1.0), Err(MeshError::Empty));
        assert_eq!(Mesh::new(&corners, &[[0, 0, 1]], 1.0), Err(MeshError::Empty), "no triangle has an area");
        triangles[4] = [0, 1, 8];
        let error = Mesh::new(&corners, &triangles, 1.0).unwrap_err();
        assert_eq!(error.to_string(), "triangle 4 names corner 8, and there are 8");
        corners[5][1] = f64::NAN;
        let error = Mesh::new(&corners, &triangles, 1.0).unwrap_err();
        assert_eq!(error.to_string(), "its coordinates must be numbers, got NaN at corner 5");
        let many = vec![[0, 1, 2]; TRIANGLES_MAX + 1];
        assert_eq!(Mesh::new(&corners, &many, 1.0), Err(MeshError::TooMany(TRIANGLES_MAX + 1)));
    }
}
