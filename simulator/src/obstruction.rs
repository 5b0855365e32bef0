//! Where a blocked gripper first touches the obstacle. The gate itself only tests whether it does.

use schema::{GripperBox, HitKind, Outcome, Pose, Vec3};

use crate::attempt::AttemptWorld;
use crate::gate::{Hit, halved};
use crate::tested_part::PlacedPart;

/// Number of bisections: to a micrometre on the longest approach.
const HALVINGS: usize = 20;
/// Rounds of projection onto the faces of box and part.
const ROUNDS: usize = 200;

/// What blocks a gripper, and where.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Obstruction {
    /// The outcome, as [`AttemptWorld::execute`] gives it.
    pub outcome: Outcome,
    /// The obstacle, as [`AttemptWorld::execute`] gives it.
    pub hit: Hit,
    /// Distance in metres from the pre-grasp at which the gripper comes within its clearance of the obstacle.
    pub travel_m: f32,
    /// Which box of [`schema::Gripper::open_gripper`] touches first.
    pub part: usize,
    /// A workspace point inside both the obstacle and that box enlarged by the clearance.
    pub point_m: Vec3,
}

impl AttemptWorld<'_> {
    /// What blocks the gripper on its way to a grasp of object `target`; `None` if nothing does.
    ///
    /// # Panics
    /// If the scene has no object `target`.
    #[must_use]
    pub fn obstruction(&self, workspace_from_grasp: &Pose, target: usize) -> Option<Obstruction> {
        let (outcome, hit) = self.gate.blocked(workspace_from_grasp, target)?;
        let touched = |travel_m: f32| self.touched(workspace_from_grasp, hit, &self.gate.swept(0.5 * travel_m));
        let is_at_once = outcome == Outcome::PregraspCollision || touched(0.0).is_some();
        let way_m = if is_at_once { 0.0 } else { self.procedure.pregrasp_distance_m };
        let [_, travel_m] = halved(way_m, HALVINGS, |travel_m| touched(travel_m).is_none());
        // Because of rounding, an obstacle of the gate's own boxes may just miss these; then it is closest to the last.
        let boxes = self.gate.swept(0.5 * travel_m);
        let (part, at_m) = touched(travel_m).unwrap_or((boxes.len() - 1, boxes[boxes.len() - 1].centre_m));
        Some(Obstruction { outcome, hit, travel_m, part, point_m: workspace_from_grasp.transform_point(at_m) })
    }

    /// The first box that touches the obstacle, and a point that they share, up to rounding.
    fn touched(&self, workspace_from_grasp: &Pose, hit: Hit, boxes: &[GripperBox]) -> Option<(usize, Vec3)> {
        let up = workspace_from_grasp.rotation.inverse() * Vec3::Z;
        let height_m = self.table_z_m - workspace_from_grasp.translation.z;
        let shared_m = |gripper_box: &GripperBox| match hit.kind {
            HitKind::Target | HitKind::Other | HitKind::Container => {
                let parts =
                    self.gate.overlapped(hit.object_id, workspace_from_grasp, core::slice::from_ref(gripper_box));
                parts.map(|part| point_in(&part, gripper_box)).next()
            }
            HitKind::Table => Some(lowest_corner_m(gripper_box, up)).filter(|corner_m| up.dot(*corner_m) < height_m),
        };
        boxes.iter().enumerate().find_map(|(number, gripper_box)| Some((number, shared_m(gripper_box)?)))
    }
}

/// A point of a part and a box that overlap.
fn point_in(part: &PlacedPart, gripper_box: &GripperBox) -> Vec3 {
    let (low, high) = (gripper_box.centre_m - gripper_box.half_m, gripper_box.centre_m + gripper_box.half_m);
    let mut point = part.centre_m;
    // Alternating projections onto convex sets converge to a common point.
    for _ in 0..ROUNDS {
        for normal in &part.normals {
            let ([least, most], reach) = (part.span(*normal), normal.dot(point));
            point += *normal * (reach.clamp(least, most) - reach);
        }
        point = point.clamp(low, high);
    }
    point
}

fn lowest_corner_m(gripper_box: &GripperBox, up: Vec3) -> Vec3 {
    let down = |along: f32| if along > 0.0 { -1.0 } else { 1.0 };
    gripper_box.centre_m + gripper_box.half_m * Vec3::new(down(up.x), down(up.y), down(up.z))
}
