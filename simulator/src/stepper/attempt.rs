//! What an attempt asks of the stepper.

use schema::{Pose, Vec3};

use super::{Stepper, TABLE, WALLS};
use crate::bodies::AttemptEngine;

impl AttemptEngine for Stepper<'_> {
    fn closed_m(&self) -> [f32; 2] {
        self.jaws.closed_m()
    }

    fn press(&mut self, asymmetry_at_contact_m: f32) {
        self.jaws.press(asymmetry_at_contact_m);
    }

    fn move_to(&mut self, position_m: Vec3) {
        self.jaws.move_to(position_m, self.step_s);
    }

    fn gripper_poses(&self) -> [Pose; 3] {
        self.jaws.poses()
    }

    fn is_asleep(&self, object_id: usize) -> bool {
        !self.bodies[object_id].is_awake
    }

    fn is_gripped(&self, object_id: usize) -> bool {
        let by = |finger: usize| {
            self.singles.iter().any(|c| c.first == 1 + finger && c.second == object_id && c.presses())
                || self.led.iter().any(|c| c.first == finger && c.second == object_id && c.presses())
        };
        by(0) && by(1)
    }

    fn is_touched_by_others(&self, object_id: usize) -> bool {
        let stands = |first: usize| first == TABLE || first >= WALLS;
        self.singles.iter().any(|c| stands(c.first) && c.second == object_id && c.presses())
            || self.doubles.iter().any(|c| (c.first == object_id || c.second == object_id) && c.presses())
    }
}
