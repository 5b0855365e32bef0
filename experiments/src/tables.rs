//! Rounds, attempts and the objects before each as flat Parquet tables, and as the journal for continuing a run.

use std::collections::BTreeMap;

use schema::{HitKind, Outcome, Polyhedron, Pose, Quat, Vec3, pose_from_parts};
use serde::{Deserialize, Serialize};
use serde_json::json;
use shards::{PlainColumn, PlainTableError, plain_table};
use simulator::Body;

use crate::config::{Config, Objects};
use crate::record::{Ending, RoundRecord, TrialObject, TrialRecord};
use crate::round::Round;

/// `rounds.parquet`.
///
/// # Errors
/// [`PlainTableError`].
pub fn rounds_table(rounds: &[RoundRecord]) -> Result<Vec<u8>, PlainTableError> {
    let whole = |value: fn(&RoundRecord) -> u64| PlainColumn::Whole(rounds.iter().map(value).collect());
    let text = |value: fn(&RoundRecord) -> String| PlainColumn::Text(rounds.iter().map(value).collect());
    plain_table(vec![
        ("round", whole(|r| r.round)),
        ("seed", whole(|r| r.seed)),
        ("scene_id", whole(|r| r.scene_id)),
        ("group", text(|r| r.group.clone())),
        ("unviable_count", whole(|r| r.unviable_count.into())),
        ("object_count", whole(|r| r.object_count.into())),
        ("removed_count", whole(|r| r.removed_count.into())),
        ("lost_count", whole(|r| r.lost_count.into())),
        ("attempt_count", whole(|r| r.attempt_count.into())),
        ("ending", text(|r| r.ending.name().to_owned())),
    ])
}

/// `attempts.parquet`.
///
/// # Errors
/// [`PlainTableError`].
pub fn trials_table(trials: &[TrialRecord]) -> Result<Vec<u8>, PlainTableError> {
    let whole = |value: fn(&TrialRecord) -> u64| PlainColumn::Whole(trials.iter().map(value).collect());
    let real = |value: fn(&TrialRecord) -> f32| PlainColumn::Real(trials.iter().map(|t| Some(value(t))).collect());
    let text =
        |value: fn(&TrialRecord) -> &str| PlainColumn::Text(trials.iter().map(|t| value(t).to_owned()).collect());
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
        ("target_id", whole(|t| t.target_id.into())),
        ("target", text(TrialRecord::target)),
        ("outcome", text(|t| t.outcome.name())),
        ("hit", text(|t| t.hit.map_or("", HitKind::name))),
        ("observe_ms", real(|t| t.observe_ms)),
        ("plan_ms", real(|t| t.plan_ms)),
    ])
}

/// `objects.parquet`: the objects on the table before each attempt.
///
/// # Errors
/// [`PlainTableError`].
pub fn objects_table(trials: &[TrialRecord]) -> Result<Vec<u8>, PlainTableError> {
    let rows: Vec<(&TrialRecord, usize, &TrialObject)> =
        trials.iter().flat_map(|t| t.objects.iter().enumerate().map(move |(id, object)| (t, id, object))).collect();
    let whole = |value: fn(&TrialRecord, usize) -> u64| {
        PlainColumn::Whole(rows.iter().map(|(trial, id, _)| value(trial, *id)).collect())
    };
    let real = |value: fn(&TrialObject) -> f32| {
        PlainColumn::Real(rows.iter().map(|(_, _, object)| Some(value(object))).collect())
    };
    plain_table(vec![
        ("round", whole(|t, _| t.round)),
        ("trial", whole(|t, _| t.trial.into())),
        ("object_id", whole(|_, id| id as u64)),
        ("body", PlainColumn::Text(rows.iter().map(|(_, _, object)| object.body.clone()).collect())),
        ("size_x_m", real(|o| o.size_m.x)),
        ("size_y_m", real(|o| o.size_m.y)),
        ("size_z_m", real(|o| o.size_m.z)),
        ("mass_kg", real(|o| o.mass_kg)),
        ("friction", real(|o| o.friction)),
        ("x_m", real(|o| o.workspace_from_object.translation.x)),
        ("y_m", real(|o| o.workspace_from_object.translation.y)),
        ("z_m", real(|o| o.workspace_from_object.translation.z)),
        ("qx", real(|o| o.workspace_from_object.rotation.x)),
        ("qy", real(|o| o.workspace_from_object.rotation.y)),
        ("qz", real(|o| o.workspace_from_object.rotation.z)),
        ("qw", real(|o| o.workspace_from_object.rotation.w)),
    ])
}

/// `bodies.json`: the convex parts of a catalogue's objects, by name, in the object's frame.
#[must_use]
pub fn bodies(config: &Config) -> String {
    let Objects::Things(groups) = &config.objects else { return "{}\n".to_owned() };
    let things = groups.iter().flat_map(|(_, things)| things);
    let parts = |body: &Body| -> serde_json::Value {
        let vertices = |part: &Polyhedron| part.corners_m().iter().map(|c| c.to_array()).collect::<Vec<_>>();
        let parts: Vec<_> = body.polyhedra().iter().map(|part| json!({ "vertices_m": vertices(part) })).collect();
        json!({ "parts": parts })
    };
    let named: BTreeMap<&str, serde_json::Value> =
        things.map(|thing| (thing.body.name(), parts(&thing.body))).collect();
    json!(named).to_string() + "\n"
}

