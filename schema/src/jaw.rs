//! Jaws that close each in its own way: fixed, along a line, along an arc, or turning about an axis.
//!
//! How far a jaw has closed is said by the way of its tip, in metres, whatever it does: a drive that presses at the tip
//! with a force does the same work along any of these ways.

use serde::{Deserialize, Serialize};
use settings::{Reader, settings};

use crate::{GripperBox, Pose, Quat, Vec3, axis_angle};

settings! {
    /// A jaw: its boxes, and how it goes from the widest opening until it is closed. One that neither slides nor turns
    /// is fixed.
    #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Jaw {
        /// Its way, if it slides.
        pub slide_m: [f32; 3] where -0.5..=0.5; or [0.0; 3],
        /// Its turn, if it turns: the axis times the angle.
        pub turn_rad: [f32; 3] where -3.0..=3.0; or [0.0; 3],
        /// A point of the axis about which it turns.
        pub pivot_m: [f32; 3] where -1.0..=1.0; or [0.0; 3],
        /// Whether its tip goes along that turn's arc while the jaw stays parallel, as on a linkage.
        pub keeps_parallel: bool; or false,
        /// What it is made of; by default the finger of the file, at the widest opening.
        pub boxes: Vec<JawBox>; or Vec::new(),
        /// The share of its way at which the boxes are as they are given: 0 at the widest opening, 1 closed.
        pub boxes_at: f32 where 0.0..=1.0; or 0.0,
    }
}

settings! {
    /// A box along the axes of the grasp frame.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct JawBox {
        /// Its centre.
        pub centre_m: [f32; 3] where -1.0..=1.0,
        /// Its sides.
        pub size_m: [f32; 3] where 0.0005..=0.5,
    }
}

/// The way of a jaw, by how far its tip has come, in metres.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct JawPath {
    /// Of the whole way of the tip.
    pub way_m: f32,
    /// The tip at the widest opening, in the grasp frame.
    tip_m: Vec3,
    /// Where it slides, whereto; else 0.
    along: Vec3,
    /// Where it turns, the axis; else 0.
    axis: Vec3,
    /// A point of that axis.
    pub pivot_m: Vec3,
    /// The tip's distance from the axis.
    lever_m: f32,
    keeps_parallel: bool,
    /// How far the tip has come where the boxes of a jaw that turns are as they are given.
    given_m: f32,
}

/// Shortest distance of a tip from the axis about which it turns.
const LEVER_M_MIN: f32 = 0.002;

impl Jaw {
    /// The boxes of a jaw that turns as they are given, of another as they are at the widest opening.
    pub(crate) fn given(&self, path: &JawPath) -> impl Iterator<Item = GripperBox> {
        let back_m = if path.given_m > 0.0 { Vec3::ZERO } else { path.pose(self.boxes_at * path.way_m).translation };
        self.boxes.iter().map(move |JawBox { centre_m, size_m }| GripperBox {
            centre_m: Vec3::from_array(*centre_m) - back_m,
            half_m: Vec3::from_array(*size_m) * 0.5,
        })
    }

    pub(crate) fn is_sound(&self, tip_m: Vec3, reader: &mut Reader<'_>) {
        let [slides, turns] = [self.slide_m, self.turn_rad].map(|way| way != [0.0; 3]);
        reader.must("turn_rad", !(slides && turns), || "must not stand beside slide_m");
        let lever_m = self.path(tip_m).lever_m;
        reader.must("pivot_m", !turns || lever_m >= LEVER_M_MIN, || {
            format!("must be on an axis {LEVER_M_MIN} m or more from the tip, got {lever_m}")
        });
    }

    /// Its way from where its tip is at the widest opening.
    pub(crate) fn path(&self, tip_m: Vec3) -> JawPath {
        let [slide_m, turn, pivot_m] = [self.slide_m, self.turn_rad, self.pivot_m].map(Vec3::from_array);
        let (axis, keeps_parallel) = (turn.normalize_or_zero(), self.keeps_parallel);
        let (slide_way_m, lever_m) = (slide_m.length(), axis.cross(tip_m - pivot_m).length());
        let way_m = slide_way_m + turn.length() * lever_m;
        let along = if slide_way_m > 0.0 { slide_m / slide_way_m } else { Vec3::ZERO };
        let given_m = if keeps_parallel || axis == Vec3::ZERO { 0.0 } else { self.boxes_at * way_m };
        JawPath { way_m, tip_m, along, axis, pivot_m, lever_m, keeps_parallel, given_m }
    }
}

impl JawPath {
    /// Whether it goes along y towards the other jaw, or is fixed: the simplest ways, and the fastest.
    #[must_use]
    pub fn is_along_y(&self) -> bool {
        self.axis == Vec3::ZERO && self.along.with_y(0.0) == Vec3::ZERO && self.along.y * self.tip_m.y <= 0.0
    }

