//! A drawing of a hand with its measures, from two sides, as SVG: for those who write a gripper's file.

use std::fmt::Write as _;

use schema::{Gripper, HandBox, Vec3};

use crate::figure::FONT;

/// Pixels per metre, unless the hand is too large for that.
const SCALE_MAX_PX: f32 = 2400.0;
/// The largest drawing of a side.
const SIDE_MAX_PX: [f32; 2] = [520.0, 460.0];
/// Room for the measures around a side.
const LEFT_PX: f32 = 150.0;
const RIGHT_PX: f32 = 130.0;
const TOP_PX: f32 = 96.0;
const BOTTOM_PX: f32 = 110.0;

const PALM: &str = "#c9ced6";
const FINGER: &str = "#7fb0dd";
/// The axes' colours, as in other tools: x red, y green, z blue.
const AXES: [&str; 3] = ["#c0392b", "#1e8449", "#1f4fbf"];

/// A side of the hand. +z goes down.
struct Side {
    title: &'static str,
    /// The axis that goes to the right, of x and y, and how the other one is seen.
    right: (Vec3, usize),
    other: (&'static str, usize),
    measures: fn(&mut Drawing, &Gripper, f32),
}

const SIDES: [Side; 2] = [
    Side {
        title: "along x: the jaw closes from left and right",
        right: (Vec3::Y, 1),
        other: ("x ⊗", 0),
        measures: Drawing::measures_along_x,
    },
    Side {
        title: "against y: one finger hides the other",
        right: (Vec3::X, 0),
        other: ("y ⊙", 1),
        measures: Drawing::measures_against_y,
    },
];

/// The hand, open, along x and against y, each measure under its key in millimetres, with the grasp frame's axes and,
/// if the file says where it is, the flange.
#[must_use]
pub fn svg(gripper: &Gripper) -> String {
    let boxes = gripper.open_hand();
    let reach_m =
        |axis: Vec3| boxes.iter().map(|b| (b.centre_m.dot(axis)).abs() + b.half_m.dot(axis)).fold(0.0, f32::max);
    let flange_m = gripper.flange_from_grasp.map(|parts| parts.pose().translation.z);
    let length_m = (gripper.finger_length_m + gripper.palm_length_m).max(flange_m.unwrap_or(0.0));
    let breadth_m = 2.0 * reach_m(Vec3::Y);
    let scale = SCALE_MAX_PX.min(SIDE_MAX_PX[0] / breadth_m).min(SIDE_MAX_PX[1] / length_m);
    let widths_px = [breadth_m, 2.0 * reach_m(Vec3::X)].map(|wide_m| LEFT_PX + wide_m.max(0.08) * scale + RIGHT_PX);
    let tips_px = TOP_PX + length_m * scale;
    let (width_px, height_px) = ((widths_px[0] + widths_px[1]).max(900.0), tips_px + BOTTOM_PX);
    let mut drawing = Drawing {
        text: format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width_px:.0} {height_px:.0}\" font-family=\"{FONT}\" \
             font-size=\"13\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>"
        ),
        scale,
        tips_px,
        middle_px: 0.0,
    };
    let title = format!("{}: {} open", gripper.name, millimetres(gripper.opening_m_max));
    drawing.words([20.0, 30.0], "start", "#111", &title);
    for (side, (left_px, width_px)) in SIDES.iter().zip([(0.0, widths_px[0]), (widths_px[0], widths_px[1])]) {
        drawing.middle_px = left_px + LEFT_PX + 0.5 * (width_px - LEFT_PX - RIGHT_PX);
        drawing.words([drawing.middle_px, 56.0], "middle", "#555", side.title);
        drawing.side(side, &boxes, flange_m);
        (side.measures)(&mut drawing, gripper, breadth_m);
    }
    drawing.text + "</svg>\n"
}

/// A drawing in progress; metres become pixels by `scale`, with the grasp's origin at `middle_px`, `tips_px`.
struct Drawing {
    text: String,
    scale: f32,
    tips_px: f32,
    middle_px: f32,
}

impl Drawing {
    fn x(&self, right_m: f32) -> f32 {
        self.middle_px + right_m * self.scale
    }

    fn y(&self, z_m: f32) -> f32 {
        self.tips_px + z_m * self.scale
    }

    // Writing to a String cannot fail, here and below.
    fn words(&mut self, [x_px, y_px]: [f32; 2], anchor: &str, colour: &str, words: &str) {
        let words = words.replace('&', "&amp;").replace('<', "&lt;");
        let _ = write!(
            self.text,
            "<text x=\"{x_px:.1}\" y=\"{y_px:.1}\" text-anchor=\"{anchor}\" fill=\"{colour}\">{words}</text>"
        );
    }

    fn line(&mut self, [x1, y1]: [f32; 2], [x2, y2]: [f32; 2], stroke: &str) {
        let _ = write!(self.text, "<path d=\"M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}\" {stroke}/>");
    }

