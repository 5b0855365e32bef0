//! A hand, as a plan's picture and an overlay draw it.

use report::still::{Canvas, INK, Opacity};
use report::view::{Class, Line};
use schema::{Gripper, Pose, Vec3};

use super::tints::of_place;

pub(super) const SHOWN: Opacity = Opacity { before: 1.0, behind: 0.22 };
const GLASS: Opacity = Opacity { before: 0.26, behind: 0.08 };
/// Start and end of the arrow's head, in finger lengths behind the tips: in front of most objects, not inside.
const ARROW_HEAD: [f32; 2] = [0.80, 0.38];

/// The hand of the grasp with this rank (0 is the best) of `count`, opened so wide. Returns the end of its stem.
pub(super) fn hand(
    canvas: &mut Canvas,
    pose: &Pose,
    width_m: f32,
    gripper: &Gripper,
    [place, count]: [usize; 2],
) -> Option<[f32; 2]> {
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
        canvas.haloed_line(&points(&fork), if place < 4 { 5.0 } else { 3.4 }, colour);
    }
    canvas.lay(SHOWN);
    canvas.see(stem_end_m)
}

/// A line's points.
pub(super) fn points(line: &Line) -> Vec<Vec3> {
    line.points_m.iter().copied().map(Vec3::from_array).collect()
}
