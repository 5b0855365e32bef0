//! Iterates over a shard's scenes without holding all of them in memory.

use std::iter::from_fn;

use schema::{AttemptRecord, ObjectRecord, SceneRecord, SceneRows};

use crate::format::{check, decode};
use crate::read::table_reader::Batches;
use crate::{Dataset, Error, Table};

/// The scenes of a shard, decoded a few at a time; none after an error.
pub(super) fn scenes(
    dataset: &Dataset,
    shard: u32,
    mut batches: Batches,
    has_grids: bool,
) -> impl Iterator<Item = Result<SceneRecord, Error>> {
    let mut ids = dataset.info().scenes_of(shard);
    let mut decoded = Vec::new().into_iter();
    let mut next = move || {
        loop {
            if let Some(scene) = decoded.next() {
                return checked(dataset, ids.next(), scene, has_grids).map(Some);
            }
            match batches.next() {
                Some(batch) => decoded = decode::scenes(&batch?)?.into_iter(),
                None if ids.is_empty() => return Ok(None),
                None => return Err(format!("scene {} is missing", ids.start)),
            }
        }
    };
    let mut is_over = false;
    from_fn(move || {
        if is_over {
            return None;
        }
        let found = next();
        is_over = !matches!(found, Ok(Some(_)));
        found.map_err(|message| dataset.wrong(shard, Table::Scenes, &message)).transpose()
    })
}

fn checked(
    dataset: &Dataset,
    expected: Option<u64>,
    scene: SceneRecord,
    has_grid: bool,
) -> Result<SceneRecord, String> {
    if expected != Some(scene.scene_id) {
        return Err(format!("scene ids must count up: expected {expected:?}, got {}", scene.scene_id));
    }
    let info = dataset.info();
    let grid = if has_grid { check::tsdf(&scene.tsdf, info) } else { Ok(()) };
    check::scene_head(&scene, info).and(grid).map_err(|e| format!("scene {}: {e}", scene.scene_id))?;
    Ok(scene)
}

/// Adds to each scene of a shard, in their order, its rows of the other tables, which are in the same order.
pub(crate) fn joined(objects: Vec<ObjectRecord>, attempts: Vec<AttemptRecord>) -> impl FnMut(SceneRecord) -> SceneRows {
    let (mut objects, mut attempts) = (objects.into_iter().peekable(), attempts.into_iter().peekable());
    move |scene| {
        let id = scene.scene_id;
        SceneRows {
            objects: from_fn(|| objects.next_if(|row| row.scene_id == id)).collect(),
            attempts: from_fn(|| attempts.next_if(|row| row.scene_id == id)).collect(),
            scene,
        }
    }
}