    /// A line with a head at its end.
    fn arrow(&mut self, from: [f32; 2], to: [f32; 2], colour: &str, width: f32) {
        self.line(from, to, &format!("stroke=\"{colour}\" stroke-width=\"{width}\""));
        let along = [to[0] - from[0], to[1] - from[1]];
        let length = libm::hypotf(along[0], along[1]).max(1e-6);
        let [dx, dy] = along.map(|part| part / length * 4.0 * width.max(1.5));
        let [ax, ay, bx, by] =
            [to[0] - dx - 0.5 * dy, to[1] - dy + 0.5 * dx, to[0] - dx + 0.5 * dy, to[1] - dy - 0.5 * dx];
        let _ = write!(
            self.text,
            "<polygon points=\"{:.1},{:.1} {ax:.1},{ay:.1} {bx:.1},{by:.1}\" fill=\"{colour}\"/>",
            to[0], to[1]
        );
    }

    /// The boxes, the flange and the axes.
    fn side(&mut self, side: &Side, boxes: &[HandBox], flange_m: Option<f32>) {
        let (right, right_axis) = side.right;
        for (number, HandBox { centre_m, half_m }) in boxes.iter().enumerate() {
            let (centre, half) = (centre_m.dot(right), half_m.dot(right));
            let (x, y) = (self.x(centre - half), self.y(centre_m.z - half_m.z));
            let (width, height) = (2.0 * half * self.scale, 2.0 * half_m.z * self.scale);
            let (class, fill) = match number {
                2 => ("palm", PALM),
                0 | 1 => ("finger", FINGER),
                _ => ("behind-tip", FINGER),
            };
            let _ = write!(
                self.text,
                "<rect class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" \
                 fill=\"{fill}\" stroke=\"#444\"/>"
            );
        }
        let (x, y) = (self.x(0.0), self.y(-boxes[2].centre_m.z.abs()));
        self.words([x, y + 5.0], "middle", "#333", "palm");
        if let Some(flange_m) = flange_m {
            let y = self.y(-flange_m);
            self.line([x - 60.0, y], [x + 60.0, y], "stroke=\"#8e44ad\" stroke-dasharray=\"7 4\" stroke-width=\"1.6\"");
            self.words([x, y + 15.0], "middle", "#8e44ad", "flange");
        }
        let (y, long) = (self.y(0.0), 46.0);
        self.arrow([x, y], [x + long, y], AXES[right_axis], 2.2);
        self.words([x + long - 6.0, y - 8.0], "middle", AXES[right_axis], ["x", "y"][right_axis]);
        self.arrow([x, y], [x, y + long], AXES[2], 2.2);
        self.words([x + 7.0, y + long], "start", AXES[2], "z");
        self.words([x - 6.0, y + 14.0], "end", AXES[side.other.1], side.other.0);
    }

    /// A measure across, so many pixels below a height or, if negative, above it, between arrows; its words are beside
    /// it or at its middle.
    fn across(&mut self, [from_m, to_m]: [f32; 2], at_z_m: f32, off_px: f32, is_beside: bool, name: &str) {
        let (left, right, edge) = (self.x(from_m), self.x(to_m), self.y(at_z_m));
        let y = edge + off_px;
        for (x, outside) in [(left, -14.0), (right, 14.0)] {
            self.line([x, edge], [x, y + 4.0 * off_px.signum()], "stroke=\"#999\" stroke-width=\"0.8\"");
            self.arrow([x + outside, y], [x, y], "#222", 1.0);
        }
        let words = format!("{name} {}", millimetres(to_m - from_m));
        if is_beside {
            self.words([right + 20.0, y + 4.0], "start", "#222", &words);
        } else {
            let text_y = if off_px > 0.0 { y + 16.0 } else { y - 6.0 };
            self.words([0.5 * (left + right), text_y], "middle", "#222", &words);
        }
    }

    /// A measure along z, at the left.
    fn along(&mut self, [from_m, to_m]: [f32; 2], edge_m: f32, name: &str) {
        let (top, bottom, edge) = (self.y(from_m), self.y(to_m), self.x(edge_m));
        let x = edge - 16.0;
        for y in [top, bottom] {
            self.line([edge, y], [x - 4.0, y], "stroke=\"#999\" stroke-width=\"0.8\"");
        }
        let middle = 0.5 * (top + bottom);
        self.arrow([x, middle], [x, top], "#222", 1.0);
        self.arrow([x, middle], [x, bottom], "#222", 1.0);
        self.words([x - 6.0, middle - 3.0], "end", "#222", name);
        self.words([x - 6.0, middle + 13.0], "end", "#222", &millimetres(to_m - from_m));
    }

    fn measures_along_x(&mut self, gripper: &Gripper, breadth_m: f32) {
        let &Gripper { opening_m_max, finger_length_m, finger_thickness_m, palm_length_m, palm_breadth_m, .. } =
            gripper;
        let (edge_m, back_m) = (-0.5 * breadth_m, -finger_length_m - palm_length_m);
        let [opening_m, palm_m] = [opening_m_max, palm_breadth_m].map(|wide_m| [-0.5 * wide_m, 0.5 * wide_m]);
        self.along([-finger_length_m, 0.0], edge_m, "finger_length_m");
        self.along([back_m, -finger_length_m], edge_m, "palm_length_m");
        self.across(palm_m, back_m, -14.0, false, "palm_breadth_m");
        self.across(opening_m, 0.0, 64.0, false, "opening_m_max");
        let finger_m = [opening_m[1], opening_m[1] + finger_thickness_m];
        self.across(finger_m, 0.0, 30.0, true, "finger_thickness_m");
    }

