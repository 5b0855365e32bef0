//! Rigid transforms. The types are glamx's, which rapier and parry use as well, so nothing is ever converted.

/// A rigid transform `target_from_source`: rotation, then translation in metres.
pub type Pose = glamx::Pose3;
/// A vector or point in single precision.
pub type Vec3 = glamx::Vec3;
/// A level point or direction.
pub type Vec2 = glamx::Vec2;
/// A unit quaternion, stored and written x, y, z, w.
pub type Quat = glamx::Quat;
/// A 3×3 matrix, by columns.
pub type Mat3 = glamx::Mat3;

/// A rotation of `angle_rad` about a unit `axis`, through `libm` so that every machine gives the same bits.
#[must_use]
pub fn axis_angle(axis: Vec3, angle_rad: f32) -> Quat {
    let (sin, cos) = libm::sincosf(0.5 * angle_rad);
    Quat::from_xyzw(axis.x * sin, axis.y * sin, axis.z * sin, cos)
}

/// Puts a pose together from a rotation and a translation in metres.
#[must_use]
pub fn pose_from_parts(rotation: Quat, translation: Vec3) -> Pose {
    Pose::from_parts(translation, rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_about_z_takes_x_to_y() {
        let turned = axis_angle(Vec3::Z, core::f32::consts::FRAC_PI_2) * Vec3::X;
        assert!((turned - Vec3::Y).length() < 1e-6, "got {turned}");
    }
}
