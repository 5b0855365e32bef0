//! How far a blocked gripper comes. The gate itself only tests whether it is blocked.

use schema::{HitKind, Outcome, Pose};

use crate::attempt::AttemptWorld;
use crate::gate::{Hit, halved};

/// Number of bisections: to a micrometre on the longest approach.
const HALVINGS: usize = 20;

/// What blocks a gripper, and how far it comes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Obstruction {
    /// The outcome, as [`AttemptWorld::execute`] gives it.
    pub outcome: Outcome,
    /// The obstacle, as [`AttemptWorld::execute`] gives it.
    pub hit: Hit,
    /// Distance in metres from the pre-grasp at which the gripper comes within its clearance of the obstacle.
    pub travel_m: f32,
}

impl AttemptWorld<'_> {
    /// What blocks the gripper on its way to a grasp of object `target`; `None` if nothing does.
    ///
    /// # Panics
    /// If the scene has no object `target`.
    #[must_use]
    pub fn obstruction(&self, workspace_from_grasp: &Pose, target: usize) -> Option<Obstruction> {
        let (outcome, hit) = self.gate.blocked(workspace_from_grasp, target)?;
        let is_free = |travel_m: f32| {
            let boxes = self.gate.swept(0.5 * travel_m);
            match hit.kind {
                HitKind::Target | HitKind::Other | HitKind::Container => {
                    self.gate.overlapped(hit.object_id, workspace_from_grasp, &boxes).next().is_none()
                }
                HitKind::Table => boxes.iter().all(|b| b.lowest_z_m(workspace_from_grasp) >= self.table_z_m),
            }
        };
        let is_at_once = outcome == Outcome::PregraspCollision || !is_free(0.0);
        let way_m = if is_at_once { 0.0 } else { self.procedure.pregrasp_distance_m };
        let [_, travel_m] = halved(way_m, HALVINGS, is_free);
        Some(Obstruction { outcome, hit, travel_m })
    }
}
