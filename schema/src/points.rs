//! Samples from attempts. An attempt by a rule is one sample; the attempts along one point's normal together are one
//! sample, as in VGN.
//!
//! VGN (`generate_data.py`: `evaluate_grasp_point`) tries several yaws about a point's normal. The point is positive if
//! one of them held; its orientation and width are those in the middle of the widest run of yaws that held. The
//! published code searches that run between 0 and π. A half turn gives the same grasp, so here the run wraps around.
//! The trainer and the export in VGN's format share this code.

use core::f32::consts::PI;

use crate::{Approach, AttemptRecord};

/// The representative attempt of each sample. An attempt by a rule stands for itself; consecutive attempts along one
/// point's normal are represented by the middle of the widest run of yaws that held, or by the first, if none held.
/// `attempts` are in the order of the table.
#[must_use]
pub fn samples_of(attempts: &[AttemptRecord]) -> Vec<AttemptRecord> {
    let share_point = |a: &AttemptRecord, b: &AttemptRecord| {
        let point = |of: &AttemptRecord| (of.scene_id, of.rule, of.workspace_from_grasp.translation);
        a.rule.approach == Approach::Normal && point(a) == point(b)
    };
    attempts.chunk_by(share_point).map(|about| about[widest_run(about).unwrap_or(0)].clone()).collect()
}

/// The middle of the longest run of yaws that held; the first of equal runs, and the earlier middle of an even run.
/// `None` if none held.
fn widest_run(about: &[AttemptRecord]) -> Option<usize> {
    let count = about.len();
    let held = |at: usize| about[at % count].label() == 1;
    let starts = (0..count).filter(|start| held(*start));
    let length = |start: usize| {
        let end = if goes_round(about) { start + count } else { count };
        (start..end).take_while(|at| held(*at)).count()
    };
    let widest =
        starts.map(|start| (length(start), start)).reduce(|best, run| if run.0 > best.0 { run } else { best })?;
    Some((widest.1 + (widest.0 - 1) / 2) % count)
}

/// Whether the yaws divide a half turn evenly; the last point of a dataset may lack some.
fn goes_round(about: &[AttemptRecord]) -> bool {
    let step_rad = PI / about.len() as f32;
    about.iter().enumerate().all(|(yaw, attempt)| (attempt.turn_rad - yaw as f32 * step_rad).abs() < 1e-3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Axis, Outcome, Pose, Quat, Rule, ShapeKind, Vec3};

    fn attempt(attempt_id: u32, approach: Option<Axis>, at_m: Vec3, turn_rad: f32, held: bool) -> AttemptRecord {
        AttemptRecord {
            scene_id: 3,
            attempt_id,
            object_id: 0,
            rule: Rule { shape: ShapeKind::Cuboid.into(), approach: approach.map_or(Approach::Normal, Approach::Axis) },
            closing: approach.map(|_| Axis::Y),
            tilt_rad: 0.0,
            turn_rad,
            depth_m: 0.02,
            slide_m: 0.0,
            workspace_from_grasp: Pose::from_parts(at_m, Quat::from_xyzw(1.0, 0.0, 0.0, 0.0)),
            outcome: if held { Outcome::Held } else { Outcome::Slipped },
            hit: None,
            hit_object_id: None,
            width_m: Some(0.04),
            robustness: None,
        }
    }

    fn about(held: &str) -> Vec<AttemptRecord> {
        let yaws = held.chars().zip(0_u32..);
        yaws.map(|(h, yaw)| attempt(yaw, None, Vec3::splat(0.1), PI * yaw as f32 / 6.0, h == '1')).collect()
    }

    /// Runs found by hand; "100011" wraps around: 4, 5, 0.
    #[test]
    fn a_point_is_its_widest_run_of_yaws() {
        for (held, middle) in [
            ("000000", 0),
            ("000100", 3),
            ("011100", 2),
            ("110000", 0),
            ("100011", 5),
            ("110110", 0),
            ("111111", 2),
            ("110111", 5),
            ("01", 1),
            ("11", 0),
        ] {
            let found = samples_of(&about(held));
            assert_eq!(found.len(), 1, "{held}");
            assert_eq!(found[0].attempt_id, middle, "{held}");
            assert_eq!(found[0].label(), u8::from(held.contains('1')), "{held}");
        }
    }

    #[test]
    fn points_are_kept_apart_and_rules_are_left_alone() {
        let mut rows = about("010000");
        rows.extend(about("000010").into_iter().map(|mut row| {
            row.workspace_from_grasp.translation.x += 0.01;
            row
        }));
        rows.extend((0..3).map(|id| attempt(id, Some(Axis::Z), Vec3::splat(0.2), 0.0, id == 1)));
        let found = samples_of(&rows);
        assert_eq!(found.iter().map(|row| row.attempt_id).collect::<Vec<_>>(), [1, 4, 0, 1, 2]);
        assert!(found[2..].iter().all(|row| row.workspace_from_grasp.translation == Vec3::splat(0.2)));
    }
}
