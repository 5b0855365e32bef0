//! The hand: a free-floating parallel jaw made of three boxes.
//!
//! In the grasp frame the fingers reach from z = −`finger_length_m` to z = 0 and open along y; the palm lies behind
//! them. One gripper file serves the generator, the cross-check, the planner and the experiments.

use serde::{Deserialize, Serialize};

use crate::{Pose, Vec3};

/// A parallel-jaw gripper.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gripper {
    /// Its name.
    pub name: String,
    /// Distance between the fingers' inner faces when open.
    pub opening_m_max: f32,
    /// Finger length along z.
    pub finger_length_m: f32,
    /// Finger width along x.
    pub finger_width_m: f32,
    /// Finger thickness along y.
    pub finger_thickness_m: f32,
    /// Palm length along z.
    pub palm_length_m: f32,
    /// Palm width along x.
    pub palm_width_m: f32,
    /// Palm breadth along y.
    pub palm_breadth_m: f32,
    /// Mass of a finger.
    pub finger_mass_kg: f32,
    /// Closing force of a finger.
    pub finger_force_n: f32,
    /// Closing speed of a finger.
    pub closing_speed_m_s: f32,
    /// Friction coefficient of the fingers and palm.
    pub friction: f32,
    /// The approaching hand collides with what comes nearer than this.
    pub clearance_m: f32,
}

/// A box of the hand in the grasp frame, axes along the frame's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandBox {
    /// Centre, in metres.
    pub centre_m: Vec3,
    /// Half lengths, in metres.
    pub half_m: Vec3,
}

/// Why a gripper file is refused.
#[derive(Debug, thiserror::Error)]
pub enum GripperError {
    /// Not TOML, or not a gripper's keys.
    #[error("not a gripper file: {0}")]
    Parse(String),
    /// Values out of range, all of them.
    #[error("{}", .0.join("; "))]
    Range(Vec<String>),
}

impl Gripper {
    /// Names and files of the hands that need no file.
    pub const BUILT_IN: [(&'static str, &'static str); 3] = [
        ("parallel_jaw_80", include_str!("../../configs/grippers/parallel_jaw_80.toml")),
        ("robotiq_2f_85", include_str!("../../configs/grippers/robotiq_2f_85.toml")),
        ("slim_jaw_50", include_str!("../../configs/grippers/slim_jaw_50.toml")),
    ];

    /// The built-in gripper of that name, or the one in the file that a name ending in `.toml` means; `read` gives that file's text.
    ///
    /// # Errors
    /// For people: the name is neither, `read`'s message, or what is wrong with the file.
    pub fn named(name: &str, read: impl FnOnce(&str) -> Result<String, String>) -> Result<Self, String> {
        let text = match Self::BUILT_IN.iter().find(|(built_in, _)| *built_in == name) {
            Some((_, text)) => (*text).to_owned(),
            None if name.ends_with(".toml") => read(name)?,
            None => {
                let names = Self::BUILT_IN.map(|(name, _)| name).join(", ");
                return Err(format!("gripper must be a path that ends in .toml or one of {names}, got {name}"));
            }
        };
        Self::from_toml(&text).map_err(|e| format!("{e}: {name}"))
    }

    /// A gripper from the text of its TOML file.
    ///
    /// # Errors
    /// [`GripperError`] if the text is not TOML, a key is missing or unknown, or values are out of range.
    pub fn from_toml(text: &str) -> Result<Self, GripperError> {
        let gripper: Self = toml::from_str(text).map_err(|e| GripperError::Parse(e.message().to_owned()))?;
        let problems = gripper.problems();
        if problems.is_empty() { Ok(gripper) } else { Err(GripperError::Range(problems)) }
    }

    /// What is out of range, one message each.
    #[must_use]
    pub fn problems(&self) -> Vec<String> {
        let ranges = [
            ("opening_m_max", self.opening_m_max, 0.005, 0.5),
            ("finger_length_m", self.finger_length_m, 0.005, 0.5),
            ("finger_width_m", self.finger_width_m, 0.001, 0.2),
            ("finger_thickness_m", self.finger_thickness_m, 0.001, 0.1),
            ("palm_length_m", self.palm_length_m, 0.001, 0.5),
            ("palm_width_m", self.palm_width_m, 0.001, 0.5),
            ("palm_breadth_m", self.palm_breadth_m, 0.001, 0.5),
            ("finger_mass_kg", self.finger_mass_kg, 0.005, 5.0),
            ("finger_force_n", self.finger_force_n, 0.1, 500.0),
            ("closing_speed_m_s", self.closing_speed_m_s, 0.001, 1.0),
            ("friction", self.friction, 0.0, 5.0),
            ("clearance_m", self.clearance_m, 0.0, 0.02),
        ];
        ranges
            .into_iter()
            .filter(|(_, value, low, high)| !(value >= low && value <= high))
            .map(|(key, value, low, high)| format!("gripper.{key} must be between {low} and {high}, got {value}"))
            .collect()
    }

