//! Light objects in a strong hand. So far only objects that float have it: in scenes it would change datasets' bytes.
//!
//! A contact is a spring whose frequency is given, so its stiffness is that of the lighter body: a finger that presses
//! with F sinks into a body of mass m by F / (m ω²). With 30 N and 480 Hz that is 1.6 mm for 2 g: the jaws meet inside
//! of a plate and throw it out. The remedy is that of quasi-static simulations with explicit steps, mass scaling: a
//! body that is too light for the hand gets the inertia that it takes for [`DEPTH_M`], while all forces on it (weight,
//! and those of a hand that is shaken) stay those of its own mass. What a grip bears by statics is then the same; only
//! the accelerations of the body differ, and what the fingers' force could give it is far above any that it needs.

use core::f32::consts::TAU;

use schema::{Gripper, Physics};

/// How deep a finger sinks into an object at the finger force, in metres.
const DEPTH_M: f32 = 0.000_05;

/// The least inertia of an object that this hand grips, in kilograms.
pub(crate) fn inertia_kg_min(physics: &Physics, gripper: &Gripper) -> f32 {
    let frequency = TAU * physics.contact_frequency_hz;
    gripper.finger_force_n / (frequency * frequency * DEPTH_M)
}
