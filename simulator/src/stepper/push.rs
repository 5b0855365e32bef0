//! Impulses of contacts, given to bodies and jaws.

use wide::f32x4;

use super::contact::{Double, Motion, Push, Relative, Single};
use super::{Body, Jaws};

pub(super) fn relative(a: Motion, b: Motion) -> Relative<2> {
    Relative { linear: b.linear - a.linear, angular: [b.angular, a.angular] }
}

#[inline(always)]
pub(super) fn push_one(body: &mut Body, jaws: &mut Jaws, contact: &Single, push: Push<1>) {
    body.speeds.linear += push.impulse * f32x4::splat(body.answer.inverse_mass);
    body.speeds.angular += push.angular[0];
    jaws.push(contact.first, push.impulse);
}

/// Gives a body and a led jaw what they get.
pub(super) fn push_led(body: &mut Body, jaws: &mut Jaws, contact: &Double, push: Push<2>) {
    body.speeds.linear += push.impulse * f32x4::splat(body.answer.inverse_mass);
    body.speeds.angular += push.angular[0];
    jaws.turn(contact.first, push.angular[1]);
}

#[inline(always)]
pub(super) fn push_both(bodies: &mut [Body], contact: &Double, push: Push<2>) {
    let second = &mut bodies[contact.second];
    second.speeds.linear += push.impulse * f32x4::splat(second.answer.inverse_mass);
    second.speeds.angular += push.angular[0];
    let first = &mut bodies[contact.first];
    first.speeds.linear -= push.impulse * f32x4::splat(first.answer.inverse_mass);
    first.speeds.angular += push.angular[1];
}
