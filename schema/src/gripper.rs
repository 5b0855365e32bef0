//! The gripper: a free-floating parallel jaw made of three boxes, or of five where its fingers have thinner tips; or
//! one whose two jaws have boxes and ways of their own.
//!
//! In the grasp frame the fingers reach from z = −`finger_length_m` to z = 0 and open along y; the palm lies behind
//! them. One gripper file serves the generator, the cross-check, the planner and the experiments.

use std::path::Path;

use serde::{Deserialize, Serialize};
use settings::{Document, Reader, Setting as _, Value, faults_of, hint, settings};

use crate::{GripperBox, Jaw, JawPath, Pose, Quat, Vec3};

settings! {
    /// A parallel-jaw gripper.
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Gripper {
        /// Its name.
        pub name: String,
        /// Distance between the fingers' inner faces when open.
        pub opening_m_max: f32 where 0.005..=0.5,
        /// Finger length along z.
        pub finger_length_m: f32 where 0.005..=0.5,
        /// Finger width along x.
        pub finger_width_m: f32 where 0.001..=0.2,
        /// Finger thickness along y, at its thickest.
        pub finger_thickness_m: f32 where 0.001..=0.1,
        /// The part of the fingers at their tips that is thinner, if there is one, `{ thickness_m, length_m }`. Inner
        /// faces are straight.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub finger_tip: Option<FingerTip>; or None,
        /// The jaw at −y and the one at +y, if they are other than fingers that slide alike along y. Judges, which see
        /// parallel jaws, go by the lengths of the fingers.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        pub jaws: Vec<Jaw>; or Vec::new(),
        /// Palm length along z.
        pub palm_length_m: f32 where 0.001..=0.5,
        /// Palm width along x.
        pub palm_width_m: f32 where 0.001..=0.5,
        /// Palm breadth along y.
        pub palm_breadth_m: f32 where 0.001..=0.5,
        /// Mass of a finger.
        pub finger_mass_kg: f32 where 0.005..=5.0,
        /// Closing force of a finger.
        pub finger_force_n: f32 where 0.1..=500.0,
        /// Closing speed of a finger.
        pub closing_speed_m_s: f32 where 0.001..=1.0,
        /// Friction coefficient of the fingers and palm.
        pub friction: f32 where 0.0..=5.0,
        /// The approaching gripper collides with what comes nearer than this.
        pub clearance_m: f32 where 0.0..=0.02,
        /// The grasp frame in the frame of the robot's flange, `{ position_m = [x, y, z], quaternion_xyzw = [x, y, z,
        /// w] }`: for plans, which then give the flange's poses too. No dataset stores it, because labels do not depend
        /// on it.
        #[serde(skip)]
        pub flange_from_grasp: Option<PoseParts>; or None,
        /// What a driver says of the gripper at its widest opening and closed, `{ open, closed }`: for plans, which
        /// then give what it is to be told. No dataset stores it.
        #[serde(skip)]
        pub joint: Option<Joint>; or None,
    }
    check Gripper::fits_together
}

settings! {
    /// The positions of the joint of a gripper, in the unit of its driver.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Joint {
        /// At the widest opening.
        pub open: f32 where -1e4..=1e4,
        /// Closed.
        pub closed: f32 where -1e4..=1e4,
    }
}

settings! {
    /// The thinner part of a finger, down to its tip.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct FingerTip {
        /// Thickness along y.
        pub thickness_m: f32 where 0.001..=0.1,
        /// Length along z.
        pub length_m: f32 where 0.001..=0.5,
    }
}

settings! {
    /// A rigid transform in a file.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct PoseParts {
        /// Translation x, y, z.
        pub position_m: [f32; 3] where -1.0..=1.0,
        /// Rotation, a unit quaternion x, y, z, w.
        pub quaternion_xyzw: [f32; 4] where -1.0..=1.0,
    }
    check PoseParts::is_rotation
}

impl PoseParts {
    /// How far from 1 the length of a quaternion may be; it is normalised.
    const LENGTH_OFF_MAX: f32 = 1e-3;

