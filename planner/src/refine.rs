//! Beyond the paper: a detection's hand turned and shifted until its fingers close on faces of the cloud.
//!
//! Several hands fit most voxels (a box can be closed on along either side), and a network that answers with one orientation
//! answers with their mean, which fits none. So about the detection's origin hands are tried that approach as predicted or straight
//! down, turned in even steps; of those whose way is free the one whose fingers would lie flattest on what they close on is taken. Flat
//! means: many points of the cloud within a few millimetres of each finger's touch.

use schema::{Grasp, Gripper, Pose, Quat, Vec3, axis_angle, pose_from_parts};

use crate::hand::{Sweep, WRIST_DOWN};
use crate::plan::SegmentedCloud;

/// How hands are tried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefinementLaw {
    /// Turns that are tried, evenly over half a turn; 0 for no refinement.
    pub turns: usize,
    /// How many places along the approach are tried; odd, so that the predicted one is among them.
    pub shifts: usize,
    /// Distance between them.
    pub shift_m: f32,
    /// How deep a point may lie behind the touch to count for it.
    pub flat_m: f32,
    /// Fewest points at each finger.
    pub points_min: usize,
}

/// A hand that is tried.
struct Trial {
    grasp: Grasp,
    /// Points at the finger that has fewer.
    support: usize,
}

/// The best hand about a detection and how many points support it, or `None` if no way is free or nothing flat is between the
/// fingers. At most `points_max` points may be in the way.
#[must_use]
pub fn refined(
    grasp: &Grasp,
    cloud: &SegmentedCloud,
    sweep: &Sweep,
    gripper: &Gripper,
    law: &RefinementLaw,
    points_max: usize,
) -> Option<(Grasp, usize)> {
    let origin_m = grasp.workspace_from_grasp.translation;
    let within = |reach_m: f32, points_m: &[Vec3]| -> Vec<Vec3> {
        points_m.iter().copied().filter(|p| (*p - origin_m).length_squared() < reach_m * reach_m).collect()
    };
    let farthest_shift_m = 0.5 * law.shifts as f32 * law.shift_m;
    let around = within(sweep.reach_m() + gripper.opening_m_max + farthest_shift_m, &cloud.points_m);
    let near = within(gripper.finger_length_m + 0.5 * gripper.opening_m_max + farthest_shift_m, &around);
    let turn = |step: usize| axis_angle(Vec3::Z, core::f32::consts::PI * step as f32 / law.turns as f32);
    let mut trials: Vec<Trial> = [grasp.workspace_from_grasp.rotation, WRIST_DOWN]
        .into_iter()
        .flat_map(|approach| (0..law.turns).map(move |step| approach * turn(step)))
        .flat_map(|rotation| closed_on(origin_m, rotation, &near, gripper, law))
        .collect();
    // Stable: of equals the first, whose approach is the predicted one.
    trials.sort_by_key(|trial| core::cmp::Reverse(trial.support));
    let is_free = |trial: &Trial| sweep.is_free(&trial.grasp.workspace_from_grasp, &around, points_max);
    trials.into_iter().find(is_free).map(|trial| (trial.grasp, trial.support))
}

/// The hands with this orientation, at each place along the approach, shifted along the closing so that what lies between the fingers is
/// in their middle.
fn closed_on(origin_m: Vec3, rotation: Quat, near: &[Vec3], gripper: &Gripper, law: &RefinementLaw) -> Vec<Trial> {
    let grasp_from_workspace = pose_from_parts(rotation, origin_m).inverse();
    let (half_x_m, half_y_m) = (0.5 * gripper.finger_width_m, 0.5 * gripper.opening_m_max);
    let is_between = |p: &Vec3| p.x.abs() < half_x_m && p.y.abs() < half_y_m;
    let between: Vec<Vec3> = near.iter().map(|point| grasp_from_workspace * *point).filter(is_between).collect();
    let shift_m = |step: usize| law.shift_m * (step as f32 - 0.5 * (law.shifts - 1) as f32);
    let at = |step: usize| closed_at(origin_m, rotation, &between, shift_m(step), gripper, law);
    (0..law.shifts).filter_map(at).collect()
}

