//! Scenes of rounds with the grasps that were executed.

use std::collections::BTreeMap;
use std::path::Path;

use generator::{ContainerParams, draw_container};
use program::Failure;
use report::document::{Block, Drawing, Picture};
use report::picture::{Hand, Scene, svg};
use schema::{Grid, Outcome, Polyhedron, ShapeKind, Solid, Vec3};
use serde::Deserialize;

use super::Played;
use crate::files::json;
use crate::record::{Attempt, AttemptObject, Round};

/// Rounds that are shown.
const ROUNDS_SHOWN: usize = 8;
/// Failed grasps that are shown.
const FAILURES_SHOWN: usize = 8;

/// What scenes stand on, and the shapes that a catalogue's objects have.
#[derive(Debug)]
pub(super) struct Stage {
    grid: Grid,
    /// What the objects of a round lie in: drawn again, as when it was played.
    container: Vec<ContainerParams>,
    bodies: BTreeMap<String, Vec<Polyhedron>>,
}

/// What pictures need of `run.json`.
#[derive(Deserialize)]
struct Conditions {
    table_z_m: f32,
    #[serde(default = "planners_size_m")]
    size_m: f32,
    #[serde(default)]
    container: serde_json::Value,
}

/// Of runs from before it was told.
fn planners_size_m() -> f32 {
    Grid::PAPER.size_m
}

/// A body in `bodies.json`.
#[derive(Deserialize)]
struct Parts {
    parts: Vec<PartCorners>,
}

#[derive(Deserialize)]
struct PartCorners {
    vertices_m: Vec<Vec3>,
}

impl Stage {
    /// Reads `run.json` and `bodies.json`; `None` without the first.
    pub(super) fn read(folder: &Path) -> Result<Option<Self>, Failure> {
        let Some(Conditions { table_z_m, size_m, container }) = json(&folder.join("run.json"))? else {
            return Ok(None);
        };
        let grid = Grid { table_z_m, ..Grid::PAPER.over(size_m) };
        let container = settings::read_stored(&container, "container").unwrap_or_default();
        let parts: BTreeMap<String, Parts> = json(&folder.join("bodies.json"))?.unwrap_or_default();
        // Corners without a volume have no hull; no run writes such.
        let hulls = |of: Parts| of.parts.iter().filter_map(|part| Polyhedron::hull_of(&part.vertices_m).ok()).collect();
        Ok(Some(Self {
            grid,
            container,
            bodies: parts.into_iter().map(|(name, parts)| (name, hulls(parts))).collect(),
        }))
    }
}

impl Stage {
    /// What stands on the table in a round.
    fn fixtures(&self, round: &Round) -> Vec<Polyhedron> {
        let container = draw_container(&self.container, round.seed, round.scene_id);
        container.filter(|it| it.check(&self.grid).is_ok()).map_or_else(Vec::new, |it| it.parts(&self.grid))
    }
}

/// Nothing if no round has a grasp, or without the files that tell where objects lay.
pub(super) fn section(one: &Played) -> Vec<Block> {
    let (Some(rounds), Some(stage)) = (&one.rounds, &one.stage) else { return Vec::new() };
    let tried: Vec<&Round> = rounds.iter().filter(|round| !round.attempts.is_empty()).collect();
    let count = tried.len().min(ROUNDS_SHOWN);
    if count == 0 {
        return Vec::new();
    }
    let text = "Rounds evenly spread over the experiment, as they began, with all grasps of the round. Objects may have \
                moved before later grasps.";
    let shown = (0..count).map(|at| round_picture(stage, tried[at * tried.len() / count])).collect();
    let mut blocks = vec![
        Block::Heading("Scenes".to_owned()),
        Block::Text(text.to_owned()),
        Block::Legend(Outcome::ALL.to_vec()),
        Block::Gallery(shown),
    ];
    let failures = failures(stage, rounds);
    if !failures.is_empty() {
        let text =
            "Grasps that failed, each in the scene before it: the first of a round, as many as there is room for.";
        blocks.extend([Block::Text(text.to_owned()), Block::Gallery(failures)]);
    }
    blocks
}

fn round_picture(stage: &Stage, round: &Round) -> Picture {
    let Round { round: number, seed, scene_id, group, object_count, removed_count, ending, attempts, .. } = round;
    let held = attempts.iter().filter(|attempt| attempt.outcome == Outcome::Held).count();
    let grasps = attempts.len();
    Picture::new(
        Drawing::Svg(picture(stage, round, &attempts[0], attempts)),
        format!("Round {number}: {}", ending.name()),
        format!(
            "{held} of {grasps} grasps held, {removed_count} of {object_count} objects removed; seed {seed}, scene {scene_id}, {group}"
        ),
    )
}

/// The first failed grasp of each round, as many as are shown.
fn failures(stage: &Stage, rounds: &[Round]) -> Vec<Picture> {
    let failed = |attempt: &Attempt| attempt.outcome != Outcome::Held;
    let shown = |(round, number): (&Round, usize)| {
        let attempt = &round.attempts[number];
        let hit = attempt.hit.map_or_else(String::new, |hit| format!(", hit {}", hit.name()));
        Picture::new(
            Drawing::Svg(picture(stage, round, attempt, std::slice::from_ref(attempt))),
            format!("Round {}, grasp {number}: {}", round.round, attempt.outcome.name()),
            format!("aimed at {}, quality {:.2}{hit}", attempt.target(), attempt.quality),
        )
    };
    let first = rounds.iter().filter_map(|round| Some((round, round.attempts.iter().position(failed)?)));
    first.take(FAILURES_SHOWN).map(shown).collect()
}

/// What lay there before a grasp, and hands.
fn picture(stage: &Stage, round: &Round, before: &Attempt, attempts: &[Attempt]) -> String {
    let hand = |attempt: &Attempt| Hand {
        workspace_from_grasp: attempt.workspace_from_grasp,
        width_m: attempt.width_m,
        outcome: attempt.outcome,
        strength: 1.0,
        label: format!("{}, aimed at {}", attempt.outcome.name(), attempt.target()),
    };
    let objects = before.objects.iter().enumerate();
    svg(&Scene {
        size_m: Grid::PAPER.size_m, // the planner's
        table_z_m: stage.grid.table_z_m,
        bodies: objects.flat_map(|(id, object)| body(stage, object).into_iter().map(move |part| (part, id))).collect(),
        fixtures: stage.fixtures(round),
        hands: attempts.iter().map(hand).collect(),
    })
}

/// The convex parts of an object where it lay; none if nobody knows its shape.
fn body(stage: &Stage, object: &AttemptObject) -> Vec<Polyhedron> {
    let parts = stage.bodies.get(&object.body).cloned().or_else(|| {
        let solid = Solid::new(ShapeKind::from_name(&object.body)?, object.size_m.into()).ok()?;
        Some(vec![Polyhedron::from(&solid)])
    });
    parts.unwrap_or_default().iter().map(|part| part.moved(&object.workspace_from_object)).collect()
}
