//! Beyond the paper: the closing direction by what was seen between the fingers.
//!
//! A box can be gripped across either pair of its sides, and one orientation a voxel is then often wrong about the
//! closing direction by tens of degrees, where the approach is right to a few. So the grasp is turned about the
//! network's approach, to the turn at which what lies between the fingers is narrowest, and moved along its closing
//! direction until that is in their middle, as the paper's rules have it (Appendix A: no offset along y).

use core::f32::consts::FRAC_PI_4;

use schema::{Grasp, Gripper, Pose, Vec3, axis_angle};

use crate::config::CollisionParams;
use crate::gripper_volume::GripperVolume;

/// Between turns that are tried: a box that is off by half of it is 2 mm wider.
const STEP_RAD: f32 = FRAC_PI_4 / 9.0;
/// Steps to either side, which reach every orientation of a box that can be gripped by quarter turns.
const STEPS: i32 = 9;
/// How far above the tips a point may lie to be between the fingers: the deepest of the paper's tips (d_z).
const DEPTH_M: f32 = 0.035;
/// Points that are further apart along the closing direction belong to different objects: half a finger.
const GAP_M: f32 = 0.008;
/// Fewest points between the fingers: a square centimetre of a cloud with points every 2.5 mm.
const POINTS_MIN: usize = 16;
/// What a turn by a radian costs, in metres of width: of equal widths the network's turn is the best.
const TURN_COST_M: f32 = 0.005;

/// What is needed to close a gripper on a cloud.
pub(crate) struct Closer<'a> {
    gripper: &'a Gripper,
    sweep: GripperVolume,
    points_max: usize,
    /// The whole cloud, which is in the way.
    cloud_m: &'a [Vec3],
    /// Its part that is not the table.
    things_m: Vec<Vec3>,
}

impl<'a> Closer<'a> {
    /// `things_m`: the points of the cloud on which a gripper may close.
    pub(crate) fn new(
        gripper: &'a Gripper,
        collision: &CollisionParams,
        cloud_m: &'a [Vec3],
        things_m: Vec<Vec3>,
    ) -> Self {
        Self {
            gripper,
            sweep: GripperVolume::swept(gripper, collision),
            points_max: collision.points_max,
            cloud_m,
            things_m,
        }
    }

    /// The grasp that closes on what was seen about a predicted one, by a free way.
    pub(crate) fn closed(&self, predicted: &Pose) -> Option<Grasp> {
        let from_workspace = predicted.inverse();
        let reach_m = 0.5 * self.gripper.opening_m_max + GAP_M;
        let about: Vec<Vec3> = self
            .things_m
            .iter()
            .map(|point| from_workspace * *point)
            .filter(|p| (-DEPTH_M..=0.0).contains(&p.z) && libm::hypotf(p.x, p.y) <= reach_m)
            .collect();
        let turns: Vec<Option<Grasp>> =
            (-STEPS - 1..=STEPS + 1).map(|step| self.turned(predicted, &about, step as f32 * STEP_RAD)).collect();
        let width_m = |turned: &Option<Grasp>| turned.map_or(f32::INFINITY, |grasp| grasp.width_m);
        // Only where it is narrower than to either side: otherwise the narrowest turn may be the last before a corner.
        let narrowest = turns.windows(3).zip(-STEPS..).filter_map(|(turns, step)| {
            let [before, here, after] = [0, 1, 2].map(|at| width_m(&turns[at]));
            let cost_m = here + TURN_COST_M * (step as f32 * STEP_RAD).abs();
            turns[1].filter(|_| here <= before && here <= after).map(|grasp| (cost_m, grasp))
        });
        let mut grasps: Vec<(f32, Grasp)> = narrowest.collect();
        grasps.sort_by(|a, b| a.0.total_cmp(&b.0));
        let is_free =
            |grasp: &Grasp| self.sweep.points_inside(&grasp.workspace_from_grasp, self.cloud_m) <= self.points_max;
        grasps.into_iter().map(|(_, grasp)| grasp).find(is_free)
    }

