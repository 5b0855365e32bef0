//! Convex parts as points and axes, for tests without time steps.

use schema::{GripperBox, Polyhedron, Pose, Vec3};

use wide::f32x4;

use crate::stepper::{Wide3, span, wide};

/// Coordinates within a metre are exact to this.
const ROUNDING_M: f32 = 1e-6;

/// A convex part of an object, in the object's frame.
#[derive(Debug, Clone)]
pub(crate) struct TestedPart {
    centre_m: Vec3,
    corners_m: Vec<Vec3>,
    /// Directions of the faces' normals, then of the edges, one of each opposite pair.
    normals: Vec<Vec3>,
    edges: Vec<Vec3>,
    radius_m: f32,
}

/// A convex part at a pose: its corners, and the normals of its faces, one of each opposite pair.
#[derive(Debug, Clone)]
pub(crate) struct PlacedPart {
    pub(crate) centre_m: Vec3,
    pub(crate) radius_m: f32,
    /// Four at a time.
    corners_m: Vec<Wide3>,
    pub(crate) normals: Vec<Vec3>,
    /// Directions of its edges; only of one that is [`TestedPart::near`] something.
    edges: Vec<Vec3>,
}

impl TestedPart {
    pub(crate) fn new(part: &Polyhedron) -> Self {
        Self {
            centre_m: part.centre_m(),
            corners_m: part.corners_m().to_vec(),
            normals: distinct(part.planes().map(|plane| plane.normal)),
            edges: distinct(part.edges_m().iter().map(|edge| edge.normalize())),
            radius_m: part.radius_m(),
        }
    }

    pub(crate) fn placed(&self, pose: &Pose) -> PlacedPart {
        let moved = |corners_m: &[Vec3]| {
            let at = |lane: usize| pose.transform_point(corners_m[lane.min(corners_m.len() - 1)]);
            wide(&[at(0), at(1), at(2), at(3)])
        };
        PlacedPart {
            centre_m: pose.transform_point(self.centre_m),
            radius_m: self.radius_m,
            corners_m: self.corners_m.chunks(4).map(moved).collect(),
            normals: self.normals.iter().map(|n| pose.rotation * *n).collect(),
            edges: Vec::new(),
        }
    }

    /// The part at a pose if it is near one of some boxes.
    pub(crate) fn near(&self, pose: &Pose, boxes: &[GripperBox]) -> Option<PlacedPart> {
        let edges = || self.edges.iter().map(|e| pose.rotation * *e).collect();
        self.is_near(pose, boxes).then(|| PlacedPart { edges: edges(), ..self.placed(pose) })
    }

    pub(crate) fn is_near(&self, pose: &Pose, boxes: &[GripperBox]) -> bool {
        let centre_m = pose.transform_point(self.centre_m);
        boxes.iter().any(|b| b.is_near(centre_m, self.radius_m))
    }
}

impl PlacedPart {
    /// An axis-parallel box, moved and turned.
    pub(crate) fn from_box(gripper_box: &GripperBox, pose: &Pose) -> Self {
        let (centre_m, turn) = (pose.transform_point(gripper_box.centre_m), pose.rotation);
        let sign = |corner: usize, bit: usize| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
        let corner = |c: usize| centre_m + turn * (gripper_box.half_m * Vec3::new(sign(c, 0), sign(c, 1), sign(c, 2)));
        Self {
            centre_m,
            radius_m: gripper_box.half_m.length(),
            corners_m: vec![wide(&[0, 1, 2, 3].map(corner)), wide(&[4, 5, 6, 7].map(corner))],
            normals: [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| turn * axis).to_vec(),
            edges: Vec::new(),
        }
    }

    /// The interval that the part covers along an axis.
    pub(crate) fn span(&self, axis: Vec3) -> [f32; 2] {
        span(&self.corners_m, axis)
    }

