//! What is measured of a mesh and of its convex parts.

use glamx::DVec3;
use schema::{MassIntegrals, Polyhedron, Vec3};
use simulator::hull_volume_m3;

use crate::mesh::{Mesh, Seams};

/// Lines along each side through a mesh, for finding shells that overlap.
const LINES: usize = 96;
/// Of what a closed mesh encloses, at most this share may lie in two of its shells, or in one that is inside out.
const CONFUSED_SHARE: f64 = 0.01;

/// A mesh and its measurements before decomposition.
pub(crate) struct Measured {
    pub(crate) mesh: Mesh,
    pub(crate) seams: Seams,
    pub(crate) was_inside_out: bool,
    pub(crate) extents_m: DVec3,
    /// The centre of the bounding box, in the file's frame; all other fields are relative to it.
    pub(crate) middle_m: DVec3,
    pub(crate) corners_m: Vec<Vec3>,
    /// The integrals, if the mesh is watertight and encloses a volume once.
    pub(crate) solid: Option<MassIntegrals>,
    /// The share of what a watertight mesh encloses that lies in several shells or in one that is inside out, if it is
    /// too much for the integrals.
    pub(crate) confused_share: Option<f64>,
    /// What a watertight mesh encloses, once or more, in cubic metres, along lines.
    pub(crate) enclosed_m3: f64,
    pub(crate) hull_volume_m3: f64,
}

impl Measured {
    pub(crate) fn of(mut mesh: Mesh) -> Self {
        let seams = mesh.seams;
        let [low, high] = mesh.bounds_m();
        let middle_m = 0.5 * (low + high);
        let integrals = MassIntegrals::of(mesh.triangles_about(middle_m));
        let was_inside_out = seams.is_watertight() && integrals.volume_m3 < 0.0;
        if was_inside_out {
            mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        let solid = seams.is_watertight().then(|| MassIntegrals::of(mesh.triangles_about(middle_m)));
        let [confused_share, enclosed_m3] = if seams.is_watertight() { enclosed(&mesh) } else { [0.0; 2] };
        let confused_share = Some(confused_share).filter(|share| *share > CONFUSED_SHARE);
        let corners_m: Vec<Vec3> = mesh.corners_m.iter().map(|corner_m| (*corner_m - middle_m).as_vec3()).collect();
        Self {
            seams,
            confused_share,
            enclosed_m3,
            was_inside_out,
            extents_m: high - low,
            middle_m,
            hull_volume_m3: hull_volume_m3(&corners_m).unwrap_or(0.0),
            corners_m,
            solid: solid.filter(|solid| solid.volume_m3 > 0.0 && confused_share.is_none()),
            mesh,
        }
    }
}

/// Of what a watertight mesh encloses the share that it encloses more than once, or inside out: along lines parallel to
/// z, where the number of shells around a point is not one; and the volume that it encloses, in cubic metres.
fn enclosed(mesh: &Mesh) -> [f64; 2] {
    let [low, high] = mesh.bounds_m();
    let step = (high - low) / LINES as f64;
    // Off the middle of the cells and off their diagonals, where corners and edges are likely to be.
    const OFFSET: [f64; 2] = [0.4371, 0.4093];
    let along = |axis: usize, k: usize| low[axis] + (k as f64 + OFFSET[axis]) * step[axis];
    let reach = |axis: usize, [a, b, c]: [DVec3; 3]| {
        let [least, most] = [a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis])];
        let first = ((least - low[axis]) / step[axis] - OFFSET[axis]).ceil().max(0.0) as usize;
        (first..LINES).take_while(move |k| along(axis, *k) < most)
    };
    let mut crossings = vec![Vec::new(); LINES * LINES];
    for triangle @ [a, b, c] in mesh.triangles_about(DVec3::ZERO) {
        let [u, v] = [b - a, c - a];
        let area = u.x * v.y - u.y * v.x;
        for (i, j) in reach(0, triangle).flat_map(|i| reach(1, triangle).map(move |j| (i, j))) {
            let (x, y) = (along(0, i) - a.x, along(1, j) - a.y);
            let [s, t] = [(x * v.y - y * v.x) / area, (u.x * y - u.y * x) / area];
            if s >= 0.0 && t >= 0.0 && s + t < 1.0 {
                // A face whose front is down is where a line upwards enters.
                crossings[i * LINES + j].push((a.z + s * u.z + t * v.z, if area < 0.0 { 1 } else { -1 }));
            }
        }
    }
    let (mut enclosed_m, mut confused_m) = (0.0, 0.0);
    for line in &mut crossings {
        line.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        if line.iter().map(|(_, way)| way).sum::<i32>() != 0 {
            continue; // it goes through an edge
        }
        let mut shells = 0;
        for pair in line.windows(2) {
            shells += pair[0].1;
            let length_m = pair[1].0 - pair[0].0;
            enclosed_m += if shells == 0 { 0.0 } else { length_m };
            confused_m += if matches!(shells, 0 | 1) { 0.0 } else { length_m };
        }
    }
    [if enclosed_m > 0.0 { confused_m / enclosed_m } else { 0.0 }, enclosed_m * step.x * step.y]
}

