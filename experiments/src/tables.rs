//! Rounds, attempts and the objects before each as flat Parquet tables.

use std::collections::BTreeMap;

use program::Failure;
use schema::{HitKind, Polyhedron, Pose};
use serde_json::json;
use shards::{PlainColumn, plain_table, pose_columns};
use simulator::Body;

use crate::config::{Config, Objects};
use crate::record::{Attempt, AttemptObject, Round};

/// `rounds.parquet`.
///
/// # Errors
/// [`Failure`].
pub fn rounds_table(rounds: &[Round]) -> Result<Vec<u8>, Failure> {
    let whole = |value: fn(&Round) -> u64| PlainColumn::Whole(rounds.iter().map(value).collect());
    let text = |value: fn(&Round) -> String| PlainColumn::Text(rounds.iter().map(value).collect());
    plain_table(vec![
        ("round", whole(|r| r.round)),
        ("seed", whole(|r| r.seed)),
        ("scene_id", whole(|r| r.scene_id)),
        ("group", text(|r| r.group.clone())),
        ("unviable_count", whole(|r| r.unviable_count.into())),
        ("object_count", whole(|r| r.object_count.into())),
        ("removed_count", whole(|r| r.removed_count.into())),
        ("lost_count", whole(|r| r.lost_count.into())),
        ("attempt_count", whole(|r| r.attempts.len() as u64)),
        ("ending", text(|r| r.ending.name().to_owned())),
    ])
}

/// `attempts.parquet`.
///
/// # Errors
/// [`Failure`].
pub fn attempts_table(rounds: &[Round]) -> Result<Vec<u8>, Failure> {
    let id = |place: usize| PlainColumn::Whole(attempts(rounds).map(|(id, _)| id[place]).collect());
    let attempts = || attempts(rounds).map(|(_, attempt)| attempt);
    let whole = |value: fn(&Attempt) -> u64| PlainColumn::Whole(attempts().map(value).collect());
    let real = |value: fn(&Attempt) -> f32| PlainColumn::Real(attempts().map(|t| Some(value(t))).collect());
    let text = |value: fn(&Attempt) -> &str| PlainColumn::Text(attempts().map(|t| value(t).to_owned()).collect());
    let poses: Vec<&Pose> = attempts().map(|t| &t.workspace_from_grasp).collect();
    let before = [
        ("round", id(0)),
        ("trial", id(1)),
        ("object_count", whole(|t| t.object_count.into())),
        ("planned_count", whole(|t| t.planned_count.into())),
    ];
    let after = [
        ("width_m", real(|t| t.width_m)),
        ("quality", real(|t| t.quality)),
        ("rho_m", PlainColumn::Real(attempts().map(|t| t.rho_m).collect())),
        ("target_id", whole(|t| t.target_id.into())),
        ("target", text(Attempt::target)),
        ("outcome", text(|t| t.outcome.name())),
        ("hit", text(|t| t.hit.map_or("", HitKind::name))),
        ("observe_ms", real(|t| t.observe_ms)),
        ("plan_ms", real(|t| t.plan_ms)),
    ];
    plain_table(before.into_iter().chain(pose_columns(&poses)).chain(after).collect())
}

/// All grasps, each with its round and its number in it, from 0.
fn attempts(rounds: &[Round]) -> impl Iterator<Item = ([u64; 2], &Attempt)> {
    rounds.iter().flat_map(|of| (0..).zip(&of.attempts).map(|(attempt, it)| ([of.round, attempt], it)))
}

/// `objects.parquet`: the objects on the table before each attempt.
///
/// # Errors
/// [`Failure`].
pub fn objects_table(rounds: &[Round]) -> Result<Vec<u8>, Failure> {
    let rows: Vec<([u64; 3], &AttemptObject)> = attempts(rounds)
        .flat_map(|([round, attempt], of)| {
            (0..).zip(&of.objects).map(move |(id, object)| ([round, attempt, id], object))
        })
        .collect();
    let id = |place: usize| PlainColumn::Whole(rows.iter().map(|(id, _)| id[place]).collect());
    let real = |value: fn(&AttemptObject) -> f32| PlainColumn::Real(rows.iter().map(|(_, o)| Some(value(o))).collect());
    let poses: Vec<&Pose> = rows.iter().map(|(_, o)| &o.workspace_from_object).collect();
    let columns = [
        ("round", id(0)),
        ("trial", id(1)),
        ("object_id", id(2)),
        ("body", PlainColumn::Text(rows.iter().map(|(_, o)| o.body.clone()).collect())),
        ("size_x_m", real(|o| o.size_m[0])),
        ("size_y_m", real(|o| o.size_m[1])),
        ("size_z_m", real(|o| o.size_m[2])),
        ("mass_kg", real(|o| o.mass_kg)),
        ("friction", real(|o| o.friction)),
    ];
    plain_table(columns.into_iter().chain(pose_columns(&poses)).collect())
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
    let mut conditions = json!({
        "protocol": config.keys.protocol,
        "seeds": config.keys.seeds,
        "size_m": scene.grid.size_m,
        "table_z_m": scene.grid.table_z_m,
        "gripper": scene.gripper,
        "procedure": scene.procedure,
        "physics": scene.config["physics"],
    });
    if !config.scene.container.is_empty() {
        conditions["container"] = json!(config.scene.container);
    }
    format!("{conditions:#}\n")
}
