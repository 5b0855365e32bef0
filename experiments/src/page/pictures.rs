//! Scenes of rounds with the grasps that were executed.

use std::collections::BTreeMap;
use std::path::Path;

use program::Failure;
use program::text::setting;
use report::document::{Block, Drawing, Picture};
use report::picture::{Hand, Scene, svg};
use schema::{Outcome, Polyhedron, ShapeKind, Solid, Vec3};
use serde::Deserialize;

use super::Played;
use crate::files::json_if_there;
use crate::record::{Round, Trial, TrialObject};

/// Rounds that are shown.
const ROUNDS_SHOWN: usize = 8;
/// Failed grasps that are shown.
const FAILURES_SHOWN: usize = 8;
/// Sides of workspaces are whole multiples of this where `run.json` does not tell them.
const SIDE_STEP_M: f32 = 0.05;

/// What scenes stand on, and the shapes that a catalogue's objects have.
#[derive(Debug, Deserialize)]
pub(super) struct Stage {
    size_m: Option<f32>,
    table_z_m: f32,
    gripper: GripperName,
    physics: BTreeMap<String, serde_json::Value>,
    #[serde(skip)]
    bodies: BTreeMap<String, Vec<Polyhedron>>,
}

#[derive(Debug, Deserialize)]
struct GripperName {
    name: String,
}

#[derive(Debug, Deserialize)]
struct Parts {
    parts: Vec<PartCorners>,
}

#[derive(Debug, Deserialize)]
struct PartCorners {
    vertices_m: Vec<[f32; 3]>,
}

impl Stage {
    /// Reads `run.json` and `bodies.json`; `None` without the first.
    pub(super) fn read(folder: &Path) -> Result<Option<Self>, Failure> {
        let Some(stage) = json_if_there::<Self>(&folder.join("run.json"))? else { return Ok(None) };
        let parts: BTreeMap<String, Parts> = json_if_there(&folder.join("bodies.json"))?.unwrap_or_default();
        let hulls = |parts: Parts| parts.parts.iter().filter_map(|part| hull(&part.vertices_m)).collect();
        let bodies = parts.into_iter().map(|(name, parts)| (name, hulls(parts))).collect();
        Ok(Some(Self { bodies, ..stage }))
    }

    /// Keys of `run.json` that a reader wants to know.
    pub(super) fn told(&self) -> impl Iterator<Item = (String, String)> {
        let physics = self.physics.iter().map(|(key, value)| (format!("physics.{key}"), setting(value)));
        [("gripper".to_owned(), self.gripper.name.clone())].into_iter().chain(physics)
    }
}

/// `None` for corners without a volume, which no run writes.
fn hull(corners_m: &[[f32; 3]]) -> Option<Polyhedron> {
    let corners_m: Vec<Vec3> = corners_m.iter().map(|corner| Vec3::from_array(*corner)).collect();
    Polyhedron::hull_of(&corners_m).ok()
}

/// Nothing if no round has a grasp.
pub(super) fn section(one: &Played) -> Vec<Block> {
    let section = |text: &str| vec![Block::Heading("Scenes".to_owned()), Block::Text(text.to_owned())];
    let (Some(rounds), Some(stage)) = (&one.rounds, &one.stage) else {
        return section(
            "Left out: the folder has no journal.jsonl and run.json, which record where objects lay and hands grasped.",
        );
    };
    let side_m = stage.size_m.unwrap_or_else(|| side_m(rounds));
    let tried: Vec<&Round> = rounds.iter().filter(|round| !round.trials.is_empty()).collect();
    let count = tried.len().min(ROUNDS_SHOWN);
    let shown = (0..count).map(|at| round_picture(stage, side_m, tried[at * tried.len() / count])).collect::<Vec<_>>();
    if shown.is_empty() {
        return Vec::new();
    }
    let mut blocks = section(
        "Rounds evenly spread over the experiment, as they began, with all grasps of the round. Objects may have moved before later \
         grasps.",
    );
    blocks.push(Block::Legend(Outcome::ALL.to_vec()));
    blocks.push(Block::Gallery(shown));
    let failures = failures(stage, side_m, rounds);
    if !failures.is_empty() {
        let text = "Grasps that failed, each in the scene as it lay before the grasp; the first of a round, for as many rounds as there is \
                    room for:";
        blocks.extend([Block::Text(text.to_owned()), Block::Gallery(failures)]);
    }
    blocks
}

fn round_picture(stage: &Stage, side_m: f32, round: &Round) -> Picture {
    let Round { round: number, seed, scene_id, group, object_count, removed_count, ending, trials, .. } = round;
    let held = trials.iter().filter(|trial| trial.outcome == Outcome::Held).count();
    let grasps = trials.len();
    Picture::new(
        Drawing::Svg(picture(stage, side_m, &trials[0], trials)),
        format!("Round {number}: {}", ending.name()),
        format!(
            "{held} of {grasps} grasps held, {removed_count} of {object_count} objects removed; seed {seed}, scene {scene_id}, {group}"
        ),
    )
}

/// The first failed grasp of each round, as many as are shown.
fn failures(stage: &Stage, side_m: f32, rounds: &[Round]) -> Vec<Picture> {
    let failed = |trial: &Trial| trial.outcome != Outcome::Held;
    let shown = |(round, number): (&Round, usize)| {
        let trial = &round.trials[number];
        let hit = trial.hit.map_or_else(String::new, |hit| format!(", hit {}", hit.name()));
        Picture::new(
            Drawing::Svg(picture(stage, side_m, trial, std::slice::from_ref(trial))),
            format!("Round {}, grasp {number}: {}", round.round, trial.outcome.name()),
            format!("aimed at {}, quality {:.2}{hit}", trial.target(), trial.quality),
        )
    };
    let first = rounds.iter().filter_map(|round| Some((round, round.trials.iter().position(failed)?)));
    first.take(FAILURES_SHOWN).map(shown).collect()
}

/// What lay there before a grasp, and hands.
fn picture(stage: &Stage, size_m: f32, before: &Trial, trials: &[Trial]) -> String {
    let hand = |trial: &Trial| Hand {
        workspace_from_grasp: trial.workspace_from_grasp,
        width_m: trial.width_m,
        outcome: trial.outcome,
        strength: 1.0,
        label: format!("{}, aimed at {}", trial.outcome.name(), trial.target()),
    };
    let objects = before.objects.iter().enumerate();
    svg(&Scene {
        size_m,
        table_z_m: stage.table_z_m,
        bodies: objects.flat_map(|(id, object)| body(stage, object).into_iter().map(move |part| (part, id))).collect(),
        hands: trials.iter().map(hand).collect(),
    })
}

/// The least side that holds the middles of all objects.
fn side_m(rounds: &[Round]) -> f32 {
    let objects = rounds.iter().flat_map(|round| &round.trials).flat_map(|trial| &trial.objects);
    let reach = |object: &TrialObject| object.workspace_from_object.translation.truncate().max_element();
    let most = objects.map(reach).fold(0.0, f32::max);
    SIDE_STEP_M * (most / SIDE_STEP_M).ceil().max(1.0)
}

/// The convex parts of an object where it lay; none if nobody knows its shape.
fn body(stage: &Stage, object: &TrialObject) -> Vec<Polyhedron> {
    let parts = stage.bodies.get(&object.body).cloned().or_else(|| {
        let solid = Solid::new(ShapeKind::from_name(&object.body)?, object.size_m.into()).ok()?;
        Some(vec![Polyhedron::from(&solid)])
    });
    parts.unwrap_or_default().iter().map(|part| part.moved(&object.workspace_from_object)).collect()
}
