//! The two jaws in the solver: each has one freedom, and a drive. A finger that slides along the world's y, or is
//! fixed, is the simplest and fastest; any other jaw is *led*: it answers to an impulse at a point by how its way moves
//! that point.

use schema::{Gripper, GripperBox, JawPath, Pose, Vec3};
use wide::f32x4;

use super::contact::{Answer, lanes};
use super::patch::Frame;
use crate::gripper::{GEAR_DAMPING_N_S_M, GEAR_STIFFNESS_N_M};

/// How far beyond its widest opening a finger gives way.
const STOP_M: f32 = 0.001;

/// A gripper's palm and fingers.
#[derive(Clone, Default)]
pub(crate) struct Jaws {
    /// Of each finger and the palm, as when the gripper is open and at the origin; of a led jaw as they are given.
    pub(super) boxes: [Vec<GripperBox>; 3],
    /// How the left and the right jaw answer in this step, if they are led; the palm is not.
    pub(super) led: [Option<Led>; 3],
    /// How far each finger can close.
    closed_m_max: [f32; 2],
    closing_speed_m_s: f32,
    /// No finger closes faster than this.
    fastest_m_s: f32,
    force_n: f32,
    /// Fingers are springs, which sink in by so much where they press on a face with their force; 0 if they are hard.
    pub(crate) depth_m: f32,
    palm_m: Vec3,
    palm_velocity_m_s: Vec3,
    pub(crate) friction: f32,
    fingers: [Finger; 2],
    paths: [JawPath; 2],
    /// How far each finger is to close; while closing, as far as it can.
    targets_m: Option<[f32; 2]>,
}

/// A jaw on its way: a finger along y, or one that is led, whose place and speed are those of its tip on its way.
#[derive(Clone, Copy, Default)]
struct Finger {
    /// Direction of closing.
    inward: f32,
    /// 0 of one that is fixed.
    inverse_mass: f32,
    /// Where it is when the gripper is open.
    open_m: f32,
    /// How far it moves with a palm that moves along y: by all of it, or, if it is led, by nothing.
    rides: f32,
    y_m: f32,
    /// Along y.
    velocity_m_s: f32,
    /// Along y since the step began.
    way_m: f32,
    /// The drive's impulse in the last substep, inwards.
    impulse: f32,
    /// How far it had closed when the substep began.
    travel_m: f32,
}

/// A jaw that is led, as it is in a step.
#[derive(Clone, Copy)]
pub(super) struct Led {
    pub(super) frame: Frame,
    /// As of a body that turns about one axis only, by the root of its inverse mass.
    pub(super) answer: Answer,
    /// How a turn by one moves all of it.
    pub(super) along: Vec3,
}

impl Jaws {
    /// A gripper at the origin, its fingers closed by `closed_m` each, and closing if that is above 0; they end at
    /// `closed_m_max`.
    pub(crate) fn new(gripper: &Gripper, closed_m: f32, closed_m_max: [f32; 2]) -> Self {
        let [left, right] = gripper.jaw_boxes();
        let speed_m_s = if closed_m > 0.0 { gripper.closing_speed_m_s } else { 0.0 };
        let finger = |path: &JawPath, boxes: &[GripperBox], inward: f32| {
            let is_along_y = path.is_along_y();
            let (inward, rides) = if is_along_y { (inward, 1.0) } else { (1.0, 0.0) };
            let open_m = if is_along_y { boxes[0].centre_m.y } else { 0.0 };
            Finger {
                inward,
                inverse_mass: if path.way_m > 0.0 { 1.0 / gripper.finger_mass_kg } else { 0.0 },
                open_m,
                rides,
                y_m: open_m + inward * closed_m,
                velocity_m_s: inward * speed_m_s,
                travel_m: closed_m,
                ..Finger::default()
            }
        };
        let paths = gripper.paths();
        let mut jaws = Self {
            fingers: [finger(&paths[0], &left, 1.0), finger(&paths[1], &right, -1.0)],
            paths,
            boxes: [left, right, vec![gripper.palm()]],
            closed_m_max,
            closing_speed_m_s: gripper.closing_speed_m_s,
            fastest_m_s: f32::INFINITY,
            force_n: gripper.finger_force_n,
            friction: gripper.friction,
            ..Self::default()
        };
        jaws.lead();
        jaws
    }

    /// No gripper.
    pub(super) fn absent() -> Self {
        let finger = Finger { inward: 1.0, rides: 1.0, ..Finger::default() };
        Self { fastest_m_s: f32::INFINITY, fingers: [finger; 2], ..Self::default() }
    }

    pub(super) fn closed_m(&self) -> [f32; 2] {
        self.fingers
            .each_ref()
            .map(|finger| (finger.y_m - self.palm_m.y * finger.rides - finger.open_m) * finger.inward)
    }

    /// Where the jaws and the palm are, from where they are when the gripper is open and at the origin.
    pub(super) fn poses(&self) -> [Pose; 3] {
        let palm = Pose::from_translation(self.palm_m);
        let [left, right] = [0, 1].map(|which| match &self.led[which] {
            Some(_) => palm * self.paths[which].pose(self.fingers[which].y_m),
            None => Pose::from_translation(self.moved_m(which)),
        });
        [left, right, palm]
    }

