//! The gripper at a grasp: which of its two orientations is nearer to the wrist, and whether its way is free.

use schema::{Gripper, GripperBox, Pose, Quat, Vec3, pose_from_parts};

use crate::config::CollisionParams;

/// Points no higher than this over the table belong to no object.
pub(crate) const TABLE_M: f32 = 0.004;
/// A half turn about z, which gives an equivalent grasp.
const HALF_TURN: Quat = Quat::from_xyzw(0.0, 0.0, 1.0, 0.0);

/// The orientation or its half turn, whichever is closer to the wrist's; the orientation itself in a tie.
#[must_use]
pub fn nearer_half_turn(rotation: Quat, workspace_from_wrist: Quat) -> Quat {
    let turned = rotation * HALF_TURN;
    let nearness = |candidate: Quat| candidate.dot(workspace_from_wrist).abs();
    if nearness(turned) > nearness(rotation) { turned } else { rotation }
}

/// The default wrist orientation: the gripper straight down, its x along the workspace's (VGN turns its gripper so that
/// the camera on it looks forward).
pub const WRIST_DOWN: Quat = Quat::from_xyzw(1.0, 0.0, 0.0, 0.0);

/// What is between the fingers reaches this far beyond the tips and beside the fingers.
const BETWEEN_MARGIN_M: f32 = 0.002;

/// Boxes in the grasp frame in which points are counted.
#[derive(Debug, Clone)]
pub struct GripperVolume {
    boxes: Vec<GripperBox>,
    /// A ball that contains all boxes.
    middle_m: Vec3,
    radius_m: f32,
}

impl GripperVolume {
    /// What the open gripper sweeps on its way to a grasp, with its clearance: the same sweep decides the labels
    /// (`simulator`'s gate).
    #[must_use]
    pub fn swept(gripper: &Gripper, params: &CollisionParams) -> Self {
        let margin_m = gripper.clearance_m + params.margin_m;
        let swept = |b: GripperBox| b.swept_back(params.pregrasp_distance_m).grown(margin_m);
        Self::new(gripper.open_gripper().into_iter().map(swept).collect())
    }

    /// What is between the fingers of the open gripper.
    pub(crate) fn between_fingers(gripper: &Gripper) -> Self {
        let half_m = Vec3::new(
            0.5 * gripper.finger_width_m + BETWEEN_MARGIN_M,
            0.5 * gripper.opening_m_max,
            0.5 * (gripper.finger_length_m + BETWEEN_MARGIN_M),
        );
        let centre_m = Vec3::new(0.0, 0.0, BETWEEN_MARGIN_M - half_m.z);
        Self::new(vec![GripperBox { centre_m, half_m }])
    }

    /// These boxes.
    pub(crate) fn new(boxes: Vec<GripperBox>) -> Self {
        let low = boxes.iter().fold(Vec3::INFINITY, |low, b| low.min(b.centre_m - b.half_m));
        let high = boxes.iter().fold(Vec3::NEG_INFINITY, |high, b| high.max(b.centre_m + b.half_m));
        Self { boxes, middle_m: 0.5 * (low + high), radius_m: 0.5 * (high - low).length() }
    }

    /// The number of points in it if the gripper is at a grasp.
    #[must_use]
    pub fn points_inside(&self, workspace_from_grasp: &Pose, points_m: &[Vec3]) -> usize {
        let middle_m = *workspace_from_grasp * self.middle_m;
        let grasp_from_workspace = workspace_from_grasp.inverse();
        let near =
            points_m.iter().filter(|point| (**point - middle_m).length_squared() <= self.radius_m * self.radius_m);
        near.filter(|point| {
            let local_m = grasp_from_workspace * **point;
            self.boxes.iter().any(|b| (local_m - b.centre_m).abs().cmple(b.half_m).all())
        })
        .count()
    }

    /// The same of points that are sorted along x.
    #[must_use]
    pub(crate) fn points_inside_sorted(&self, workspace_from_grasp: &Pose, points_m: &[Vec3]) -> usize {
        let middle_m = *workspace_from_grasp * self.middle_m;
        let before = |x_m: f32| points_m.partition_point(|point_m| point_m.x < x_m);
        let near = before(middle_m.x - self.radius_m)..before((middle_m.x + self.radius_m).next_up());
        self.points_inside(workspace_from_grasp, &points_m[near])
    }
}

/// The grasp's pose with the orientation nearer to the wrist; as it is where a fixed jaw has its side.
pub(crate) fn towards_wrist(gripper: &Gripper, workspace_from_grasp: &Pose, workspace_from_wrist: Quat) -> Pose {
    if gripper.fixed_side().is_some() {
        return *workspace_from_grasp;
    }
    let rotation = nearer_half_turn(workspace_from_grasp.rotation, workspace_from_wrist);
    pose_from_parts(rotation, workspace_from_grasp.translation)
}

/// Grasps whose tips are within this of each other, turned by no more than that, are alike.
const ALIKE_M: f32 = 0.01;
const ALIKE_RAD: f32 = core::f32::consts::FRAC_PI_6;