    fn turn(&self, closed_m: f32) -> Quat {
        axis_angle(self.axis, closed_m / self.lever_m)
    }

    /// From the gripper at its widest opening to one whose tip has come so far.
    #[must_use]
    pub fn pose(&self, closed_m: f32) -> Pose {
        if self.axis == Vec3::ZERO {
            return Pose::from_translation(self.along * closed_m);
        }
        let turn = self.turn(closed_m);
        let of = |point_m: Vec3| self.pivot_m + turn * (point_m - self.pivot_m);
        if self.keeps_parallel {
            return Pose::from_translation(of(self.tip_m) - self.tip_m);
        }
        Pose::from_parts(of(Vec3::ZERO), turn)
    }

    /// The same from the gripper of which the jaw's boxes are given.
    #[must_use]
    pub fn pose_of_boxes(&self, closed_m: f32) -> Pose {
        let pose = self.pose(closed_m);
        if self.given_m == 0.0 { pose } else { pose * self.pose(self.given_m).inverse() }
    }

    /// How far its tip has then moved.
    pub(crate) fn tip_moved_m(&self, closed_m: f32) -> Vec3 {
        self.pose(closed_m).transform_point(self.tip_m) - self.tip_m
    }

    /// How its points move when the tip has come so far, for each metre a second of the tip: all of them by the first,
    /// and those beside [`Self::pivot_m`] by the second × their place from there.
    #[must_use]
    pub fn motion(&self, closed_m: f32) -> [Vec3; 2] {
        if self.axis == Vec3::ZERO {
            return [self.along, Vec3::ZERO];
        }
        let turn = self.axis / self.lever_m;
        if self.keeps_parallel {
            return [turn.cross(self.turn(closed_m) * (self.tip_m - self.pivot_m)), Vec3::ZERO];
        }
        [Vec3::ZERO, turn]
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::FRAC_PI_6;

    use super::*;
    use crate::{Gripper, Purpose, Stream};

    const ARM_M: f32 = 0.1077;

    /// A parallel jaw of 80 mm with other jaws.
    fn gripper(jaws: &str) -> Result<Gripper, settings::Error> {
        Gripper::from_toml(&format!("{}\n{jaws}", Gripper::BUILT_IN[0].1))
    }

    fn turning() -> Gripper {
        let jaws = "jaws = [{}, { turn_rad = [0.761, 0, 0], pivot_m = [0, 0, -0.1], boxes_at = 0.5, \
            boxes = [{ centre_m = [0, 0.005, -0.02], size_m = [0.02, 0.01, 0.0554] }] }]\njoint = { open = 0.761, closed = 0 }";
        gripper(jaws).unwrap()
    }

    #[test]
    fn fingers_that_slide_alike_need_no_jaws_and_store_none() {
        let plain = gripper("").unwrap();
        assert!(!settings::Value::try_from(&plain).unwrap().as_table().unwrap().contains_key("jaws"));
        let alike = gripper("jaws = [{ slide_m = [0, 0.04, 0] }, { slide_m = [0, -0.04, 0] }]").unwrap();
        for closed_m in [[0.0, 0.0], [0.01, 0.025], [0.04, 0.04]] {
            let (one, other) = (plain.parts(closed_m), alike.parts(closed_m));
            assert_eq!(one.len(), other.len());
            for ((side, part), (other_side, other)) in one.iter().zip(&other) {
                assert!(side == other_side && (part.centre_m - other.centre_m).length() < 1e-6, "{part:?} {other:?}");
            }
            assert!((plain.gap_m(closed_m) - alike.gap_m(closed_m)).abs() < 1e-6);
        }
        assert!(alike.paths().iter().all(JawPath::is_along_y) && alike.aside_m(0.02) == 0.0);
        assert!((alike.boxes(0.03)[1].centre_m - plain.boxes(0.03)[1].centre_m).length() < 1e-6);
        assert_eq!(plain.joint_position(0.02), None);
        let stored = settings::Value::try_from(&alike).unwrap();
        assert_eq!(stored.try_into::<Gripper>().unwrap(), alike);
    }

    /// A lever of length R at an angle φ has its tip at R sin φ.
    #[test]
    fn a_jaw_that_turns_goes_by_its_lever() {
        let gripper = turning();
        let [fixed, turns] = gripper.paths();
        assert!(fixed.is_along_y() && fixed.way_m == 0.0 && !turns.is_along_y());
        assert_eq!(gripper.fixed_side(), Some(0));
        // The left finger's face is 40 mm beside the middle, and 3 mm beside a thing of 20 mm.
        assert!((gripper.aside_m(0.02) - (0.04 - 0.01 - 0.003)).abs() < 1e-6 && gripper.aside_m(0.08) == 0.0);
        assert!((turns.way_m - 0.761 * ARM_M).abs() < 1e-5);
        for share in [0.0, 0.3, 0.5, 1.0] {
            let angle = 0.3805 * (1.0 - 2.0 * share);
            let gap_m = 0.04 + ARM_M * libm::sinf(angle);
            let got_m = gripper.gap_m([0.0, share * turns.way_m]);
            assert!((got_m - gap_m).abs() < 1e-4, "{got_m} for {gap_m}");
            assert!((gripper.joint_position(gap_m).unwrap() - 0.761 * (1.0 - share)).abs() < 2e-3, "{share}");
            // How it moves is the derivative of where it is.
            let (closed_m, step_m) = (share * turns.way_m, 1e-3);
            let point_m = Vec3::new(0.01, 0.03, -0.02);
            let [before, after] = [closed_m - step_m, closed_m + step_m].map(|at_m| turns.pose(at_m) * point_m);
            let [along, turn] = turns.motion(closed_m);
            let expected = along + turn.cross(turns.pose(closed_m) * point_m - turns.pivot_m);
            assert!(((after - before) / (2.0 * step_m) - expected).length() < 1e-3);
        }
        assert!(gripper.jaw_at(1, 0.5 * turns.way_m)[0].half_m.y - 0.005 < 1e-4, "there it is as it is given");
    }

    #[test]
    fn tips_on_arcs_stay_parallel_and_go_forward() {
        let arc =
            |turn: f32| format!("{{ turn_rad = [{turn}, 0, 0], pivot_m = [0, 0, -0.0693], keeps_parallel = true }}");
        let gripper = gripper(&format!("jaws = [{}, {}]", arc(-FRAC_PI_6), arc(FRAC_PI_6))).unwrap();
        let [left, right] = gripper.paths();
        for (path, side) in [(left, -1.0), (right, 1.0)] {
            let pose = path.pose(path.way_m);
            assert_eq!(pose.rotation, crate::Quat::IDENTITY);
            let forward_m = 0.08 * (1.0 - libm::cosf(FRAC_PI_6));
            assert!(
                (pose.translation - Vec3::new(0.0, -side * 0.04, forward_m)).length() < 2e-4,
                "{}",
                pose.translation
            );
            let [along, turn] = path.motion(0.0);
            assert!((along - Vec3::new(0.0, -side * 0.866, 0.5)).length() < 2e-3 && turn == Vec3::ZERO, "{along}");
        }
    }

    #[test]
    fn boxes_cover_a_turned_box_and_little_else() {
        let whole = GripperBox { centre_m: Vec3::new(0.01, 0.02, -0.03), half_m: Vec3::new(0.01, 0.004, 0.03) };
        let mut stream = Stream::new(3, 0, Purpose::Candidates, 0);
        for _ in 0..50 {
            let pose = Pose::from_parts(stream.point(Vec3::splat(-0.1), Vec3::splat(0.1)), stream.rotation());
            let parts = whole.covered(&pose);
            for _ in 0..50 {
                let at = whole.centre_m + whole.half_m * stream.point(Vec3::splat(-1.0), Vec3::splat(1.0));
                let is_in = |b: &GripperBox| b.is_near(pose * at, 1e-6);
                assert!(parts.iter().any(is_in), "{at} at {pose:?}");
            }
            assert!(parts.iter().all(|part| part.half_m.length() < 2.5 * Vec3::new(0.01, 0.004, 0.002).length()));
        }
    }

    #[test]
    fn what_cannot_be_jaws_is_named() {
        for (jaws, told) in [
            ("[{ slide_m = [0, 0.08, 0] }]", "gripper.jaws must be two, got 1"),
            ("[{}, { slide_m = [0, -0.04, 0] }]", "gripper.jaws must close by opening_m_max along y, 0.08, got 0.04"),
            ("[{}, { slide_m = [0, 0.08, 0] }]", "along y, 0.08, got -0.08"),
            ("[{}, {}]", "along y, 0.08, got 0"),
            (
                "[{}, { slide_m = [0, -0.08, 0], turn_rad = [1, 0, 0] }]",
                "gripper.jaws[1].turn_rad must not stand beside slide_m",
            ),
            (
                "[{}, { turn_rad = [1, 0, 0], pivot_m = [0, 0.04, 0.001] }]",
                "gripper.jaws[1].pivot_m must be on an axis",
            ),
        ] {
            let message = gripper(&format!("jaws = {jaws}")).unwrap_err().to_string();
            assert!(message.contains(told), "{told} is not in {message}");
        }
    }
}
