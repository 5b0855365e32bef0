//! The two fingers in the solver: each has one direction of freedom, the world's y, and a drive.

use schema::{Gripper, GripperBox, Vec3};
use wide::f32x4;

use super::contact::lanes;
use crate::gripper::{GEAR_DAMPING_N_S_M, GEAR_STIFFNESS_N_M};

/// How far beyond its widest opening a finger gives way.
const STOP_M: f32 = 0.001;

/// A gripper's palm and fingers.
#[derive(Clone, Default)]
pub(crate) struct Jaws {
    /// As when the gripper is open and at the origin.
    boxes: [GripperBox; 3],
    /// How far each finger can close.
    closed_m_max: [f32; 2],
    closing_speed_m_s: f32,
    /// No finger closes faster than this.
    fastest_m_s: f32,
    force_n: f32,
    palm_m: Vec3,
    palm_velocity_m_s: Vec3,
    pub(super) finger_inverse_mass: f32,
    pub(crate) friction: f32,
    fingers: [Finger; 2],
    /// How far each finger is to close; while closing, as far as it can.
    targets_m: Option<[f32; 2]>,
}

/// A finger along y.
#[derive(Clone, Copy, Default)]
struct Finger {
    /// Direction of closing.
    inward: f32,
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

impl Jaws {
    /// A gripper at the origin, its fingers closed by `closed_m` each, and closing if that is above 0; they end at
    /// `closed_m_max`.
    pub(crate) fn new(gripper: &Gripper, closed_m: f32, closed_m_max: [f32; 2]) -> Self {
        let [left, right] = gripper.fingers(gripper.opening_m_max);
        let speed_m_s = if closed_m > 0.0 { gripper.closing_speed_m_s } else { 0.0 };
        let finger = |(opened, inward): (GripperBox, f32)| Finger {
            inward,
            y_m: opened.centre_m.y + inward * closed_m,
            velocity_m_s: inward * speed_m_s,
            travel_m: closed_m,
            ..Finger::default()
        };
        Self {
            boxes: [left, right, gripper.palm()],
            closed_m_max,
            closing_speed_m_s: gripper.closing_speed_m_s,
            fastest_m_s: f32::INFINITY,
            force_n: gripper.finger_force_n,
            finger_inverse_mass: 1.0 / gripper.finger_mass_kg,
            friction: gripper.friction,
            fingers: [(left, 1.0), (right, -1.0)].map(finger),
            ..Self::default()
        }
    }

    /// No gripper: one without size, far from everything.
    pub(super) fn absent() -> Self {
        let point = GripperBox { centre_m: Vec3::splat(1e6), half_m: Vec3::ZERO };
        let finger = Finger { inward: 1.0, y_m: 1e6, ..Finger::default() };
        Self { boxes: [point; 3], fastest_m_s: f32::INFINITY, fingers: [finger; 2], ..Self::default() }
    }

    pub(super) fn closed_m(&self) -> [f32; 2] {
        core::array::from_fn(|i| {
            (self.fingers[i].y_m - self.palm_m.y - self.boxes[i].centre_m.y) * self.fingers[i].inward
        })
    }

    /// By how much each box has moved from where it is when the gripper is open and at the origin.
    pub(super) fn moved_m(&self) -> [Vec3; 3] {
        let [left, right] = core::array::from_fn(|i| {
            Vec3::new(self.palm_m.x, self.fingers[i].y_m - self.boxes[i].centre_m.y, self.palm_m.z)
        });
        [left, right, self.palm_m]
    }

    /// Centre and half extents of a box.
    pub(super) fn box_at(&self, which: usize) -> (Vec3, Vec3) {
        (self.boxes[which].centre_m + self.moved_m()[which], self.boxes[which].half_m)
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
            self.fingers[obstacle - 1].velocity_m_s -= impulse.as_array()[1] * self.finger_inverse_mass;
        }
    }

    /// Whether from now on no finger closes faster than the gripper closes, also where it presses: what slips out from
    /// between fingers that close may be thinner than their way in a step.
    pub(crate) fn keep_pace(&mut self, keeps: bool) {
        self.fastest_m_s = if keeps { self.closing_speed_m_s } else { f32::INFINITY };
    }

    pub(super) fn press(&mut self, asymmetry_at_contact_m: f32) {
        let [left, right] = self.closed_m();
        let pressing_m = 0.5 * (left + right) + self.force_n / GEAR_STIFFNESS_N_M;
        self.targets_m = Some([0.5, -0.5].map(|side| pressing_m + side * asymmetry_at_contact_m));
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
            finger.velocity_m_s += finger.impulse * self.finger_inverse_mass * finger.inward;
        }
    }

    /// A substep begins, `time_s` after the step, when the fingers had closed by `closed_m`.
    pub(super) fn begin_substep(&mut self, closed_m: [f32; 2], time_s: f32) {
        for (finger, closed_m) in self.fingers.iter_mut().zip(closed_m) {
            let way_m = finger.way_m - self.palm_velocity_m_s.y * time_s;
            finger.travel_m = closed_m + way_m * finger.inward;
        }
    }

    /// Solves the drives.
    pub(super) fn solve(&mut self, substep_s: f32) {
        let inverse_mass = self.finger_inverse_mass;
        for (i, finger) in self.fingers.iter_mut().enumerate() {
            let speed_m_s = (finger.velocity_m_s - self.palm_velocity_m_s.y) * finger.inward;
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
            let closing_m_s = (finger.velocity_m_s - self.palm_velocity_m_s.y) * finger.inward;
            let slowest = (-STOP_M - finger.travel_m).min(0.0) / substep_s;
            if closing_m_s < slowest {
                finger.velocity_m_s = self.palm_velocity_m_s.y + slowest * finger.inward;
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
