//! The worst mistakes, with pictures of the hand in its scene.

use inspect::scene_svg;
use program::Failure;
use report::document::{Block, Cell, Drawing, Picture, Table};
use schema::{AttemptRecord, HitKind, Outcome, SceneRows};
use shards::DatasetInfo;

use crate::evaluate::Examination;
use crate::evaluate::worst_errors::Mistake;

pub(super) fn section(examined: &Examination) -> Result<Vec<Block>, Failure> {
    let text = "The attempts with the highest qualities among those that failed, and with the lowest among those that held. The fork is the \
                hand where it grasped. A pattern among them (one shape, one direction, a neighbour in the way) is \
                what the network has not learned. A quality on the right side of ½ is not a wrong prediction, only the nearest to one.";
    let mut blocks = vec![
        Block::Heading("Worst mistakes".to_owned()),
        Block::Text(text.to_owned()),
        Block::Legend(Outcome::ALL.to_vec()),
    ];
    let mut rows = Vec::new();
    for (text, mistakes) in [
        ("It was surest of these, and they failed:", &examined.overrated),
        ("It gave these up, and they held:", &examined.underrated),
    ] {
        let mut pictures = Vec::new();
        for mistake in mistakes {
            let scene = examined.dataset.read_scene(mistake.scene_id)?;
            // An evaluated sample is an attempt of the scene that it was read from.
            let Some(attempt) = scene.attempts.iter().find(|a| a.attempt_id == mistake.attempt_id) else { continue };
            pictures.push(picture(examined.dataset.info(), &scene, attempt, mistake));
            rows.push(row(&examined.dataset.location().to_string(), attempt, mistake));
        }
        if !pictures.is_empty() {
            blocks.extend([Block::Text(text.to_owned()), Block::Gallery(pictures)]);
        }
    }
    let head = ["scene / attempt", "quality", "what happened", "rule", "execute it again", "look at the scene"];
    blocks.push(Block::Table(Table::new(head, rows)));
    Ok(blocks)
}

fn picture(info: &DatasetInfo, rows: &SceneRows, attempt: &AttemptRecord, mistake: &Mistake) -> Picture {
    Picture::new(
        Drawing::Svg(scene_svg(info, rows, std::slice::from_ref(attempt), 1.0)),
        format!("{}/{}: quality {}", mistake.scene_id, mistake.attempt_id, quality(mistake)),
        format!("{}; drawn by the rule {}", happened(attempt), attempt.rule.name()),
    )
}

fn row(location: &str, attempt: &AttemptRecord, mistake: &Mistake) -> Vec<Cell> {
    let (scene, attempt_id) = (mistake.scene_id, mistake.attempt_id);
    vec![
        Cell::Code(format!("{scene}/{attempt_id}")),
        Cell::Number(quality(mistake)),
        happened(attempt).into(),
        Cell::code(attempt.rule.name()),
        Cell::Code(format!("graspmill dataset replay {location} --attempt {scene}/{attempt_id} --out attempt.html")),
        Cell::Code(format!("graspmill dataset view {location} --scene {scene} --out scene.html")),
    ]
}

fn quality(mistake: &Mistake) -> String {
    format!("{:.3}", mistake.score.quality())
}

fn happened(attempt: &AttemptRecord) -> String {
    let outcome = attempt.outcome.name();
    attempt.hit.map_or_else(|| outcome.to_owned(), |hit: HitKind| format!("{outcome}, hit {}", hit.name()))
}
