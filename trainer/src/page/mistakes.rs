//! The worst mistakes, with pictures of the hand in its scene.

use report::page::{Block, Cell, Picture, Section, Table};
use report::picture::{Hand, Scene, svg, width_m};
use schema::{AttemptRecord, HitKind, ObjectRecord, Polyhedron, SceneRows};
use shards::{DatasetInfo, ReadError};

use crate::evaluate::Examination;
use crate::evaluate::mistakes::Mistake;

pub(super) fn section(examined: &Examination) -> Result<Section, ReadError> {
    let mut blocks = Vec::new();
    let mut rows = Vec::new();
    for (text, mistakes) in [
        ("It was surest of these, and they failed:", &examined.mistakes.overrated),
        ("It gave these up, and they held:", &examined.mistakes.underrated),
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
    blocks.push(Block::Table(Table {
        head: vec!["scene / attempt", "quality", "what happened", "rule", "execute it again", "look at the scene"],
        rows,
    }));
    Ok(Section {
        title: "Worst mistakes".to_owned(),
        text: "The attempts with the highest qualities among those that failed, and with the lowest among those that held. The fork is the \
               hand where it grasped: green held, red failed. A pattern among them (one shape, one direction, a neighbour in the way) is \
               what the network has not learned; a quality on the right side of ½ is no wrong prediction but the nearest to one."
            .to_owned(),
        blocks,
    })
}

fn picture(info: &DatasetInfo, rows: &SceneRows, attempt: &AttemptRecord, mistake: &Mistake) -> Picture {
    let hand = Hand {
        workspace_from_grasp: attempt.workspace_from_grasp,
        width_m: width_m(&info.gripper, attempt.width_m),
        held: mistake.score.held,
        strength: 1.0,
    };
    let scene = Scene {
        size_m: info.grid.size_m,
        table_z_m: info.grid.table_z_m,
        bodies: rows.objects.iter().flat_map(bodies).collect(),
        hands: vec![hand],
    };
    Picture {
        svg: svg(&scene),
        title: format!("{}: quality {}", name(mistake), quality(mistake)),
        caption: format!("{}; drawn by the rule {}", happened(attempt), attempt.rule.name()),
    }
}

fn bodies(object: &ObjectRecord) -> impl Iterator<Item = (Polyhedron, usize)> {
    let parts = object.shape.parts().into_iter();
    parts.map(|part| (part.moved(&object.workspace_from_object), object.object_id as usize))
}

fn row(location: &str, attempt: &AttemptRecord, mistake: &Mistake) -> Vec<Cell> {
    let (scene, attempt_id) = (mistake.scene_id, mistake.attempt_id);
    vec![
        Cell::Text(format!("{scene} / {attempt_id}")),
        Cell::Number(quality(mistake)),
        Cell::Text(happened(attempt)),
        Cell::Code(attempt.rule.name().to_owned()),
        Cell::Code(format!("generator replay {location} --attempt {scene}/{attempt_id} --out attempt.html")),
        Cell::Code(format!("shards view {location} --scene {scene} --out scene.html")),
    ]
}

fn name(mistake: &Mistake) -> String {
    format!("Scene {}, attempt {}", mistake.scene_id, mistake.attempt_id)
}

fn quality(mistake: &Mistake) -> String {
    format!("{:.3}", mistake.score.quality())
}

fn happened(attempt: &AttemptRecord) -> String {
    let outcome = attempt.outcome.name();
    attempt.hit.map_or_else(|| outcome.to_owned(), |hit: HitKind| format!("{outcome}, hit {}", hit.name()))
}
