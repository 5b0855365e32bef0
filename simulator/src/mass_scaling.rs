//! Light objects in a strong gripper.
//!
//! A contact is a spring whose frequency is given, so its stiffness is that of the lighter body: a finger that presses
//! with F sinks into a body of mass m by F / (m ω²). With 30 N and 480 Hz that is 1.6 mm for 2 g: the jaws meet inside
//! of a plate and throw it out. The remedy is that of quasi-static simulations with explicit steps, mass scaling: a
//! body that is too light for the gripper gets the inertia that it takes for [`Physics::finger_depth_m_max`], while
//! all forces on it (weight, and those of a gripper that is shaken) stay those of its own mass. What a grip bears by
//! statics is then the same; only the accelerations of the body differ, and what the fingers' force could give it is
//! far above any that it needs.
//!
//! Under the edge of a pad a thin body gives way by turning, too: a force that passes its centre of mass at a distance
//! r meets a mass of m / (1 + r² / k²), where k is its radius of gyration. So narrow things, such as knives, get more:
//! otherwise the jaws cut through the edges of blades.

use core::f32::consts::TAU;

use schema::{Gripper, Physics};

/// No object gets more than so many times what it takes in its middle.
const TIMES_MAX: f32 = 20.0;

/// The least inertia of an object that a gripper grips.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LeastInertia {
    /// In the middle of a pad, in kilograms.
    mass_kg: f32,
    /// From there to the pad's edge, in metres.
    lever_m: f32,
}

impl LeastInertia {
    pub(crate) const NONE: Self = Self { mass_kg: 0.0, lever_m: 0.0 };

    pub(crate) fn of(physics: &Physics, gripper: &Gripper) -> Self {
        if physics.finger_depth_m_max == 0.0 {
            return Self::NONE;
        }
        let frequency = TAU * physics.contact_frequency_hz;
        let mass_kg = gripper.finger_force_n / (frequency * frequency * physics.finger_depth_m_max);
        Self { mass_kg, lever_m: 0.5 * gripper.finger_width_m }
    }

    /// That of an object with this least radius of gyration, in kilograms.
    pub(crate) fn with_gyration_kg(&self, gyration_m: f32) -> f32 {
        let levers = self.lever_m / gyration_m.max(f32::MIN_POSITIVE);
        self.mass_kg * (1.0 + levers * levers).min(TIMES_MAX)
    }
}