    /// The grasp after a turn about its approach, with what it closes on in its middle.
    fn turned(&self, predicted: &Pose, about: &[Vec3], turn_rad: f32) -> Option<Grasp> {
        let turn = axis_angle(Vec3::Z, turn_rad);
        let back = turn.inverse();
        let half_x_m = 0.5 * self.gripper.finger_width_m;
        let between = about.iter().map(|point| back * *point).filter(|point| point.x.abs() <= half_x_m);
        let mut along_m: Vec<f32> = between.map(|point| point.y).collect();
        along_m.sort_by(f32::total_cmp);
        // Of the things between the fingers the one nearest to their middle.
        let things = along_m.chunk_by(|a, b| b - a <= GAP_M);
        let middle_m = |thing: &[f32]| 0.5 * (thing[0] + thing[thing.len() - 1]);
        let thing = things
            .filter(|thing| thing.len() >= POINTS_MIN)
            .min_by(|a, b| middle_m(a).abs().total_cmp(&middle_m(b).abs()))?;
        let width_m = thing[thing.len() - 1] - thing[0];
        if width_m > self.gripper.opening_m_max - 2.0 * self.gripper.clearance_m {
            return None;
        }
        let mut workspace_from_grasp = *predicted;
        workspace_from_grasp.rotation = (predicted.rotation * turn).normalize();
        workspace_from_grasp.translation += workspace_from_grasp.rotation * Vec3::new(0.0, middle_m(thing), 0.0);
        Some(Grasp { workspace_from_grasp, width_m })
    }
}

#[cfg(test)]
mod tests {
    use schema::{Quat, pose_from_parts};

    use super::*;
    use crate::BuiltIn;

    /// The top and the sides of a box on z = 0 at (x, y), turned by an angle, with points every 2.5 mm.
    fn box_m(at: [f32; 2], size_m: [f32; 3], turn_rad: f32) -> Vec<Vec3> {
        let count = size_m.map(|side| (side / 0.0025).round() as i32);
        let mut points = Vec::new();
        for i in 0..=count[0] {
            for j in 0..=count[1] {
                for k in 0..=count[2] {
                    if i == 0 || i == count[0] || j == 0 || j == count[1] || k == count[2] {
                        let local = Vec3::new(i as f32, j as f32, k as f32) * 0.0025
                            - Vec3::new(size_m[0], size_m[1], 0.0) * 0.5;
                        points.push(axis_angle(Vec3::Z, turn_rad) * local + Vec3::new(at[0], at[1], 0.0));
                    }
                }
            }
        }
        points
    }

    fn closed(things_m: &[Vec3], turn_rad: f32, off_m: Vec3) -> Option<Grasp> {
        let config = BuiltIn::Paper.config().unwrap();
        let closer = Closer::new(&config.gripper, &config.collision, things_m, things_m.to_vec());
        let down = Quat::from_xyzw(1.0, 0.0, 0.0, 0.0);
        closer.closed(&pose_from_parts(down * axis_angle(Vec3::Z, turn_rad), Vec3::new(0.1, 0.1, 0.03) + off_m))
    }

    #[test]
    fn a_grasp_is_turned_to_the_sides_of_a_box_and_put_in_its_middle() {
        let things_m = box_m([0.1, 0.1], [0.06, 0.04, 0.05], 0.3);
        for turn_rad in [-0.9, -0.5, -0.31, -0.1, 0.3, 0.9] {
            let grasp = closed(&things_m, turn_rad, Vec3::new(0.004, -0.006, 0.0)).unwrap();
            let closing = axis_angle(Vec3::Z, -0.3) * (grasp.workspace_from_grasp.rotation * Vec3::Y);
            let off_rad = libm::asinf(closing.x.abs().min(closing.y.abs()));
            assert!(off_rad < 0.06, "{turn_rad}: {off_rad}");
            let side_m = if closing.x.abs() > 0.5 { 0.06 } else { 0.04 };
            assert!((grasp.width_m - side_m).abs() < 0.003, "{turn_rad}: {}", grasp.width_m);
            let from_middle_m = (Vec3::new(0.1, 0.1, 0.03) - grasp.workspace_from_grasp.translation)
                .dot(grasp.workspace_from_grasp.rotation * Vec3::Y);
            assert!(from_middle_m.abs() < 0.002, "{turn_rad}: {from_middle_m}");
        }
    }

    #[test]
    fn what_no_gripper_spans_or_what_is_not_there_has_none() {
        assert!(closed(&box_m([0.1, 0.1], [0.1, 0.1, 0.05], 0.2), 0.1, Vec3::ZERO).is_none(), "too broad");
        assert!(closed(&box_m([0.2, 0.1], [0.04, 0.04, 0.05], 0.2), 0.1, Vec3::ZERO).is_none(), "beside it");
        let mut walled = box_m([0.1, 0.1], [0.04, 0.04, 0.05], 0.0);
        assert!(closed(&walled, 0.1, Vec3::ZERO).is_some());
        for (x, y) in [(0.15, 0.1), (0.05, 0.1), (0.1, 0.15), (0.1, 0.05)] {
            walled.extend(box_m([x, y], [0.04, 0.04, 0.08], 0.0));
        }
        assert!(closed(&walled, 0.1, Vec3::ZERO).is_none(), "neighbours on all sides");
    }
}