    /// Centre and half extents of a box; of one of a led jaw in the jaw's frame.
    pub(super) fn box_at(&self, which: usize, number: usize) -> (Vec3, Vec3) {
        let GripperBox { centre_m, half_m } = self.boxes[which][number];
        (centre_m + if self.led[which].is_some() { Vec3::ZERO } else { self.moved_m(which) }, half_m)
    }

    /// How far a finger along y, or the palm, has moved.
    fn moved_m(&self, which: usize) -> Vec3 {
        self.fingers.get(which).map_or(self.palm_m, |finger| self.palm_m.with_y(finger.y_m - finger.open_m))
    }

    /// How a point of a finger yields, as a contact has it, in substeps of this rate: a face has four. The palm is
    /// hard.
    pub(super) fn yields(&self, which: usize, rate_hz: f32) -> f32 {
        if which < 2 { 4.0 * self.depth_m / self.force_n * rate_hz * rate_hz } else { 0.0 }
    }

    /// Of a finger, along y; 0 of one that is fixed, and of the palm.
    pub(super) fn inverse_mass(&self, which: usize) -> f32 {
        self.fingers.get(which).map_or(0.0, |finger| finger.inverse_mass)
    }

    /// Brings how led jaws answer up to date.
    pub(super) fn lead(&mut self) {
        for (which, finger) in self.fingers.iter().enumerate().filter(|(_, finger)| finger.rides == 0.0) {
            let (path, root) = (&self.paths[which], finger.inverse_mass.sqrt());
            let ([along, turn], pose) = (path.motion(finger.y_m), path.pose_of_boxes(finger.y_m));
            let scaled_axes = [turn * root, Vec3::ZERO, Vec3::ZERO];
            self.led[which] = Some(Led {
                frame: Frame { axes: super::axes_of(pose.rotation), origin_m: pose.translation + self.palm_m },
                answer: Answer { centre_m: path.pivot_m + self.palm_m, scaled_axes, ..Answer::default() },
                along: along * root,
            });
        }
    }

    /// How the palm moves, and a led jaw by the root of its mass: speeds, and ways since the step began, `time_s` ago.
    pub(super) fn led_motion(&self, which: usize, time_s: f32) -> [[f32x4; 2]; 2] {
        let (finger, palm) = (&self.fingers[which], lanes(self.palm_velocity_m_s));
        let root = 1.0 / finger.inverse_mass.sqrt();
        let [speed, way] = [finger.velocity_m_s, finger.way_m].map(|m| lanes(Vec3::X * (m * root)));
        [[palm, speed], [palm * f32x4::splat(time_s), way]]
    }

    /// Turns a led jaw.
    pub(super) fn turn(&mut self, which: usize, angular: f32x4) {
        let finger = &mut self.fingers[which];
        finger.velocity_m_s += angular.as_array()[0] * finger.inverse_mass.sqrt();
    }

    /// Velocity and way since the step began, `time_s` ago, of an obstacle: the table, the fingers, the palm.
    #[inline(always)]
    pub(super) fn motion(&self, obstacle: usize, time_s: f32) -> [f32x4; 2] {
        let palm = lanes(self.palm_velocity_m_s);
        let finger = |finger: &Finger| {
            let along_y = |y: f32, [x, _, z, _]: [f32; 4]| f32x4::from([x, y, z, 0.0]);
            let way = palm * f32x4::splat(time_s);
            [along_y(finger.velocity_m_s, palm.to_array()), along_y(finger.way_m, way.to_array())]
        };
        match obstacle {
            1 => finger(&self.fingers[0]),
            2 => finger(&self.fingers[1]),
            3 => [palm, palm * f32x4::splat(time_s)],
            _ => [f32x4::ZERO; 2],
        }
    }

    /// Takes the other half of an impulse on a body.
    #[inline(always)]
    pub(super) fn push(&mut self, obstacle: usize, impulse: f32x4) {
        if let 1 | 2 = obstacle {
            let finger = &mut self.fingers[obstacle - 1];
            finger.velocity_m_s -= impulse.as_array()[1] * finger.inverse_mass;
        }
    }

    /// Whether from now on no finger closes faster than the gripper closes, also where it presses: what slips out from
    /// between fingers that close may be thinner than their way in a step.
    pub(crate) fn keep_pace(&mut self, keeps: bool) {
        self.fastest_m_s = if keeps { self.closing_speed_m_s } else { f32::INFINITY };
    }

    /// Two that move are tied to each other; beside one that is fixed the other has its force alone.
    pub(super) fn press(&mut self, asymmetry_at_contact_m: f32) {
        let ([left, right], preload_m) = (self.closed_m(), self.force_n / GEAR_STIFFNESS_N_M);
        let pressing_m = 0.5 * (left + right) + preload_m;
        let are_tied = self.fingers.iter().all(|finger| finger.inverse_mass > 0.0);
        self.targets_m = Some(if are_tied {
            [0.5, -0.5].map(|side| pressing_m + side * asymmetry_at_contact_m)
        } else {
            [left, right].map(|closed_m| closed_m + preload_m)
        });
    }

