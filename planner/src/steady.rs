//! A best grasp that stays where it was: images of a scene that stands still are noisy, and candidates are drawn anew
//! in each, so of several good grasps another one would be the best each time.

use core::f32::consts::PI;

use schema::Pose;

/// Qualities that differ by no more than this are about the same. From one image to the next, each with noise of 1 mm,
/// the quality of a grasp of 0.9 moves by up to this in nine of ten, that of one of 0.97 by a fifth of it.
const AS_GOOD: f32 = 0.05;
/// A turn by 15° counts as much as a way of 10 mm.
const METRES_PER_RAD: f32 = 0.01 / (PI / 12.0);

/// Puts the grasp first that is nearest to a previous one, of those that are about as good as the first.
pub(crate) fn put_first<T>(grasps: &mut [T], previous: &Pose, quality_and_pose: impl Fn(&T) -> (f32, Pose)) {
    let Some(least) = grasps.first().map(|first| quality_and_pose(first).0 - AS_GOOD) else { return };
    let off = |(_, grasp): &(usize, &T)| off_m(&quality_and_pose(grasp).1, previous);
    let as_good = grasps.iter().enumerate().filter(|(_, grasp)| quality_and_pose(grasp).0 >= least);
    let nearest = as_good.min_by(|a, b| off(a).total_cmp(&off(b))).map_or(0, |(place, _)| place);
    grasps[..=nearest].rotate_right(1);
}

/// How far two grasps are from each other, a half turn about their approaches aside.
fn off_m(one: &Pose, other: &Pose) -> f32 {
    let turn = one.rotation.inverse() * other.rotation;
    let turn_rad = 2.0 * libm::acosf(turn.w.abs().max(turn.z.abs()).min(1.0));
    (one.translation - other.translation).length() + METRES_PER_RAD * turn_rad
}

#[cfg(test)]
mod tests {
    use schema::{Vec3, axis_angle};

    use super::*;
    use crate::gripper_volume::WRIST_DOWN;

    fn pose(x_m: f32, turn_rad: f32) -> Pose {
        Pose::from_parts(Vec3::new(x_m, 0.1, 0.1), WRIST_DOWN * axis_angle(Vec3::Z, turn_rad))
    }

    #[test]
    fn the_nearest_of_those_that_are_as_good_comes_first_and_the_others_keep_their_order() {
        let sorted = |previous: &Pose| {
            let mut grasps =
                vec![(0.97, pose(0.1, 0.0)), (0.95, pose(0.2, 0.0)), (0.93, pose(0.2, 1.0)), (0.9, pose(0.3, 0.0))];
            put_first(&mut grasps, previous, |grasp| *grasp);
            grasps.iter().map(|(quality, _)| *quality).collect::<Vec<f32>>()
        };
        assert_eq!(sorted(&pose(0.11, 0.0)), [0.97, 0.95, 0.93, 0.9]);
        assert_eq!(sorted(&pose(0.2, 0.1)), [0.95, 0.97, 0.93, 0.9]);
        assert_eq!(sorted(&pose(0.2, 0.9 - PI)), [0.93, 0.97, 0.95, 0.9], "a half turn aside");
        assert_eq!(sorted(&pose(0.3, 0.0)), [0.95, 0.97, 0.93, 0.9], "not one that is worse");
        put_first(&mut [], &pose(0.0, 0.0), |grasp: &(f32, Pose)| *grasp);
    }

    #[test]
    fn a_turn_counts_as_a_way() {
        let here = pose(0.1, 0.0);
        assert!((off_m(&here, &pose(0.11, 0.0)) - 0.01).abs() < 1e-4);
        assert!((off_m(&here, &pose(0.1, PI / 12.0)) - 0.01).abs() < 1e-4);
        assert!(off_m(&here, &pose(0.1, PI)) < 1e-4);
    }
}