    fn is_rotation(&self, reader: &mut Reader<'_>) {
        let length = Quat::from_array(self.quaternion_xyzw).length();
        let rule = || format!("must have a length of 1 within {}, got {length:.4}", Self::LENGTH_OFF_MAX);
        reader.must("quaternion_xyzw", (length - 1.0).abs() <= Self::LENGTH_OFF_MAX, rule);
    }

    /// The transform.
    #[must_use]
    pub fn pose(&self) -> Pose {
        let rotation = Quat::from_array(self.quaternion_xyzw).normalize();
        Pose::from_parts(Vec3::from_array(self.position_m), rotation)
    }
}

/// The tips of closed jaws may be so far apart or beyond each other, as a share of the opening.
const CLOSED_OFF_MAX: f32 = 0.02;
/// Places at which a jaw is looked at on its way.
const SWEEP_STEPS: u16 = 16;
/// As exactly as single precision has it.
const SHARE_HALVINGS: usize = 24;

impl Gripper {
    /// Names and files of the grippers that need no file.
    pub const BUILT_IN: [(&'static str, &'static str); 8] = [
        ("parallel_jaw_80", include_str!("../../configs/grippers/parallel_jaw_80.toml")),
        ("robotiq_2f_85", include_str!("../../configs/grippers/robotiq_2f_85.toml")),
        ("slim_jaw_50", include_str!("../../configs/grippers/slim_jaw_50.toml")),
        ("franka_hand", include_str!("../../configs/grippers/franka_hand.toml")),
        ("wsg_50", include_str!("../../configs/grippers/wsg_50.toml")),
        ("robotiq_2f_140", include_str!("../../configs/grippers/robotiq_2f_140.toml")),
        ("robotiq_hand_e", include_str!("../../configs/grippers/robotiq_hand_e.toml")),
        ("so_101", include_str!("../../configs/grippers/so_101.toml")),
    ];

    /// A fixed jaw is put so far beside what is to be gripped, beyond its clearance.
    pub const BESIDE_M: f32 = 0.002;

    fn fits_together(&self, reader: &mut Reader<'_>) {
        for (key, got, most) in self.finger_tip.into_iter().flat_map(|tip| {
            [
                ("finger_tip.thickness_m", tip.thickness_m, self.finger_thickness_m),
                ("finger_tip.length_m", tip.length_m, self.finger_length_m),
            ]
        }) {
            reader.must(key, got <= most, || format!("must be at most the finger's, {most}, got {got}"));
        }
        let (count, opening_m) = (self.jaws.len(), self.opening_m_max);
        reader.must("jaws", count == 0 || count == 2, || format!("must be two, got {count}"));
        for (jaw, side) in self.jaws.iter().zip([-0.5, 0.5]) {
            let key = if side < 0.0 { "jaws[0]" } else { "jaws[1]" };
            reader.within(key, |reader| jaw.is_sound(Vec3::Y * (side * opening_m), reader));
        }
        let closed_m: f32 = self.reach_m(self.ways_m()).iter().sum();
        reader.must("jaws", (closed_m / opening_m - 1.0).abs() <= CLOSED_OFF_MAX, || {
            format!("must close by opening_m_max along y, {opening_m}, got {closed_m}")
        });
    }

    /// The ways of the jaws, left (−y) and right.
    #[must_use]
    pub fn paths(&self) -> [JawPath; 2] {
        let tips_m = [-0.5, 0.5].map(|side| Vec3::Y * (side * self.opening_m_max));
        let alike = |tip_m: Vec3| Jaw { slide_m: (-tip_m).to_array(), ..Jaw::default() }.path(tip_m);
        [0, 1].map(|side| self.jaws.get(side).map_or_else(|| alike(tips_m[side]), |jaw| jaw.path(tips_m[side])))
    }

    /// How far each tip goes until the gripper is closed, in metres.
    #[must_use]
    pub fn ways_m(&self) -> [f32; 2] {
        self.paths().map(|path| path.way_m)
    }