    fn measures_against_y(&mut self, gripper: &Gripper, _breadth_m: f32) {
        let &Gripper { finger_length_m, finger_width_m, palm_length_m, palm_width_m, .. } = gripper;
        let [finger_m, palm_m] = [finger_width_m, palm_width_m].map(|wide_m| [-0.5 * wide_m, 0.5 * wide_m]);
        self.across(palm_m, -finger_length_m - palm_length_m, -14.0, false, "palm_width_m");
        self.across(finger_m, 0.0, 64.0, false, "finger_width_m");
        if let Some(parts) = gripper.flange_from_grasp {
            self.along([-parts.pose().translation.z, 0.0], palm_m[0].min(finger_m[0]), "tips to flange");
        }
    }
}

/// A length in millimetres, to a tenth, without a zero at the end.
fn millimetres(length_m: f32) -> String {
    format!("{} mm", (1e4 * length_m).round() / 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hand(name: &str) -> Gripper {
        let (_, text) = Gripper::BUILT_IN.into_iter().find(|(built_in, _)| *built_in == name).unwrap();
        Gripper::from_toml(text).unwrap()
    }

    /// The rectangles of a class: x, y, width and height.
    fn boxes(svg: &str, class: &str) -> Vec<[f32; 4]> {
        let number = |rect: &str, key: &str| -> f32 {
            rect.split_once(&format!(" {key}=\"")).unwrap().1.split_once('"').unwrap().0.parse().unwrap()
        };
        let of_class = svg.split("<rect ").skip(1).filter(|rect| rect.starts_with(&format!("class=\"{class}\"")));
        of_class.map(|rect| ["x", "y", "width", "height"].map(|key| number(rect, key))).collect()
    }

    #[test]
    fn every_length_is_named_and_drawn_to_one_scale() {
        let franka = hand("franka_hand");
        let svg = svg(&franka);
        for words in [
            "opening_m_max 80 mm",
            "finger_length_m<",
            ">46 mm<",
            "finger_width_m 21 mm",
            "finger_thickness_m 26 mm",
            "palm_length_m<",
            ">66 mm<",
            "palm_width_m 63 mm",
            "palm_breadth_m 204 mm",
            "tips to flange",
            ">112.3 mm<",
        ] {
            assert!(svg.contains(words), "{words} is not in {svg}");
        }
        let [fingers, palms, thick] = ["finger", "palm", "behind-tip"].map(|class| boxes(&svg, class));
        assert_eq!((fingers.len(), palms.len()), (4, 2), "from two sides");
        let scale = palms[0][2] / franka.palm_breadth_m;
        let expected = [
            (fingers[0][2], franka.finger_tip.unwrap().thickness_m),
            (thick[0][2], franka.finger_thickness_m),
            (fingers[0][3] - thick[0][3], franka.finger_tip.unwrap().length_m),
            (fingers[0][3], franka.finger_length_m),
            (fingers[2][2], franka.finger_width_m),
            (palms[0][3], franka.palm_length_m),
            (palms[1][2], franka.palm_width_m),
            (fingers[1][0] - fingers[0][0] - fingers[0][2], franka.opening_m_max),
            (fingers[0][1] - palms[0][1], franka.palm_length_m),
        ];
        for (drawn_px, length_m) in expected {
            assert!((drawn_px - length_m * scale).abs() < 0.25, "{drawn_px} px for {length_m} m at {scale}");
        }
    }

    #[test]
    fn the_drawing_in_the_docs_is_this_one() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/pictures/franka_hand.svg");
        let stored = std::fs::read_to_string(path).unwrap();
        assert!(
            svg(&hand("franka_hand")) == stored,
            "graspmill gripper franka_hand --picture docs/pictures/franka_hand.svg"
        );
    }

    #[test]
    fn every_hand_fits_into_its_drawing() {
        let giant = Gripper { opening_m_max: 0.5, palm_breadth_m: 0.5, palm_length_m: 0.5, ..hand("wsg_50") };
        let tiny = Gripper { opening_m_max: 0.005, palm_breadth_m: 0.01, palm_length_m: 0.001, ..hand("slim_jaw_50") };
        for hand in Gripper::BUILT_IN.map(|(name, _)| hand(name)).into_iter().chain([giant, tiny]) {
            let svg = svg(&hand);
            let size: Vec<f32> =
                svg.split('"').nth(3).unwrap().split(' ').skip(2).map(|px| px.parse().unwrap()).collect();
            for [x, y, width, height] in boxes(&svg, "finger").into_iter().chain(boxes(&svg, "palm")) {
                assert!(x > 100.0 && y > 60.0 && x + width < size[0] && y + height < size[1], "{}: {svg}", hand.name);
            }
        }
        assert!(!svg(&hand("slim_jaw_50")).contains("flange"));
    }
}