    /// Says where the palm is to be at the end of the next step.
    pub(super) fn move_to(&mut self, position_m: Vec3, step_s: f32) {
        self.palm_velocity_m_s = (position_m - self.palm_m) / step_s;
    }

    pub(super) fn begin_step(&mut self) {
        for finger in &mut self.fingers {
            finger.way_m = 0.0;
        }
    }

    pub(super) fn warm_start(&mut self) {
        for finger in &mut self.fingers {
            finger.velocity_m_s += finger.impulse * finger.inverse_mass * finger.inward;
        }
    }

    /// A substep begins, `time_s` after the step, when the fingers had closed by `closed_m`.
    pub(super) fn begin_substep(&mut self, closed_m: [f32; 2], time_s: f32) {
        for (finger, closed_m) in self.fingers.iter_mut().zip(closed_m) {
            let way_m = finger.way_m - self.palm_velocity_m_s.y * finger.rides * time_s;
            finger.travel_m = closed_m + way_m * finger.inward;
        }
    }

    /// Solves the drives.
    pub(super) fn solve(&mut self, substep_s: f32) {
        for (i, finger) in self.fingers.iter_mut().enumerate() {
            let inverse_mass = finger.inverse_mass;
            let speed_m_s = (finger.velocity_m_s - self.palm_velocity_m_s.y * finger.rides) * finger.inward;
            let travel_m = finger.travel_m;
            let (wanted, limit_n) = match self.targets_m {
                None => (finger.impulse + (self.closing_speed_m_s - speed_m_s) / inverse_mass, self.force_n),
                Some(targets_m) => {
                    // A damped spring, implicit: as stiff as it is, whatever the length of a step.
                    let softness = 1.0 / (substep_s * (GEAR_DAMPING_N_S_M + substep_s * GEAR_STIFFNESS_N_M));
                    let pull = (travel_m - targets_m[i]) * substep_s * GEAR_STIFFNESS_N_M * softness;
                    let change = -(speed_m_s + pull + softness * finger.impulse) / (inverse_mass + softness);
                    (finger.impulse + change, 3.0 * self.force_n)
                }
            };
            let limit = limit_n * substep_s;
            let impulse = wanted.clamp(-limit, limit);
            let driven_m_s = speed_m_s + (impulse - finger.impulse) * inverse_mass;
            finger.impulse = impulse;
            let slowest = -travel_m.max(0.0) / substep_s;
            let fastest = ((self.closed_m_max[i] - travel_m).max(0.0) / substep_s).min(self.fastest_m_s);
            let change_m_s = driven_m_s.clamp(slowest, fastest) - speed_m_s;
            finger.velocity_m_s += change_m_s * finger.inward;
        }
    }

    /// Contacts have the last word on velocities, but no finger opens further than its stop: what is jammed between it
    /// and a wall would push it out of the gripper.
    pub(super) fn advance(&mut self, substep_s: f32) {
        for finger in &mut self.fingers {
            let palm_m_s = self.palm_velocity_m_s.y * finger.rides;
            let closing_m_s = (finger.velocity_m_s - palm_m_s) * finger.inward;
            let slowest = (-STOP_M - finger.travel_m).min(0.0) / substep_s;
            if closing_m_s < slowest {
                finger.velocity_m_s = palm_m_s + slowest * finger.inward;
            }
            finger.way_m += finger.velocity_m_s * substep_s;
        }
    }

    pub(super) fn end_step(&mut self, step_s: f32) {
        for finger in &mut self.fingers {
            finger.y_m += finger.way_m;
        }
        self.palm_m += self.palm_velocity_m_s * step_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// However hard contacts push, in whatever direction the gripper moves.
    #[test]
    fn no_finger_opens_further_than_its_stop() {
        let gripper = Gripper::from_toml(include_str!("../../../configs/grippers/parallel_jaw_80.toml")).unwrap();
        let (step_s, count) = (1.0 / 240.0, 4);
        for palm_m_s in [-0.3, 0.0, 0.3] {
            let mut jaws = Jaws::new(&gripper, 0.0, [0.04; 2]);
            for step in 1..=30 {
                jaws.move_to(Vec3::new(0.0, palm_m_s * step_s * step as f32, 0.0), step_s);
                let closed_m = jaws.closed_m();
                jaws.begin_step();
                for substep in 0..count {
                    let substep_s = step_s / count as f32;
                    jaws.begin_substep(closed_m, substep_s * substep as f32);
                    // Outwards: the left finger closes along +y.
                    jaws.push(1, f32x4::from([0.0, 0.2, 0.0, 0.0]));
                    jaws.push(2, f32x4::from([0.0, -0.2, 0.0, 0.0]));
                    jaws.advance(substep_s);
                }
                jaws.end_step(step_s);
            }
            for closed_m in jaws.closed_m() {
                assert!((-1.01e-3..-0.9e-3).contains(&closed_m), "{palm_m_s}: {closed_m}");
            }
        }
    }
}