    /// Whether a box and a part that is near it overlap, by separating axes: the box's axes, the solid's normals, and
    /// the products of their edges. All in the box's axes.
    ///
    /// (parry's own test runs GJK, which took a faceted cylinder half a millimetre away for a touching one.)
    pub(crate) fn overlaps(&self, gripper_box: &GripperBox) -> bool {
        let parted = |axis: Vec3| {
            let [low, high] = self.span(axis);
            let (middle, reach) = (axis.dot(gripper_box.centre_m), axis.abs().dot(gripper_box.half_m));
            low - middle > reach || high - middle < -reach
        };
        let axes = [Vec3::X, Vec3::Y, Vec3::Z];
        if !gripper_box.is_near(self.centre_m, self.radius_m) || axes.into_iter().any(parted) {
            return false;
        }
        if self.has_corner_in(gripper_box) {
            return true;
        }
        let crossed = axes.iter().flat_map(|a| self.edges.iter().map(|e| a.cross(*e)));
        // Parallel edges give no axis of their own.
        let useful = crossed.filter(|axis| axis.length_squared() > 1e-6);
        !self.normals.iter().copied().chain(useful).any(parted)
    }

    /// Whether a corner is within a box, by more than rounding.
    fn has_corner_in(&self, gripper_box: &GripperBox) -> bool {
        self.corners_m.iter().any(|corners| {
            let is_within = |axis: usize| {
                let half_m = gripper_box.half_m[axis] - ROUNDING_M;
                (corners[axis] - f32x4::splat(gripper_box.centre_m[axis])).abs().simd_lt(f32x4::splat(half_m))
            };
            (is_within(0) & is_within(1) & is_within(2)).any()
        })
    }

    /// Distance that `self` can move along the unit vector `direction` before it meets `other`; infinite if it never
    /// does. Uses only the faces' normals, so two solids near each other's edges meet too early rather than too late.
    pub(crate) fn free_way_m(&self, other: &Self, direction: Vec3) -> f32 {
        let (mut entry, mut exit) = (f32::NEG_INFINITY, f32::INFINITY);
        let apart = other.centre_m - self.centre_m;
        let across = apart - direction * apart.dot(direction);
        for axis in self.normals.iter().chain(&other.normals).copied().chain(across.try_normalize()) {
            let ([a_low, a_high], [b_low, b_high]) = (self.span(axis), other.span(axis));
            let speed = axis.dot(direction);
            let (gap_before, gap_after) = (b_low - a_high, b_high - a_low);
            if speed.abs() < 1e-6 {
                if gap_before > 0.0 || gap_after < 0.0 {
                    return f32::INFINITY;
                }
                continue;
            }
            let (first, last) = (gap_before / speed, gap_after / speed);
            entry = entry.max(first.min(last));
            exit = exit.min(first.max(last));
        }
        if entry > exit || exit < 0.0 { f32::INFINITY } else { entry.max(0.0) }
    }
}

/// The distinct directions of `axes`, without opposites.
fn distinct(axes: impl Iterator<Item = Vec3>) -> Vec<Vec3> {
    let mut kept: Vec<Vec3> = Vec::new();
    for axis in axes {
        if !kept.iter().any(|k| k.cross(axis).length_squared() < 1e-8) {
            kept.push(axis);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use schema::{ShapeKind, Solid};

    use super::*;

    #[test]
    fn a_box_meets_a_box_after_the_gap_between_them_or_never() {
        let solid = Solid::new(ShapeKind::Cuboid, Vec3::splat(0.02)).unwrap();
        let other =
            TestedPart::new(&Polyhedron::from(&solid)).placed(&Pose::from_translation(Vec3::new(0.0, 0.1, 0.0)));
        let way = |y_m: f32, x_m: f32, direction: Vec3| {
            let mover = GripperBox { centre_m: Vec3::ZERO, half_m: Vec3::splat(0.01) };
            let at = Pose::from_translation(Vec3::new(x_m, y_m, 0.0));
            PlacedPart::from_box(&mover, &at).free_way_m(&other, direction)
        };
        assert!((way(0.0, 0.0, Vec3::Y) - 0.08).abs() < 1e-6);
        assert!((way(0.0, 0.019, Vec3::Y) - 0.08).abs() < 1e-6);
        assert_eq!(way(0.0, 0.021, Vec3::Y), f32::INFINITY, "it passes beside");
        assert_eq!(way(0.0, 0.0, -Vec3::Y), f32::INFINITY, "it goes away");
        assert_eq!(way(0.095, 0.0, Vec3::Z), 0.0, "they overlap already");
        let slanted = way(0.0, 0.06, Vec3::new(-0.6, 0.8, 0.0));
        assert!((slanted - 0.1).abs() < 1e-6, "{slanted}");
    }
}