/// The smallest width of points over the directions in which a hull can be narrowest: normal to a face, or to two
/// edges.
pub(crate) fn smallest_width_m(hull: &Polyhedron, points_m: &[Vec3]) -> f64 {
    // A hull of points has each edge twice, in both directions.
    let edges: Vec<Vec3> = hull.edges_m().iter().copied().filter(|edge| edge.to_array() > [0.0; 3]).collect();
    let faces = hull.planes().map(|plane| plane.normal);
    let across = edges.iter().enumerate().flat_map(|(i, a)| edges[..i].iter().map(|b| a.cross(*b)));
    let width_m = |points_m: &[Vec3], axis: Vec3| {
        let along = points_m.iter().map(|point| axis.dot(*point));
        along.clone().fold(f32::NEG_INFINITY, f32::max) - along.fold(f32::INFINITY, f32::min)
    };
    let mut best_m = f32::INFINITY;
    for axis in faces.chain(across).filter_map(Vec3::try_normalize) {
        // The hull's own corners first: few directions need a check of all points.
        if width_m(hull.corners_m(), axis) < best_m {
            best_m = best_m.min(width_m(points_m, axis));
        }
    }
    f64::from(best_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::closed_box;

    fn boxes(of: &[([f64; 3], f64, bool)]) -> Measured {
        let (mut corners, mut triangles) = (Vec::new(), Vec::new());
        for (size, offset_m, is_inside_out) in of {
            let (own, own_triangles) = closed_box(*size);
            let first = corners.len() as u32;
            corners.extend(own.into_iter().map(|corner| corner.map(|x| x + offset_m)));
            triangles.extend(own_triangles.into_iter().map(|[a, b, c]| {
                [a, if *is_inside_out { c } else { b }, if *is_inside_out { b } else { c }].map(|i| first + i)
            }));
        }
        Measured::of(Mesh::new(&corners, &triangles, 1.0).unwrap())
    }

    /// Two boxes of 40 mm, of which one eighth of each is in both: 1 of 15 eighths.
    #[test]
    fn shells_that_overlap_are_no_solid_and_cavities_and_neighbours_are() {
        let side = [0.04; 3];
        let crossed = boxes(&[(side, 0.0, false), (side, 0.02, false)]);
        let share = crossed.confused_share.unwrap();
        assert!((share - 1.0 / 15.0).abs() < 0.005, "{share}");
        assert!(crossed.solid.is_none() && crossed.seams.is_watertight());
        let nested = boxes(&[([0.08; 3], 0.0, false), (side, 0.02, false)]);
        assert!(nested.solid.is_none() && (nested.confused_share.unwrap() - 0.125).abs() < 0.01);
        let hollow = boxes(&[([0.08; 3], 0.0, false), (side, 0.02, true)]);
        assert_eq!(hollow.confused_share, None);
        let volume_m3 = hollow.solid.unwrap().volume_m3;
        assert!((volume_m3 - (0.08_f64.powi(3) - 0.04_f64.powi(3))).abs() < 1e-9, "{volume_m3}");
        assert!(boxes(&[(side, 0.0, false), (side, 0.05, false)]).solid.is_some());
        let turned = boxes(&[([0.08; 3], 0.0, false), (side, 0.09, true)]);
        assert!(turned.solid.is_none() && turned.confused_share.is_some());
        let inside_out = boxes(&[(side, 0.0, true)]);
        assert!(inside_out.solid.is_some() && inside_out.was_inside_out);
    }
}
