//! Appendix A of the paper: for every shape and approach axis, which offsets a grasp is drawn with.
//!
//! The grasp frame at first: z along the object's approach axis, pointing downwards; y (closing) along another object
//! axis; x = y × z. Then, in this order: a turn about x, a tilt about y, an offset d_z along z, an offset d_x along x.
//! Lengths l_z and l_x are the object's extents along the axes that z and x lie on. Offsets are from the object's
//! centre.

use crate::{Axis, Mat3, Pose, Quat, ShapeKind, Vec3, axis_angle};

const PI: f32 = core::f32::consts::PI;

/// The law of a rotation about the grasp's y axis (r_y).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tilt {
    /// N(0, std²).
    Normal {
        /// Standard deviation.
        std_rad: f32,
    },
    /// U(−max, max).
    Uniform {
        /// Largest tilt.
        max_rad: f32,
    },
}

/// A row of Appendix A.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Law {
    /// The object axes along which the gripper may close; one of them is drawn, or that along which the object is
    /// narrowest.
    pub closing: &'static [Axis],
    /// r_y.
    pub tilt: Tilt,
    /// Whether the grasp is turned about its x axis by U(0, 2π) (r_x).
    pub turns: bool,
    /// Whether it slides along its x axis by N(0, (l_x/6)²) (d_x).
    pub slides: bool,
}

/// d_z ~ U(0.015 − l_z/2, 0.035 − l_z/2) in every row: the finger tips end this far behind the near face.
pub const TIP_DEPTH_M: [f32; 2] = [0.015, 0.035];
/// d_x ~ N(0, (l_x/6)²) where it is drawn.
pub const SLIDE_SHARE: f32 = 1.0 / 6.0;

const CUBOID_TILT: Tilt = Tilt::Normal { std_rad: PI / 18.0 };

/// The law of a row: the shape, and the object axis of the approach.
///
/// Appendix A says that the axes of a grasp are determined, and not along which axis the gripper closes. Both axes
/// across the approach are open where both are normals of opposite faces, or no better one exists (the ends of prism
/// and half-cylinder); the extrusion axis alone where its two ends are the only parallel faces (prism and half-cylinder
/// from the side); and the cylinder's other radial axis, since there the grasp's x is the cylinder's own axis (its r_x
/// turns about it).
#[must_use]
pub fn law_of(shape: ShapeKind, approach: Axis) -> Law {
    use Axis::{X, Y, Z};
    use ShapeKind::{Cuboid, Cylinder, HalfCylinder, TriPrism};
    use Tilt::{Normal, Uniform};
    match (shape, approach) {
        // Cuboid, X Y Z: r_y ~ N(0, π/18), d_z, d_x.
        (Cuboid, X) => Law { closing: &[Y, Z], tilt: CUBOID_TILT, turns: false, slides: true },
        (Cuboid, Y) => Law { closing: &[X, Z], tilt: CUBOID_TILT, turns: false, slides: true },
        (Cuboid, Z) => Law { closing: &[X, Y], tilt: CUBOID_TILT, turns: false, slides: true },
        // Cylinder, X Y: r_x ~ U(0, 2π), r_y ~ N(0, π/18), d_z, d_x.
        (Cylinder, X) => Law { closing: &[Y], tilt: CUBOID_TILT, turns: true, slides: true },
        (Cylinder, Y) => Law { closing: &[X], tilt: CUBOID_TILT, turns: true, slides: true },
        // Cylinder, Z: same as cuboid.
        (Cylinder, Z) => Law { closing: &[X, Y], tilt: CUBOID_TILT, turns: false, slides: true },
        // Tri-prism, X: r_y ~ N(0, π/27), d_z.
        (TriPrism, X) => Law { closing: &[Y, Z], tilt: Normal { std_rad: PI / 27.0 }, turns: false, slides: false },
        // Tri-prism, Y Z: same as cuboid.
        (TriPrism, Y | Z) => Law { closing: &[X], tilt: CUBOID_TILT, turns: false, slides: true },
        // Hemicylinder, X: r_y ~ N(0, π/24), d_z.
        (HalfCylinder, X) => Law { closing: &[Y, Z], tilt: Normal { std_rad: PI / 24.0 }, turns: false, slides: false },
        // Hemicylinder, Y Z: r_y ~ U(−π/2, π/2), d_z.
        (HalfCylinder, Y | Z) => {
            Law { closing: &[X], tilt: Uniform { max_rad: PI / 2.0 }, turns: false, slides: false }
        }
    }
}

/// What is drawn for a grasp by a row of Appendix A.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drawn {
    /// The object axis of the approach.
    pub approach: Axis,
    /// The object axis along which the gripper closes, before the turn.
    pub closing: Axis,
    /// r_x.
    pub turn_rad: f32,
    /// r_y.
    pub tilt_rad: f32,
    /// d_z, in metres.
    pub depth_m: f32,
    /// d_x, in metres.
    pub slide_m: f32,
}

impl Drawn {
    /// The grasp on an object.
    #[must_use]
    pub fn workspace_from_grasp(&self, workspace_from_object: &Pose) -> Pose {
        let of_object = workspace_from_object.rotation;
        let points_up = (of_object * self.approach.unit()).z > 0.0;
        let z = if points_up { -self.approach.unit() } else { self.approach.unit() };
        let y = self.closing.unit();
        let base = Quat::from_mat3(&Mat3::from_cols(y.cross(z), y, z));
        let turned = of_object * base * axis_angle(Vec3::X, self.turn_rad);
        let rotation = (turned * axis_angle(Vec3::Y, self.tilt_rad)).normalize();
        let offset = rotation * Vec3::new(self.slide_m, 0.0, self.depth_m);
        Pose::from_parts(workspace_from_object.translation + offset, rotation)
    }
}

/// The orientation of a gripper that comes along a surface's normal, turned about it, before its tips are moved to
/// their depth.
#[must_use]
pub fn along_normal(normal: Vec3, turn_rad: f32) -> Quat {
    let z = -normal;
    let start = if z.x.abs() > 1.0 - 1e-4 { Vec3::Y } else { Vec3::X };
    let y = z.cross(start).normalize();
    let unturned = Quat::from_mat3(&Mat3::from_cols(y.cross(z), y, z));
    (unturned * axis_angle(Vec3::Z, turn_rad)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gripper_never_closes_along_its_approach() {
        for (shape, approach) in ShapeKind::ALL.into_iter().flat_map(|s| Axis::ALL.map(|a| (s, a))) {
            let law = law_of(shape, approach);
            assert!(!law.closing.is_empty() && !law.closing.contains(&approach), "{shape:?} {approach:?}");
        }
    }
}
