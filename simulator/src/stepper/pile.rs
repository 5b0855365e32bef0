//! What a pile asks of the stepper.

use schema::{Pose, Vec3};

use super::{Body, Plane, Stepper};
use crate::bodies::PileEngine;

impl PileEngine for Stepper<'_> {
    fn add(&mut self, pose: &Pose, velocity_m_s: Vec3) {
        let body = Body::new(&self.things[self.bodies.len()], pose, true);
        self.bodies.push(Body { velocity_m_s, ..body });
    }

    fn add_walls(&mut self, size_m: f32) {
        let walls = [(Vec3::X, 0.0), (-Vec3::X, -size_m), (Vec3::Y, 0.0), (-Vec3::Y, -size_m)];
        self.planes.extend(walls.map(|(normal, offset_m)| Plane { normal, offset_m }));
    }

    fn remove_walls(&mut self) {
        self.planes.truncate(1);
        for body in &mut self.bodies {
            body.is_awake = true;
        }
    }

    fn fall_asleep(&mut self) {
        for body in &mut self.bodies {
            (body.is_awake, body.velocity_m_s, body.spin_rad_s) = (false, Vec3::ZERO, Vec3::ZERO);
        }
    }
}
