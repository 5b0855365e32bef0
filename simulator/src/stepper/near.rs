//! Which parts of a body come near something: of many parts few do.

use schema::Vec3;

use super::patch::{Frame, PREDICTION_M};
use super::shape::Part;

/// The numbers of the parts of a body at a frame that are near a ball.
pub(super) fn parts_near(parts: &[Part], frame: &Frame, centre_m: Vec3, radius_m: f32, near: &mut Vec<usize>) {
    let is_near = |part: &Part| {
        let reach_m = part.hull.radius_m + radius_m + PREDICTION_M;
        (frame.in_world(part.hull.centre_m) - centre_m).length_squared() <= reach_m * reach_m
    };
    near.clear();
    near.extend(parts.iter().enumerate().filter(|(_, part)| is_near(part)).map(|(number, _)| number));
}
