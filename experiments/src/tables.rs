//! Rounds and attempts as flat Parquet tables, and as the journal from which a run goes on.

use schema::{Outcome, Pose, Quat, ShapeKind, Vec3, pose_from_parts};
use serde::{Deserialize, Serialize};
use shards::{PlainColumn, PlainTableError, plain_table};

use crate::record::{Ending, RoundRecord, TrialRecord};
use crate::round::Round;

/// `rounds.parquet`.
///
/// # Errors
/// [`PlainTableError`].
pub fn rounds_table(rounds: &[RoundRecord]) -> Result<Vec<u8>, PlainTableError> {
    let whole = |value: fn(&RoundRecord) -> u64| PlainColumn::Whole(rounds.iter().map(value).collect());
    plain_table(vec![
        ("round", whole(|r| r.round)),
        ("object_count", whole(|r| r.object_count.into())),
        ("removed_count", whole(|r| r.removed_count.into())),
        ("lost_count", whole(|r| r.lost_count.into())),
        ("attempt_count", whole(|r| r.attempt_count.into())),
        ("ending", PlainColumn::Text(rounds.iter().map(|r| r.ending.name().to_owned()).collect())),
    ])
}

/// `attempts.parquet`.
///
/// # Errors
/// [`PlainTableError`].
pub fn trials_table(trials: &[TrialRecord]) -> Result<Vec<u8>, PlainTableError> {
    let whole = |value: fn(&TrialRecord) -> u64| PlainColumn::Whole(trials.iter().map(value).collect());
    let real = |value: fn(&TrialRecord) -> f32| PlainColumn::Real(trials.iter().map(|t| Some(value(t))).collect());
    let text = |value: fn(&TrialRecord) -> &'static str| {
        PlainColumn::Text(trials.iter().map(|t| value(t).to_owned()).collect())
    };
    plain_table(vec![
        ("round", whole(|t| t.round)),
        ("trial", whole(|t| t.trial.into())),
        ("object_count", whole(|t| t.object_count.into())),
        ("planned_count", whole(|t| t.planned_count.into())),
        ("x_m", real(|t| t.workspace_from_grasp.translation.x)),
        ("y_m", real(|t| t.workspace_from_grasp.translation.y)),
        ("z_m", real(|t| t.workspace_from_grasp.translation.z)),
        ("qx", real(|t| t.workspace_from_grasp.rotation.x)),
        ("qy", real(|t| t.workspace_from_grasp.rotation.y)),
        ("qz", real(|t| t.workspace_from_grasp.rotation.z)),
        ("qw", real(|t| t.workspace_from_grasp.rotation.w)),
        ("width_m", real(|t| t.width_m)),
        ("quality", real(|t| t.quality)),
        ("rho_m", PlainColumn::Real(trials.iter().map(|t| t.rho_m).collect())),
        ("shape", text(|t| t.shape.name())),
        ("outcome", text(|t| t.outcome.name())),
        ("observe_ms", real(|t| t.observe_ms)),
        ("plan_ms", real(|t| t.plan_ms)),
    ])
}

/// A round as a line of the journal.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Line {
    round: u64,
    object_count: u32,
    removed_count: u32,
    lost_count: u32,
    ending: String,
    trials: Vec<LineTrial>,
}

#[derive(Debug, Serialize, Deserialize)]
struct LineTrial {
    object_count: u32,
    planned_count: u32,
    position_m: [f32; 3],
    quaternion_xyzw: [f32; 4],
    width_m: f32,
    quality: f32,
    rho_m: Option<f32>,
    shape: String,
    outcome: String,
    observe_ms: f32,
    plan_ms: f32,
}

impl From<&Round> for Line {
    fn from(round: &Round) -> Self {
        let record = &round.record;
        let trial = |trial: &TrialRecord| LineTrial {
            object_count: trial.object_count,
            planned_count: trial.planned_count,
            position_m: trial.workspace_from_grasp.translation.to_array(),
            quaternion_xyzw: trial.workspace_from_grasp.rotation.to_array(),
            width_m: trial.width_m,
            quality: trial.quality,
            rho_m: trial.rho_m,
            shape: trial.shape.name().to_owned(),
            outcome: trial.outcome.name().to_owned(),
            observe_ms: trial.observe_ms,
            plan_ms: trial.plan_ms,
        };
        Self {
            round: record.round,
            object_count: record.object_count,
            removed_count: record.removed_count,
            lost_count: record.lost_count,
            ending: record.ending.name().to_owned(),
            trials: round.trials.iter().map(trial).collect(),
        }
    }
}

impl Line {
    /// The round that a line tells of, or `None` if it has words that mean nothing.
    pub(crate) fn round(&self) -> Option<Round> {
        let trial = |(number, line): (u32, &LineTrial)| -> Option<TrialRecord> {
            Some(TrialRecord {
                round: self.round,
                trial: number,
                object_count: line.object_count,
                planned_count: line.planned_count,
                workspace_from_grasp: pose(line),
                width_m: line.width_m,
                quality: line.quality,
                rho_m: line.rho_m,
                shape: ShapeKind::ALL.into_iter().find(|kind| kind.name() == line.shape)?,
                outcome: Outcome::ALL.into_iter().find(|outcome| outcome.name() == line.outcome)?,
                observe_ms: line.observe_ms,
                plan_ms: line.plan_ms,
            })
        };
        let trials: Option<Vec<TrialRecord>> = (0..).zip(&self.trials).map(trial).collect();
        let record = RoundRecord {
            round: self.round,
            object_count: self.object_count,
            removed_count: self.removed_count,
            lost_count: self.lost_count,
            attempt_count: self.trials.len() as u32,
            ending: Ending::ALL.into_iter().find(|ending| ending.name() == self.ending)?,
        };
        Some(Round { record, trials: trials? })
    }
}

fn pose(line: &LineTrial) -> Pose {
    pose_from_parts(Quat::from_array(line.quaternion_xyzw), Vec3::from_array(line.position_m))
}