    /// The two fingers (−y, then +y) with their inner faces `width_m` apart.
    #[must_use]
    pub fn fingers(&self, width_m: f32) -> [HandBox; 2] {
        let half_m = Vec3::new(self.finger_width_m, self.finger_thickness_m, self.finger_length_m) * 0.5;
        [-1.0, 1.0]
            .map(|side| HandBox { centre_m: Vec3::new(0.0, side * (0.5 * width_m + half_m.y), -half_m.z), half_m })
    }

    /// The palm.
    #[must_use]
    pub fn palm(&self) -> HandBox {
        let half_m = Vec3::new(self.palm_width_m, self.palm_breadth_m, self.palm_length_m) * 0.5;
        HandBox { centre_m: Vec3::new(0.0, 0.0, -self.finger_length_m - half_m.z), half_m }
    }

    /// The whole open hand: the fingers, then the palm.
    #[must_use]
    pub fn open_hand(&self) -> [HandBox; 3] {
        let [left, right] = self.fingers(self.opening_m_max);
        [left, right, self.palm()]
    }

    /// The point midway between the roots of the fingers, where VGN has a grasp's origin, in the workspace.
    #[must_use]
    pub fn finger_roots_m(&self, workspace_from_grasp: &Pose) -> Vec3 {
        workspace_from_grasp.transform_point(Vec3::new(0.0, 0.0, -self.finger_length_m))
    }
}

impl HandBox {
    /// The box lengthened backwards by `distance_m` along −z: everything it passes on a straight approach of that length.
    #[must_use]
    pub fn swept_back(&self, distance_m: f32) -> Self {
        let shift = Vec3::new(0.0, 0.0, 0.5 * distance_m);
        Self { centre_m: self.centre_m - shift, half_m: self.half_m + shift }
    }

    /// The box grown by `margin_m` on every side.
    #[must_use]
    pub fn grown(&self, margin_m: f32) -> Self {
        Self { half_m: self.half_m + Vec3::splat(margin_m), ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAPER: &str = Gripper::BUILT_IN[0].1;

    #[test]
    fn the_shipped_gripper_is_the_designs() {
        let gripper = Gripper::from_toml(PAPER).unwrap();
        let [left, right, palm] = gripper.open_hand();
        let inner_gap = (right.centre_m.y - right.half_m.y) - (left.centre_m.y + left.half_m.y);
        assert!((inner_gap - 0.08).abs() < 1e-6);
        assert!((left.centre_m.z + left.half_m.z).abs() < 1e-6, "finger tips end at z = 0");
        assert!((palm.centre_m.z + palm.half_m.z + 0.05).abs() < 1e-6, "the palm begins behind the fingers");
    }

    #[test]
    fn built_in_hands_are_sound_and_go_by_their_names() {
        for (name, _) in Gripper::BUILT_IN {
            let found = Gripper::named(name, |file| panic!("{name} needs no file, asked for {file}"));
            assert_eq!(found.unwrap().name, name);
        }
        let unknown = Gripper::named("three_fingers", |_| panic!("not a path")).unwrap_err();
        assert!(Gripper::BUILT_IN.iter().all(|(name, _)| unknown.contains(name)), "{unknown}");
    }

    #[test]
    fn the_roots_are_a_fingers_length_behind_the_tips() {
        let gripper = Gripper::from_toml(PAPER).unwrap();
        let down = Pose::from_parts(Vec3::new(0.1, 0.1, 0.1), crate::axis_angle(Vec3::X, core::f32::consts::PI));
        assert!((gripper.finger_roots_m(&down) - Vec3::new(0.1, 0.1, 0.15)).length() < 1e-6);
    }

    #[test]
    fn every_value_out_of_range_is_named() {
        let bad =
            PAPER.replace("opening_m_max = 0.08", "opening_m_max = -1.0").replace("friction = 1.0", "friction = nan");
        let message = Gripper::from_toml(&bad).unwrap_err().to_string();
        assert!(message.contains("gripper.opening_m_max must be between 0.005 and 0.5, got -1"), "{message}");
        assert!(message.contains("gripper.friction"), "{message}");
    }

    #[test]
    fn a_swept_box_covers_both_ends() {
        let finger = Gripper::from_toml(PAPER).unwrap().open_hand()[0];
        let swept = finger.swept_back(0.05);
        let ends = |b: &HandBox| (b.centre_m.z - b.half_m.z, b.centre_m.z + b.half_m.z);
        assert!((ends(&swept).1 - ends(&finger).1).abs() < 1e-6);
        assert!((ends(&swept).0 - (ends(&finger).0 - 0.05)).abs() < 1e-6);
    }
}