    /// How far the tips are along y from where they are at the widest opening when they have come so far on their ways.
    #[must_use]
    pub fn reach_m(&self, closed_m: [f32; 2]) -> [f32; 2] {
        if self.jaws.is_empty() {
            return closed_m;
        }
        let paths = self.paths();
        [0, 1].map(|side| [1.0, -1.0][side] * paths[side].tip_moved_m(closed_m[side]).y)
    }

    /// Opening between tips that have come so far on their ways, in metres.
    #[must_use]
    pub fn gap_m(&self, closed_m: [f32; 2]) -> f32 {
        let [left, right] = self.reach_m(closed_m);
        (self.opening_m_max - left - right).max(0.0)
    }

    /// The jaw that is fixed, if one is: left (0) or right.
    #[must_use]
    pub fn fixed_side(&self) -> Option<usize> {
        self.jaws.iter().position(|jaw| jaw.slide_m == [0.0; 3] && jaw.turn_rad == [0.0; 3])
    }

    /// How far along y a gripper goes from where a thing is in its middle to where its fixed jaw, if it has one, is
    /// beside that: [`Self::BESIDE_M`] and its clearance away.
    #[must_use]
    pub fn aside_m(&self, width_m: f32) -> f32 {
        let way_m = (0.5 * (self.span_m() - width_m) - Self::BESIDE_M).max(0.0);
        self.fixed_side().map_or(0.0, |side| [way_m, -way_m][side])
    }

    /// The share of both jaws' ways that leaves an opening between the tips.
    fn share(&self, opening_m: f32) -> f32 {
        let (ways_m, [mut low, mut high]) = (self.ways_m(), [0.0, 1.0]);
        for _ in 0..SHARE_HALVINGS {
            let middle = 0.5 * (low + high);
            *if self.gap_m(ways_m.map(|way_m| middle * way_m)) > opening_m { &mut low } else { &mut high } = middle;
        }
        if opening_m < self.opening_m_max { high } else { 0.0 }
    }

    /// How far the tips have come on their ways when they leave such an opening.
    fn closed_m(&self, opening_m: f32) -> [f32; 2] {
        let share = self.share(opening_m);
        self.ways_m().map(|way_m| share * way_m)
    }

    /// What a driver is to be told for an opening between the tips, if the gripper's file says what it is told at the
    /// widest opening and closed; what lies between is even along the jaws' ways.
    #[must_use]
    pub fn joint_position(&self, opening_m: f32) -> Option<f32> {
        self.joint.map(|Joint { open, closed }| open + self.share(opening_m) * (closed - open))
    }

    /// The widest that it takes between its fingers, in metres.
    #[must_use]
    pub fn span_m(&self) -> f32 {
        self.opening_m_max - 2.0 * self.clearance_m
    }

    /// From its base to its tips along the approach, in metres: the flange's distance if its file has it, else palm and
    /// fingers.
    #[must_use]
    pub fn base_to_tips_m(&self) -> f32 {
        let along_m = |pose: Pose| pose.translation.dot((pose.rotation * Vec3::Z).normalize());
        self.flange_from_grasp.map_or(self.finger_length_m + self.palm_length_m, |parts| along_m(parts.pose()))
    }

    /// Reads the name of a built-in gripper, the path of a gripper's file, which ends in `.toml`, or a table with what
    /// such a file has.
    pub fn read_named(value: &Value, (): &(), reader: &mut Reader<'_>) -> Option<Self> {
        if matches!(value, Value::Table(_)) {
            return Self::read(value, &(), reader);
        }
        let name = String::read(value, &(), reader)?;
        let text = match Self::BUILT_IN.iter().find(|(built_in, _)| *built_in == name) {
            Some((_, text)) => Ok((*text).to_owned()),
            None if name.ends_with(".toml") => reader.text_of(&name),
            None => {
                let names = Self::BUILT_IN.map(|(name, _)| name);
                let (hint, names, got) = (hint(&name, names), names.join(", "), name.escape_debug());
                Err(format!("must be a path that ends in .toml or one of {names}, got {got}{hint}"))
            }
        };
        match text {
            Ok(text) => reader.in_file(&name, &text),
            Err(rule) => {
                reader.fault(rule);
                None
            }
        }
    }