/// Whether two grasps are nearly the same: their tips within 10 mm, their axes within 30°, half turns apart or not.
#[must_use]
pub fn are_alike(one: &Pose, other: &Pose) -> bool {
    schema::are_alike(one, other, ALIKE_M, ALIKE_RAD)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use schema::{Purpose, Stream, axis_angle};

    use super::*;
    use crate::BuiltIn;

    #[test]
    fn grasps_are_alike_up_to_a_centimetre_thirty_degrees_and_a_half_turn() {
        let down = Pose::from_parts(Vec3::new(0.1, 0.1, 0.1), WRIST_DOWN);
        let moved = |y_m: f32, turn_rad: f32| {
            Pose::from_parts(down.translation + Vec3::Y * y_m, axis_angle(Vec3::X, turn_rad) * down.rotation)
        };
        let turned = Pose::from_parts(down.translation, down.rotation * HALF_TURN);
        assert!(are_alike(&down, &turned) && are_alike(&down, &moved(0.009, 0.5)));
        assert!(!are_alike(&down, &moved(0.011, 0.0)) && !are_alike(&down, &moved(0.0, 0.55)));
    }

    fn rotations() -> impl Strategy<Value = Quat> {
        any::<u64>().prop_map(|seed| Stream::new(seed, 0, Purpose::Candidates, 0).rotation())
    }

    proptest! {
        #[test]
        fn the_nearer_of_the_two_is_taken(rotation in rotations(), wrist in rotations()) {
            let chosen = nearer_half_turn(rotation, wrist);
            let other = chosen * HALF_TURN;
            // Independent of the quaternions' signs: the turn's angle from the trace of its matrix.
            let angle = |q: Quat| {
                let m = schema::Mat3::from_quat(wrist.inverse() * q);
                libm::acosf((0.5 * (m.x_axis.x + m.y_axis.y + m.z_axis.z - 1.0)).clamp(-1.0, 1.0))
            };
            prop_assert!(angle(chosen) <= angle(other) + 1e-3);
            for axis in [Vec3::Y, Vec3::X] {
                let (was, is) = (rotation * axis, chosen * axis);
                prop_assert!((was - is).length() < 1e-5 || (was + is).length() < 1e-5);
            }
            prop_assert!((rotation * Vec3::Z - chosen * Vec3::Z).length() < 1e-5);
        }
    }

    #[test]
    fn a_hand_that_looks_backwards_is_turned() {
        let backwards = axis_angle(Vec3::Z, core::f32::consts::PI) * WRIST_DOWN;
        assert!((nearer_half_turn(backwards, WRIST_DOWN) * Vec3::X - Vec3::X).length() < 1e-6);
        assert_eq!(nearer_half_turn(WRIST_DOWN, WRIST_DOWN), WRIST_DOWN);
    }

    #[test]
    fn points_are_hit_where_the_hand_passes_and_nowhere_else() {
        let config = BuiltIn::Paper.config().unwrap();
        let sweep = GripperVolume::swept(&config.gripper, &config.collision);
        let pose = pose_from_parts(WRIST_DOWN, Vec3::new(0.15, 0.15, 0.1));
        let at = |local: [f32; 3]| sweep.points_inside(&pose, &[pose * Vec3::from_array(local)]);
        let (opening, thickness) = (config.gripper.opening_m_max, config.gripper.finger_thickness_m);
        let in_finger = 0.5 * (opening + thickness);
        assert_eq!(at([0.0, 0.0, 0.0]), 0, "between the fingers");
        assert_eq!(at([0.0, in_finger, -0.01]), 1, "in a finger");
        assert_eq!(at([0.0, -in_finger, -0.01]), 1, "in the other");
        assert_eq!(at([0.0, in_finger, 0.01]), 0, "below a finger");
        assert_eq!(at([0.0, in_finger, -0.09]), 1, "where a finger passes");
        assert_eq!(at([0.0, 0.0, -config.gripper.finger_length_m - 0.01]), 1, "in the palm");
        assert_eq!(at([0.1, 0.0, -0.01]), 0, "beside the gripper");
    }

    proptest! {
        #[test]
        fn the_ball_loses_no_point(rotation in rotations(), x in -0.2_f32..0.2, y in -0.2_f32..0.2, z in -0.3_f32..0.1) {
            let config = BuiltIn::Paper.config().unwrap();
            let sweep = GripperVolume::swept(&config.gripper, &config.collision);
            let pose = pose_from_parts(rotation, Vec3::new(0.1, 0.2, 0.1));
            let local = Vec3::new(x, y, z);
            let slow = sweep.boxes.iter().any(|b| (local - b.centre_m).abs().cmplt(b.half_m - 1e-5).all());
            let not = sweep.boxes.iter().all(|b| (local - b.centre_m).abs().cmpgt(b.half_m + 1e-5).any());
            let hits = sweep.points_inside(&pose, &[pose * local]);
            prop_assert!(!slow || hits == 1);
            prop_assert!(!not || hits == 0);
        }
    }
}
