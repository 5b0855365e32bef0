//! What a gripper that has closed is put to: pulls and shakes.

use core::f32::consts::TAU;

use schema::Vec3;

use crate::stepper::Turning;

/// A pull comes up to its strength in this time, so that it is no blow.
const RISE_S: f32 = 0.025;

/// What happens to a gripper that has closed. Directions are in the frame of the grasp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Load {
    /// What is free is accelerated, steadily.
    Pull {
        /// By so much, in m/s².
        acceleration_m_s2: Vec3,
        /// For so long after it came up, in seconds.
        time_s: f32,
    },
    /// The gripper goes to and fro along a direction, then it turns to and fro about a point.
    Shake(Shake),
}

/// A gripper that is shaken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shake {
    /// From one end of its way to the other, in metres.
    pub way_m: Vec3,
    /// From one end of its turn to the other, in radians, about this axis …
    pub turn_rad: Vec3,
    /// … through this point.
    pub pivot_m: Vec3,
    /// There and back, a second.
    pub rate_hz: f32,
    /// How often of each.
    pub cycles: f32,
}

impl Load {
    /// How long it lasts, in seconds.
    #[must_use]
    pub fn time_s(&self) -> f32 {
        match self {
            Self::Pull { time_s, .. } => RISE_S + time_s,
            Self::Shake(shake) => 2.0 * shake.cycles / shake.rate_hz,
        }
    }

    /// Whether it stays as it is from then on.
    pub(crate) fn is_steady(&self, time_s: f32) -> bool {
        matches!(self, Self::Pull { .. }) && time_s >= RISE_S
    }

    /// What is free gains so much in the gripper's frame, which turns so.
    pub(crate) fn at(&self, time_s: f32) -> (Vec3, Option<Turning>) {
        match self {
            Self::Pull { acceleration_m_s2, .. } => {
                let share = (time_s / RISE_S).min(1.0);
                (*acceleration_m_s2 * (share * share * (3.0 - 2.0 * share)), None)
            }
            Self::Shake(shake) => shake.at(time_s),
        }
    }
}

impl Shake {
    /// The way is half its length times 1 − cos: it starts and ends at rest.
    fn at(&self, time_s: f32) -> (Vec3, Option<Turning>) {
        let half_s = self.cycles / self.rate_hz;
        let (rate, swings_s) = (TAU * self.rate_hz, if time_s < half_s { time_s } else { time_s - half_s });
        let (sin, cos) = libm::sincosf(rate * swings_s);
        if time_s < half_s {
            return (self.way_m * (-0.5 * rate * rate * cos), None);
        }
        let turning = Turning {
            pivot_m: self.pivot_m,
            rate_rad_s: self.turn_rad * (0.5 * rate * sin),
            change_rad_s2: self.turn_rad * (0.5 * rate * rate * cos),
        };
        (Vec3::ZERO, Some(turning))
    }
}