/// The hand `shift_m` farther along its approach; `between` are the points between its fingers, in the unshifted frame.
fn closed_at(
    origin_m: Vec3,
    rotation: Quat,
    between: &[Vec3],
    shift_m: f32,
    gripper: &Gripper,
    law: &RefinementLaw,
) -> Option<Trial> {
    let is_beside = |p: &&Vec3| p.z < shift_m && p.z > shift_m - gripper.finger_length_m;
    let mut y_m: Vec<f32> = between.iter().filter(is_beside).map(|p| p.y).collect();
    if y_m.len() < 2 * law.points_min {
        return None;
    }
    y_m.sort_by(f32::total_cmp);
    // A few stray points must not hold a finger.
    let stray = law.points_min / 4;
    let (low_m, high_m) = (y_m[stray], y_m[y_m.len() - 1 - stray]);
    let width_m = high_m - low_m;
    if width_m > gripper.opening_m_max - 2.0 * gripper.clearance_m {
        return None;
    }
    let low = y_m.iter().filter(|y| **y < low_m + law.flat_m).count();
    let high = y_m.iter().filter(|y| **y > high_m - law.flat_m).count();
    let support = low.min(high);
    let position_m = origin_m + rotation * Vec3::new(0.0, 0.5 * (low_m + high_m), shift_m);
    let workspace_from_grasp: Pose = pose_from_parts(rotation, position_m);
    (support >= law.points_min).then_some(Trial { grasp: Grasp { workspace_from_grasp, width_m }, support })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::plan::PointLabel;

    const LAW: RefinementLaw = RefinementLaw { turns: 12, shifts: 3, shift_m: 0.0075, flat_m: 0.002, points_min: 20 };

    /// A box of 40 x 60 x 50 mm, turned by `yaw_rad`, on a table at 0.05 m, on a lattice of 2.5 mm.
    fn scene(yaw_rad: f32) -> SegmentedCloud {
        let mut points_m = Vec::new();
        for i in 0..=16 {
            for j in 0..=24 {
                for k in 0..=20 {
                    if [i % 16, j % 24, k % 20].contains(&0) && k > 0 {
                        let local = Vec3::new(i as f32 - 8.0, j as f32 - 12.0, k as f32) * 0.0025;
                        points_m.push(axis_angle(Vec3::Z, yaw_rad) * local + Vec3::new(0.15, 0.15, 0.05));
                    }
                }
            }
        }
        points_m.extend((0..14_400).map(|n| Vec3::new((n / 120) as f32 * 0.0025, (n % 120) as f32 * 0.0025, 0.05)));
        let labels = vec![PointLabel::Noise; points_m.len()];
        SegmentedCloud { points_m, labels, plane: None }
    }

    fn refine(yaw_rad: f32, predicted_yaw_rad: f32, cloud: &SegmentedCloud) -> Option<(Grasp, usize)> {
        let config = Config::built_in().unwrap();
        let sweep = Sweep::new(&config.gripper, &config.collision);
        let rotation = axis_angle(Vec3::Z, predicted_yaw_rad) * WRIST_DOWN;
        let off = axis_angle(Vec3::Z, yaw_rad) * Vec3::new(0.004, 0.005, 0.0);
        let workspace_from_grasp = pose_from_parts(rotation, Vec3::new(0.15, 0.15, 0.08) + off);
        refined(&Grasp { workspace_from_grasp, width_m: 0.05 }, cloud, &sweep, &config.gripper, &LAW, 0)
    }

    /// The closing of the hand that is found, in the box's frame.
    fn closing(yaw_rad: f32, grasp: &Grasp) -> Vec3 {
        axis_angle(Vec3::Z, -yaw_rad) * (grasp.workspace_from_grasp.rotation * Vec3::Y)
    }

    #[test]
    fn a_diagonal_hand_is_turned_onto_the_faces_and_into_the_middle() {
        for yaw_rad in [0.0, 0.3, 1.0, 2.0] {
            let (grasp, support) = refine(yaw_rad, yaw_rad + 0.7, &scene(yaw_rad)).unwrap();
            let along = closing(yaw_rad, &grasp).abs();
            // Within half a step of 15 degrees of one of the two closings that fit.
            assert!(along.max_element() > libm::cosf(0.14), "{yaw_rad}: closes along {along}");
            let width_m = if along.x > along.y { 0.04 } else { 0.06 };
            assert!((grasp.width_m - width_m).abs() < 0.008, "{yaw_rad}: {} m", grasp.width_m);
            let off =
                axis_angle(Vec3::Z, -yaw_rad) * (grasp.workspace_from_grasp.translation - Vec3::new(0.15, 0.15, 0.0));
            assert!(off.dot(along).abs() < 0.003, "{yaw_rad}: off the middle by {off}");
            assert!(support >= LAW.points_min);
        }
    }

    #[test]
    fn a_closing_that_is_blocked_gives_way_to_the_other() {
        let mut cloud = scene(0.0);
        let free = closing(0.0, &refine(0.0, 0.7, &cloud).unwrap().0).abs();
        // Posts on both sides of the box, where the fingers would go.
        let axis = if free.x > free.y { Vec3::X } else { Vec3::Y };
        for side in [-1.0, 1.0] {
            let foot = Vec3::new(0.15, 0.15, 0.05) + axis * side * 0.047;
            cloud.points_m.extend((0..40).map(|k| foot + Vec3::Z * (k as f32 * 0.0025)));
        }
        if let Some((grasp, _)) = refine(0.0, 0.7, &cloud) {
            let now = closing(0.0, &grasp).abs();
            assert!(now.dot(axis) < 0.6, "still closes along {now}");
        }
    }

    #[test]
    fn what_is_too_wide_or_not_there_has_no_hand() {
        let bare = SegmentedCloud { points_m: Vec::new(), labels: Vec::new(), plane: None };
        assert!(refine(0.0, 0.0, &bare).is_none());
        let mut wide = scene(0.0);
        for point in &mut wide.points_m {
            *point = Vec3::new(0.15, 0.15, 0.0) + (*point - Vec3::new(0.15, 0.15, 0.0)) * Vec3::new(3.0, 3.0, 1.0);
        }
        assert!(refine(0.0, 0.0, &wide).is_none());
    }
}
