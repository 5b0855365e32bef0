//! A hand in an image. Only the best has fingers and palm as boxes; the others are forks of lines, because complete
//! hands would hide the objects.

use schema::{Gripper, Pose, Vec3};

use super::canvas::Canvas;
use super::layer::{Opacity, Rgb};
use crate::view::{Class, Line};

/// Green by Okabe and Ito (2008), which the colour-blind distinguish.
pub(super) const BEST: Rgb = [0, 158, 115];
const INK: Rgb = [34; 3];
const SHOWN: Opacity = Opacity { before: 1.0, behind: 0.22 };
const GLASS: Opacity = Opacity { before: 0.26, behind: 0.08 };
/// Start and end of the arrow's head, in finger lengths behind the tips: in front of most objects, not inside.
const ARROW_HEAD: [f32; 2] = [0.80, 0.38];

/// The hand of the grasp with this rank (0 is the best) of `count`, opened so wide.
pub(super) fn hand(canvas: &mut Canvas, pose: &Pose, width_m: f32, gripper: &Gripper, [place, count]: [usize; 2]) {
    let colour = of_place(place, count);
    let at = |z_m: f32| pose.transform_point(Vec3::new(0.0, 0.0, z_m));
    let stem_end_m = at(-gripper.finger_length_m - 1.5 * gripper.palm_length_m);
    if place == 0 {
        canvas.block(&gripper.palm(), pose, colour);
        canvas.lay(GLASS);
        for finger in gripper.fingers(width_m) {
            canvas.block(&finger, pose, colour);
        }
        // The approach: from the stem's end to between the fingers.
        let [neck_m, tip_m] = ARROW_HEAD.map(|share| at(-share * gripper.finger_length_m));
        canvas.haloed_line(&[stem_end_m, neck_m], 4.0, INK);
        canvas.arrow_head(neck_m, tip_m, INK);
    } else {
        let fork = Line::fork(Class::Hand, "", gripper, pose, width_m);
        let points_m: Vec<Vec3> = fork.points_m.iter().copied().map(Vec3::from_array).collect();
        canvas.haloed_line(&points_m, if place < 4 { 5.0 } else { 3.4 }, colour);
    }
    canvas.lay(SHOWN);
}

/// A grasp's colour by its rank among the `count` drawn ones: after the best from dark to light grey, so that
/// their order is seen without colours.
fn of_place(place: usize, count: usize) -> Rgb {
    if place == 0 {
        return BEST;
    }
    let share = (place - 1) as f32 / (count.max(6) - 2) as f32;
    [(60.0 + 105.0 * share.min(1.0)) as u8; 3]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grasps_fade_with_their_rank() {
        for count in [2, 3, 12] {
            let greys: Vec<u8> = (1..count).map(|place| of_place(place, count)[0]).collect();
            assert!(greys.is_sorted() && greys[0] == 60 && greys[greys.len() - 1] <= 165, "{greys:?}");
        }
    }
}