/// `run.json`: everything that is needed to execute the attempts again.
#[must_use]
pub fn conditions(config: &Config) -> String {
    let scene = config.scene.dataset_info();
    let told = json!({
        "protocol": config.protocol,
        "seeds": config.seeds,
        "size_m": scene.grid.size_m,
        "table_z_m": scene.grid.table_z_m,
        "gripper": scene.gripper,
        "procedure": scene.procedure,
        "physics": scene.config["physics"],
    });
    format!("{told:#}\n")
}

/// A round as a line of the journal.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Line {
    round: u64,
    seed: u64,
    scene_id: u64,
    group: String,
    unviable_count: u32,
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
    workspace_from_grasp: LinePose,
    width_m: f32,
    quality: f32,
    rho_m: Option<f32>,
    target_id: u32,
    objects: Vec<LineObject>,
    outcome: String,
    hit: Option<String>,
    observe_ms: f32,
    plan_ms: f32,
}

#[derive(Debug, Serialize, Deserialize)]
struct LinePose {
    position_m: [f32; 3],
    quaternion_xyzw: [f32; 4],
}

#[derive(Debug, Serialize, Deserialize)]
struct LineObject {
    body: String,
    size_m: [f32; 3],
    mass_kg: f32,
    friction: f32,
    workspace_from_object: LinePose,
}

impl From<&Round> for Line {
    fn from(round: &Round) -> Self {
        let record = &round.record;
        let trial = |trial: &TrialRecord| LineTrial {
            object_count: trial.object_count,
            planned_count: trial.planned_count,
            workspace_from_grasp: (&trial.workspace_from_grasp).into(),
            width_m: trial.width_m,
            quality: trial.quality,
            rho_m: trial.rho_m,
            target_id: trial.target_id,
            objects: trial.objects.iter().map(LineObject::from).collect(),
            outcome: trial.outcome.name().to_owned(),
            hit: trial.hit.map(|hit| hit.name().to_owned()),
            observe_ms: trial.observe_ms,
            plan_ms: trial.plan_ms,
        };
        Self {
            round: record.round,
            seed: record.seed,
            scene_id: record.scene_id,
            group: record.group.clone(),
            unviable_count: record.unviable_count,
            object_count: record.object_count,
            removed_count: record.removed_count,
            lost_count: record.lost_count,
            ending: record.ending.name().to_owned(),
            trials: round.trials.iter().map(trial).collect(),
        }
    }
}

impl Line {
    /// The round in a line, or `None` if the line is invalid.
    pub(crate) fn round(&self) -> Option<Round> {
        let trial = |(number, line): (u32, &LineTrial)| -> Option<TrialRecord> {
            Some(TrialRecord {
                round: self.round,
                trial: number,
                object_count: line.object_count,
                planned_count: line.planned_count,
                workspace_from_grasp: line.workspace_from_grasp.pose(),
                width_m: line.width_m,
                quality: line.quality,
                rho_m: line.rho_m,
                target_id: line.target_id,
                objects: line.objects.iter().map(LineObject::object).collect(),
                outcome: Outcome::ALL.into_iter().find(|outcome| outcome.name() == line.outcome)?,
                hit: match &line.hit {
                    Some(name) => Some(HitKind::ALL.into_iter().find(|hit| hit.name() == name)?),
                    None => None,
                },
                observe_ms: line.observe_ms,
                plan_ms: line.plan_ms,
            })
        };
        let trials: Option<Vec<TrialRecord>> = (0..).zip(&self.trials).map(trial).collect();
        let record = RoundRecord {
            round: self.round,
            seed: self.seed,
            scene_id: self.scene_id,
            group: self.group.clone(),
            unviable_count: self.unviable_count,
            object_count: self.object_count,
            removed_count: self.removed_count,
            lost_count: self.lost_count,
            attempt_count: self.trials.len() as u32,
            ending: Ending::ALL.into_iter().find(|ending| ending.name() == self.ending)?,
        };
        Some(Round { record, trials: trials? })
    }
}

impl From<&Pose> for LinePose {
    fn from(pose: &Pose) -> Self {
        Self { position_m: pose.translation.to_array(), quaternion_xyzw: pose.rotation.to_array() }
    }
}

impl LinePose {
    fn pose(&self) -> Pose {
        pose_from_parts(Quat::from_array(self.quaternion_xyzw), Vec3::from_array(self.position_m))
    }
}

impl From<&TrialObject> for LineObject {
    fn from(object: &TrialObject) -> Self {
        Self {
            body: object.body.clone(),
            size_m: object.size_m.to_array(),
            mass_kg: object.mass_kg,
            friction: object.friction,
            workspace_from_object: (&object.workspace_from_object).into(),
        }
    }
}

impl LineObject {
    fn object(&self) -> TrialObject {
        TrialObject {
            body: self.body.clone(),
            size_m: Vec3::from_array(self.size_m),
            mass_kg: self.mass_kg,
            friction: self.friction,
            workspace_from_object: self.workspace_from_object.pose(),
        }
    }
}
