//! What is measured of a mesh and of its convex parts.

use glamx::DVec3;
use schema::{Polyhedron, Vec3, bounds_m};
use simulator::hull_volume_m3;

use crate::mass_integrals::MassIntegrals;
use crate::mesh::{Mesh, Seams};

/// Cells along each side of the lattice for measuring overlaps.
const LATTICE: usize = 48;

/// A mesh and its measurements before decomposition.
pub(crate) struct Measured {
    pub(crate) mesh: Mesh,
    pub(crate) seams: Seams,
    pub(crate) was_inside_out: bool,
    pub(crate) extents_m: DVec3,
    /// The centre of the bounding box, in the file's frame; all other fields are relative to it.
    pub(crate) middle_m: DVec3,
    pub(crate) corners_m: Vec<Vec3>,
    /// The integrals, if the mesh is watertight and encloses a volume.
    pub(crate) solid: Option<MassIntegrals>,
    pub(crate) hull_volume_m3: f64,
}

impl Measured {
    pub(crate) fn of(mesh: Mesh) -> Self {
        let seams = mesh.seams();
        let [low, high] = mesh.bounds_m();
        let middle_m = 0.5 * (low + high);
        let integrals = MassIntegrals::of(mesh.triangles_about(middle_m));
        let was_inside_out = seams.is_watertight() && integrals.volume_m3 < 0.0;
        let mesh = if was_inside_out { mesh.turned_inside_out() } else { mesh };
        let solid = seams.is_watertight().then(|| MassIntegrals::of(mesh.triangles_about(middle_m)));
        let corners_m = mesh.corners_about(middle_m);
        Self {
            seams,
            was_inside_out,
            extents_m: high - low,
            middle_m,
            hull_volume_m3: hull_volume_m3(&corners_m).unwrap_or(0.0),
            corners_m,
            solid: solid.filter(|solid| solid.volume_m3 > 0.0),
            mesh,
        }
    }
}

/// The integrals over a convex part.
pub(crate) fn integrals_of(hull: &Polyhedron) -> MassIntegrals {
    let corners: Vec<DVec3> = hull.corners_m().iter().map(|c| c.as_dvec3()).collect();
    MassIntegrals::of(hull.triangles().into_iter().map(|triangle| triangle.map(|i| corners[i])))
}

/// The smallest width of points over the directions in which a hull can be narrowest: normal to a face, or to two
/// edges.
pub(crate) fn smallest_width_m(hull: &Polyhedron, points_m: &[Vec3]) -> f64 {
    let edges = hull.edges_m();
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

/// The share of the parts' union that lies in more than one of them, by sampling a lattice.
pub(crate) fn overlap_share(hulls: &[Polyhedron]) -> f64 {
    let [low, high] = bounds_m(hulls.iter().flat_map(Polyhedron::corners_m));
    let planes: Vec<_> = hulls.iter().map(|hull| hull.planes().collect::<Vec<_>>()).collect();
    let (mut once, mut more) = (0_u64, 0_u64);
    for cell in 0..LATTICE.pow(3) {
        let along = [cell / LATTICE / LATTICE, cell / LATTICE % LATTICE, cell % LATTICE];
        let share = Vec3::from_array(along.map(|k| (k as f32 + 0.5) / LATTICE as f32));
        let point = low + (high - low) * share;
        let holders = planes.iter().filter(|of| of.iter().all(|p| p.normal.dot(point) < p.offset_m)).take(2).count();
        once += u64::from(holders >= 1);
        more += u64::from(holders >= 2);
    }
    if once == 0 { 0.0 } else { more as f64 / once as f64 }
}
