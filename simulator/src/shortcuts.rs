//! What an attempt may leave out, because it decides nothing.
//!
//! None of this changes what a label means: with [`Physics::shortcuts`] off, everything is simulated, and
//! `cargo bench -p generator` counts how often that ends differently.

use schema::{Outcome, Physics, Pose, Vec3};

use crate::attempt::{AttemptWorld, Execution, Run};
use crate::tested_part::PlacedPart;
use crate::watch::{AttemptEvent, Watcher};

/// Fingers are simulated from this far before they touch something.
const NEAR_M: f32 = 0.0005;
/// An object rides along if it moves no faster than this against the gripper, in m/s and rad/s, for [`STEADY_TIME_S`];
/// others rest if they move no faster than this.
const STEADY: [f32; 2] = [0.001, 0.05];
const STEADY_TIME_S: f32 = 0.025;
/// Nothing may lie this near the way that gripper and target have still to go.
const WAY_CLEAR_M: f32 = 0.001;

impl AttemptWorld<'_> {
    /// How far a free finger closes in a step.
    pub(crate) fn closing_step_m(&self) -> f32 {
        self.gripper.closing_speed_m_s * self.physics.dt_s()
    }

    /// The steps of closing that need no simulation; or the end of an attempt that the gate stops, or that closes on
    /// nothing.
    pub(crate) fn begin(
        &self,
        workspace_from_grasp: &Pose,
        target: usize,
        watcher: Option<&mut (dyn Watcher + '_)>,
    ) -> Result<usize, Execution> {
        if let Some(blocked) = self.blocked(workspace_from_grasp, target) {
            return Err(blocked);
        }
        // Other ways than along y are simulated.
        if !self.physics.shortcuts || !self.gripper.jaws.is_empty() {
            return Ok(0);
        }
        let (steps, width_m) = self.free_closing(workspace_from_grasp);
        let empty = width_m.map(|_| Execution { outcome: Outcome::Empty, hit: None, width_m, steps: 0 });
        if let Some(watcher) = watcher {
            watcher.event(AttemptEvent::ClosedFreely { steps }, None);
        }
        empty.map_or(Ok(steps), Err)
    }

    /// For how many steps the open gripper closes among objects at rest and fixtures before it comes near one; or until
    /// the jaws meet, if nothing lies between them, and the opening then.
    fn free_closing(&self, workspace_from_grasp: &Pose) -> (usize, Option<f32>) {
        let (gripper, step_m) = (self.gripper, self.closing_step_m());
        let near_m = NEAR_M + 2.0 * step_m;
        let up = workspace_from_grasp.rotation.inverse() * Vec3::Z;
        let fingers = gripper.fingers(gripper.opening_m_max).into_iter().zip([Vec3::Y, -Vec3::Y]);
        let free_m = fingers
            .map(|(finger, inward)| {
                let near = finger.grown(near_m);
                let (grown, swept) =
                    (PlacedPart::from_box(&near, &Pose::IDENTITY), near.swept(inward * gripper.opening_m_max));
                let on_way = self.gate.placed(workspace_from_grasp, &[swept]);
                let to_objects = on_way.iter().map(|o| grown.free_way_m(o, inward)).fold(f32::INFINITY, f32::min);
                let sinking = -inward.dot(up);
                let above_m = finger.lowest_z_m(workspace_from_grasp) - near_m - self.table_z_m;
                let to_table = if sinking > 0.0 { (above_m / sinking).max(0.0) } else { f32::INFINITY };
                to_objects.min(to_table)
            })
            .fold(f32::INFINITY, f32::min);
        let way_m = gripper.opening_m_max - self.procedure.empty_width_m;
        let steps_to_meet = (0.5 * way_m / step_m).ceil();
        if free_m >= steps_to_meet * step_m
            && steps_to_meet as usize <= self.physics.steps(self.procedure.close_time_s_max)
        {
            let width_m = (gripper.opening_m_max - 2.0 * steps_to_meet * step_m).max(0.0);
            return (steps_to_meet as usize, Some(width_m));
        }
        ((free_m.min(0.5 * way_m) / step_m) as usize, None)
    }
}

/// Watches a lift for the moment from which nothing can change its end.
pub(crate) struct LiftWatch {
    wanted_steps: usize,
    steady_steps: usize,
    is_proven: bool,
}

impl LiftWatch {
    pub(crate) fn new(physics: &Physics) -> Self {
        Self { wanted_steps: physics.steps(STEADY_TIME_S), steady_steps: 0, is_proven: false }
    }

    /// Whether the target is held for good: it rides along between the fingers and touches nothing else, everything
    /// else is at rest, and nothing lies on the `rest_m` that gripper and target have still to go.
    ///
    /// A gripper that slows down asks for less than it does in the end; so the target must have ridden along while it
    /// did not (`is_slowing`).
    pub(crate) fn is_decided(&mut self, run: &Run<'_>, velocity_m_s: Vec3, rest_m: Vec3, is_slowing: bool) -> bool {
        self.steady_steps = if run.rides_along(velocity_m_s) { self.steady_steps + 1 } else { 0 };
        if self.steady_steps < self.wanted_steps {
            return false;
        }
        self.is_proven |= !is_slowing;
        if !self.is_proven || !run.others_rest() {
            return false;
        }
        // A way that is not free now is looked at again when this much more of it has been gone.
        self.steady_steps = 0;
        run.way_is_free(rest_m)
    }
}

impl Run<'_> {
    fn rides_along(&self, velocity_m_s: Vec3) -> bool {
        self.engine.is_slow(self.target, velocity_m_s, STEADY)
            && self.engine.is_gripped(self.target)
            && !self.engine.is_touched_by_others(self.target)
    }

    fn others_rest(&self) -> bool {
        self.others().all(|id| self.engine.is_asleep(id) || self.engine.is_slow(id, Vec3::ZERO, STEADY))
    }

    fn way_is_free(&self, rest_m: Vec3) -> bool {
        let length_m = rest_m.length();
        let Some(direction) = rest_m.try_normalize() else { return true };
        let placed = |id: usize| self.setup.gate.placed_at(Some(id), &self.engine.pose(id));
        let mut movers = placed(self.target);
        let (gripper, poses) = (self.setup.gripper, self.engine.gripper_poses());
        let parts = gripper.parts([0.0; 2]);
        let simulated = if gripper.jaws.is_empty() { poses.len() } else { parts.len() };
        movers.extend(parts[..simulated].iter().map(|(part, of)| PlacedPart::from_box(of, &poses[*part])));
        let fixtures = self.setup.gate.placed_at(None, &self.workspace_from_grasp.inverse());
        self.others().flat_map(placed).chain(fixtures).all(|other| {
            movers.iter().all(|mover| {
                let apart = other.centre_m - mover.centre_m;
                let passed = apart - direction * apart.dot(direction).clamp(0.0, length_m);
                passed.length() > mover.radius_m + other.radius_m
                    || mover.free_way_m(&other, direction) > length_m + WAY_CLEAR_M
            })
        })
    }
}