    /// A gripper from the text of its TOML file.
    ///
    /// # Errors
    /// All that is wrong with the text.
    pub fn from_toml(text: &str) -> Result<Self, settings::Error> {
        Document::parse(text, Path::new("gripper"))?.read_as("gripper")
    }

    /// What of it is out of its ranges, if no settings were read for it.
    #[must_use]
    pub fn faults(&self) -> Vec<String> {
        faults_of(self, "gripper")
    }

    /// Its numbers, by their keys.
    #[must_use]
    pub fn numbers(&self) -> [(&'static str, f32); 12] {
        [
            ("opening_m_max", self.opening_m_max),
            ("finger_length_m", self.finger_length_m),
            ("finger_width_m", self.finger_width_m),
            ("finger_thickness_m", self.finger_thickness_m),
            ("palm_length_m", self.palm_length_m),
            ("palm_width_m", self.palm_width_m),
            ("palm_breadth_m", self.palm_breadth_m),
            ("finger_mass_kg", self.finger_mass_kg),
            ("finger_force_n", self.finger_force_n),
            ("closing_speed_m_s", self.closing_speed_m_s),
            ("friction", self.friction),
            ("clearance_m", self.clearance_m),
        ]
    }

    /// The two fingers (−y, then +y) with their inner faces `width_m` apart, as thick as their tips: what grips, and
    /// all that physics moves. What is thicker behind the tips is outside of them. Of other jaws, where such fingers
    /// would have the same tips.
    #[must_use]
    pub fn fingers(&self, width_m: f32) -> [GripperBox; 2] {
        let thickness_m = self.finger_tip.map_or(self.finger_thickness_m, |tip| tip.thickness_m);
        if self.jaws.is_empty() {
            return self.fingers_behind(width_m, thickness_m, 0.0);
        }
        let open = self.fingers_behind(self.opening_m_max, thickness_m, 0.0);
        let (paths, closed_m) = (self.paths(), self.closed_m(width_m));
        [0, 1].map(|side| open[side].moved(paths[side].tip_moved_m(closed_m[side])))
    }

    /// The fingers but for so much of their tips.
    fn fingers_behind(&self, width_m: f32, thickness_m: f32, tip_m: f32) -> [GripperBox; 2] {
        let half_m = Vec3::new(self.finger_width_m, thickness_m, self.finger_length_m - tip_m) * 0.5;
        [-1.0, 1.0].map(|side| {
            let centre_m = Vec3::new(0.0, side * (0.5 * width_m + half_m.y), -half_m.z - tip_m);
            GripperBox { centre_m, half_m }
        })
    }

    /// The palm.
    #[must_use]
    pub fn palm(&self) -> GripperBox {
        let half_m = Vec3::new(self.palm_width_m, self.palm_breadth_m, self.palm_length_m) * 0.5;
        GripperBox { centre_m: Vec3::new(0.0, 0.0, -self.finger_length_m - half_m.z), half_m }
    }

    /// The whole open gripper: the [fingers](Self::fingers), the palm, and where they are thicker behind their tips,
    /// the fingers there.
    #[must_use]
    pub fn open_gripper(&self) -> Vec<GripperBox> {
        self.boxes(self.opening_m_max)
    }

    /// The whole gripper, as [`Self::open_gripper`] has it, with the fingers' inner faces `width_m` apart.
    #[must_use]
    pub fn boxes(&self, width_m: f32) -> Vec<GripperBox> {
        self.parts(self.closed_m(width_m)).into_iter().map(|(_, part)| part).collect()
    }

    /// What grips of each jaw, and all that physics moves: its boxes as they are given ([`JawPath::pose_of_boxes`]).
    #[must_use]
    pub fn jaw_boxes(&self) -> [Vec<GripperBox>; 2] {
        let thickness_m = self.finger_tip.map_or(self.finger_thickness_m, |tip| tip.thickness_m);
        let fingers = self.fingers_behind(self.opening_m_max, thickness_m, 0.0);
        let paths = self.paths();
        [0, 1].map(|side| match self.jaws.get(side) {
            Some(jaw) if !jaw.boxes.is_empty() => jaw.given(&paths[side]).collect(),
            _ => vec![fingers[side]],
        })
    }

    /// What grips of a jaw, once its tip has come so far on its way; where it is turned, covered by boxes.
    #[must_use]
    pub fn jaw_at(&self, side: usize, closed_m: f32) -> Vec<GripperBox> {
        let pose = self.paths()[side].pose_of_boxes(closed_m);
        self.jaw_boxes()[side].iter().flat_map(|part| part.covered(&pose)).collect()
    }

    /// All that this passes on that way: of one that goes along y exactly, of another at `SWEEP_STEPS` places.
    #[must_use]
    pub fn jaw_sweep(&self, side: usize, closed_m: f32) -> Vec<GripperBox> {
        let path = self.paths()[side];
        if path.is_along_y() {
            let way_m = path.pose(closed_m).translation;
            return self.jaw_boxes()[side].iter().map(|part| part.swept(way_m)).collect();
        }
        let share = |step: u16| f32::from(step) / f32::from(SWEEP_STEPS);
        (0..=SWEEP_STEPS).flat_map(|step| self.jaw_at(side, share(step) * closed_m)).collect()
    }

    /// All of [`Self::open_gripper`], once the tips have come so far on their ways, and what each box belongs to: the
    /// left jaw (0), the right one or the palm. Boxes of a jaw that is turned are covered by several, each at most 4 mm
    /// long.
    #[must_use]
    pub fn parts(&self, closed_m: [f32; 2]) -> Vec<(usize, GripperBox)> {
        let (paths, [left, right]) = (self.paths(), self.jaw_boxes().map(Vec::into_iter));
        let behind =
            self.finger_tip.map(|tip| self.fingers_behind(self.opening_m_max, self.finger_thickness_m, tip.length_m));
        let behind = behind.into_iter().flatten().enumerate();
        let behind = behind.filter(|(side, _)| self.jaws.get(*side).is_none_or(|jaw| jaw.boxes.is_empty()));
        let jaws = left.map(|part| (0, part)).chain(right.map(|part| (1, part)));
        let placed = |(of, part): (usize, GripperBox)| {
            let pose = paths.get(of).map_or(Pose::IDENTITY, |path| path.pose_of_boxes(closed_m[of]));
            part.covered(&pose).into_iter().map(move |part| (of, part))
        };
        jaws.chain([(2, self.palm())]).chain(behind).flat_map(placed).collect()
    }

    /// The robot's flange in the frame in which a grasp is given, if the gripper's file says where it is.
    #[must_use]
    pub fn target_from_flange(&self, target_from_grasp: &Pose) -> Option<Pose> {
        self.flange_from_grasp.map(|flange_from_grasp| *target_from_grasp * flange_from_grasp.pose().inverse())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAPER: &str = Gripper::BUILT_IN[0].1;

    #[test]
    fn a_thin_tip_is_a_part_of_its_finger() {
        let [plain, tipped] =
            [Gripper::BUILT_IN[0].1, Gripper::BUILT_IN[3].1].map(|text| Gripper::from_toml(text).unwrap());
        assert_eq!((plain.open_gripper().len(), tipped.open_gripper().len()), (3, 5));
        let low_m = |b: &GripperBox| b.centre_m - b.half_m;
        let high_m = |b: &GripperBox| b.centre_m + b.half_m;
        let boxes = tipped.boxes(0.03);
        let tip = tipped.finger_tip.unwrap();
        for (finger, thick, side) in [(&boxes[0], &boxes[3], -1.0), (&boxes[1], &boxes[4], 1.0)] {
            assert!((2.0 * finger.half_m.y - tip.thickness_m).abs() < 1e-6 && high_m(finger).z == 0.0);
            assert!((2.0 * thick.half_m.y - tipped.finger_thickness_m).abs() < 1e-6);
            assert!((high_m(thick).z + tip.length_m).abs() < 1e-6 && (low_m(thick).z - low_m(finger).z).abs() < 1e-6);
            for part in [finger, thick] {
                let inner_m = part.centre_m.y - side * part.half_m.y;
                assert!((inner_m - side * 0.015).abs() < 1e-6, "inner faces are straight");
            }
        }
        let too_thick = Gripper::BUILT_IN[3].1.replace("thickness_m = 0.014", "thickness_m = 0.027");
        let message = Gripper::from_toml(&too_thick).unwrap_err().to_string();
        assert!(message.contains("finger_tip.thickness_m must be at most the finger's, 0.026, got 0.027"), "{message}");
    }

    #[test]
    fn the_shipped_gripper_is_the_designs() {
        let gripper = Gripper::from_toml(PAPER).unwrap();
        let [left, right, palm] = gripper.open_gripper().try_into().unwrap();
        let inner_gap = (right.centre_m.y - right.half_m.y) - (left.centre_m.y + left.half_m.y);
        assert!((inner_gap - 0.08).abs() < 1e-6);
        assert!((left.centre_m.z + left.half_m.z).abs() < 1e-6, "finger tips end at z = 0");
        assert!((palm.centre_m.z + palm.half_m.z + 0.05).abs() < 1e-6, "the palm begins behind the fingers");
    }

    settings! {
        struct Grippers {
            gripper: Gripper; by Gripper::read_named as "a gripper's name, or a path that ends in .toml",
        }
    }

    fn named(name: &str) -> Result<Gripper, settings::Error> {
        let text = format!("gripper = \"{name}\"");
        Document::parse(&text, Path::new("nowhere/grippers.toml")).unwrap().read::<Grippers>().map(|read| read.gripper)
    }

    #[test]
    fn built_in_grippers_are_sound_and_go_by_their_names() {
        for (name, _) in Gripper::BUILT_IN {
            assert_eq!(named(name).unwrap().name, name);
        }
        let near = named("franka").unwrap_err().to_string();
        assert!(near.contains("got franka, did you mean franka_hand?"), "{near}");
        let unknown = named("three_fingers").unwrap_err().to_string();
        assert!(!unknown.contains("did you mean"), "{unknown}");
        assert!(unknown.contains("gripper must be a path that ends in .toml"), "{unknown}");
        assert!(Gripper::BUILT_IN.iter().all(|(name, _)| unknown.contains(name)), "{unknown}");
        let missing = named("three_fingers.toml").unwrap_err().to_string();
        assert!(
            missing.contains("gripper cannot be read: ") && missing.contains("nowhere/three_fingers.toml"),
            "{missing}"
        );
    }

    #[test]
    fn every_value_out_of_range_is_named() {
        let bad =
            PAPER.replace("opening_m_max = 0.08", "opening_m_max = -1.0").replace("friction = 1.0", "friction = nan");
        let message = Gripper::from_toml(&bad).unwrap_err().to_string();
        assert!(message.contains("gripper.opening_m_max must be between 0.005 and 0.5, got -1"), "{message}");
        assert!(message.contains("gripper.friction"), "{message}");
        let bad = PAPER.replace("palm_width_m = ", "palm_width_m = \"x\" #").replace("clearance_m", "clearances_m");
        let message = Gripper::from_toml(&bad).unwrap_err().to_string();
        for told in [
            "gripper.palm_width_m must be a number between 0.001 and 0.5, got \"x\"",
            "gripper.clearances_m is an unknown key, did you mean clearance_m?",
            "gripper.clearance_m is missing: a number between 0 and 0.02",
        ] {
            assert!(message.contains(told), "{told} is not in {message}");
        }
    }

    #[test]
    fn a_flange_is_read_and_neither_needed_nor_stored() {
        let bare = Gripper::from_toml(PAPER).unwrap();
        assert_eq!((bare.flange_from_grasp, bare.target_from_flange(&Pose::IDENTITY)), (None, None));
        let flange =
            "flange_from_grasp = { position_m = [0.0, 0.0, 0.1], quaternion_xyzw = [0.0, 0.0, 0.7072, 0.7072] }";
        let mounted = Gripper::from_toml(&format!("{PAPER}\n{flange}")).unwrap();
        let mut stored = Value::try_from(&mounted).unwrap();
        assert_eq!(stored, Value::try_from(&bare).unwrap());
        assert_eq!(stored.clone().try_into::<Gripper>().unwrap(), bare);
        stored.as_table_mut().unwrap().insert("flange_from_grasp".to_owned(), true.into());
        let refused = stored.try_into::<Gripper>().unwrap_err().to_string();
        assert!(refused.contains("unknown field `flange_from_grasp`"), "no dataset has the key: {refused}");
        // A gripper that points straight down: its flange is 0.1 m above the tips, and a quarter turn about the
        // approach makes the flange's x the closing direction, backwards.
        let down = Pose::from_parts(Vec3::new(0.1, 0.2, 0.05), crate::axis_angle(Vec3::X, core::f32::consts::PI));
        let flange = mounted.target_from_flange(&down).unwrap();
        assert!((flange.translation - Vec3::new(0.1, 0.2, 0.15)).length() < 1e-6, "{flange:?}");
        assert!((flange.rotation * Vec3::X - down.rotation * -Vec3::Y).length() < 1e-5, "{flange:?}");
        assert!((flange * mounted.flange_from_grasp.unwrap().pose() * Vec3::ONE - down * Vec3::ONE).length() < 1e-5);
        for (wrong, told) in [
            (
                "{ position_m = [0, 0, 112.3], quaternion_xyzw = [0, 0, 0, 1] }",
                "gripper.flange_from_grasp.position_m must be",
            ),
            (
                "{ position_m = [0, 0, 0.1], quaternion_xyzw = [0, 0, 1, 1] }",
                "must have a length of 1 within 0.001, got 1.4142",
            ),
            ("{ position_m = [0, 0, 0.1], quaternion_xyzw = [0, 0, 1] }", "quaternion_xyzw must be four values"),
            ("{ position_m = [0, 0, 0.1] }", "gripper.flange_from_grasp.quaternion_xyzw is missing"),
        ] {
            let message = Gripper::from_toml(&format!("{PAPER}\nflange_from_grasp = {wrong}")).unwrap_err().to_string();
            assert!(message.contains(told), "{told} is not in {message}");
        }
    }

    #[test]
    fn flanges_lie_behind_the_fingers_and_turn_about_the_approach() {
        let mut mounted = 0;
        for (name, text) in Gripper::BUILT_IN {
            let gripper = Gripper::from_toml(text).unwrap();
            let Some(flange_from_grasp) = gripper.flange_from_grasp.map(|parts| parts.pose()) else { continue };
            mounted += 1;
            assert!(gripper.base_to_tips_m() > gripper.finger_length_m, "{name}");
            // SO-101's wrist has z backwards, and its jaws are beside it.
            let (tips_m, z) = (flange_from_grasp.translation, if name == "so_101" { -Vec3::Z } else { Vec3::Z });
            assert!(name == "so_101" || tips_m.truncate().length() < 1e-6, "{name}: {tips_m}");
            assert!(name == "so_101" || gripper.base_to_tips_m() == tips_m.z, "{name}: files keep their bytes");
            assert!((flange_from_grasp.rotation * Vec3::Z - z).length() < 1e-5, "{name}");
        }
        assert_eq!(mounted, 6, "all but the two that are no products");
    }

    #[test]
    fn a_swept_box_covers_both_ends() {
        let finger = Gripper::from_toml(PAPER).unwrap().open_gripper()[0];
        let swept = finger.swept_back(0.05);
        let ends = |b: &GripperBox| (b.centre_m.z - b.half_m.z, b.centre_m.z + b.half_m.z);
        assert!((ends(&swept).1 - ends(&finger).1).abs() < 1e-6);
        assert!((ends(&swept).0 - (ends(&finger).0 - 0.05)).abs() < 1e-6);
    }
}
