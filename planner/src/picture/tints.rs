//! Colours of Okabe and Ito (2008), which are distinguishable for the colour-blind.
//!
//! Green is reserved for the best grasp and vermilion for collisions, so no object has them. Other grasps fade from
//! dark to light grey, so their order is visible without colour, too.

pub(crate) use report::still::Rgb;

use crate::plan::PointLabel;

pub(super) const THIN_LINE: Rgb = [140; 3];
pub(super) const BEST: Rgb = [0, 158, 115];
pub(super) const COLLISION: Rgb = [213, 94, 0];
pub(super) const OTHER_DROP: Rgb = [120; 3];

const PLANE: Rgb = [226; 3];
const NOISE: Rgb = [150; 3];
/// Sky blue, purple, yellow, orange, blue; then darker versions.
const OBJECTS: [Rgb; 10] = [
    [86, 180, 233],
    [204, 121, 167],
    [240, 228, 66],
    [230, 159, 0],
    [0, 114, 178],
    [56, 118, 153],
    [134, 79, 110],
    [158, 150, 43],
    [151, 104, 0],
    [0, 75, 117],
];

/// The colour of a point. After ten objects the colours repeat.
pub(crate) const fn of_label(label: PointLabel) -> Rgb {
    match label {
        PointLabel::Plane => PLANE,
        PointLabel::Noise => NOISE,
        PointLabel::Object(object) => OBJECTS[object % OBJECTS.len()],
    }
}

/// A grasp's colour by its rank among the `count` drawn ones; 0 is the best.
pub(super) fn of_place(place: usize, count: usize) -> Rgb {
    if place == 0 {
        return BEST;
    }
    let share = (place - 1) as f32 / (count.max(6) - 2) as f32;
    [(60.0 + 105.0 * share.min(1.0)) as u8; 3]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rec. 601: the grey value without colour.
    fn grey([r, g, b]: Rgb) -> f32 {
        0.299 * f32::from(r) + 0.587 * f32::from(g) + 0.114 * f32::from(b)
    }

    #[test]
    fn neighbouring_objects_differ_and_none_looks_like_a_grasp() {
        for object in 0..10 {
            let tint = of_label(PointLabel::Object(object));
            assert_ne!(tint, of_label(PointLabel::Object(object + 1)));
            assert!(![BEST, COLLISION, of_label(PointLabel::Plane), of_label(PointLabel::Noise)].contains(&tint));
        }
    }

    #[test]
    fn grasps_fade_with_their_rank() {
        for count in [2, 3, 12] {
            let greys: Vec<f32> = (1..count).map(|place| grey(of_place(place, count))).collect();
            assert!(greys.is_sorted() && (greys[0] - 60.0).abs() < 0.01, "{greys:?}");
            assert!(greys[greys.len() - 1] < 165.1);
        }
    }
}
