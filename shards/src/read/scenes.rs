//! Iterates over a shard's scenes without holding all of them in memory.

use schema::{AttemptRecord, ObjectRecord, SceneRecord, SceneRows};

use crate::format::check;
use crate::format::decode;
use crate::read::table_reader::Batches;
use crate::{Dataset, Error, Table};

/// The scenes of a shard, decoded a few at a time.
pub struct Scenes<'a> {
    dataset: &'a Dataset,
    shard: u32,
    batches: Batches,
    /// Remaining scene ids.
    ids: std::ops::Range<u64>,
    has_grids: bool,
    is_over: bool,
    buffer: std::vec::IntoIter<SceneRecord>,
}

impl std::fmt::Debug for Scenes<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scenes").field("shard", &self.shard).field("ids", &self.ids).finish_non_exhaustive()
    }
}

impl<'a> Scenes<'a> {
    pub(crate) fn new(dataset: &'a Dataset, shard: u32, batches: Batches, has_grids: bool) -> Self {
        let ids = dataset.info().scenes_of(shard);
        Self { dataset, shard, batches, ids, has_grids, is_over: false, buffer: Vec::new().into_iter() }
    }

    fn advance(&mut self) -> Result<Option<SceneRecord>, String> {
        loop {
            if let Some(scene) = self.buffer.next() {
                return self.checked(scene).map(Some);
            }
            match self.batches.next() {
                Some(batch) => self.buffer = decode::scenes(&batch?)?.into_iter(),
                None if self.ids.is_empty() => return Ok(None),
                None => return Err(format!("scene {} is missing", self.ids.start)),
            }
        }
    }

    fn checked(&mut self, scene: SceneRecord) -> Result<SceneRecord, String> {
        let expected = self.ids.next();
        if expected != Some(scene.scene_id) {
            return Err(format!("scene ids must count up: expected {expected:?}, got {}", scene.scene_id));
        }
        let info = self.dataset.info();
        let in_scene = |e: String| format!("scene {}: {e}", scene.scene_id);
        check::scene_head(&scene, info).map_err(in_scene)?;
        if self.has_grids {
            check::tsdf(&scene.tsdf, info).map_err(in_scene)?;
        }
        Ok(scene)
    }
}

impl Iterator for Scenes<'_> {
    type Item = Result<SceneRecord, Error>;

    /// The next scene; none after an error.
    fn next(&mut self) -> Option<Self::Item> {
        if self.is_over {
            return None;
        }
        let advanced = self.advance();
        self.is_over = !matches!(advanced, Ok(Some(_)));
        advanced.map_err(|message| self.dataset.wrong(self.shard, Table::Scenes, &message)).transpose()
    }
}

/// Adds to each scene of a shard, in their order, its rows of the other tables, which are in the same order.
pub(crate) fn joined(objects: Vec<ObjectRecord>, attempts: Vec<AttemptRecord>) -> impl FnMut(SceneRecord) -> SceneRows {
    let (mut objects, mut attempts) = (objects.into_iter().peekable(), attempts.into_iter().peekable());
    move |scene| {
        let id = scene.scene_id;
        SceneRows {
            objects: std::iter::from_fn(|| objects.next_if(|row| row.scene_id == id)).collect(),
            attempts: std::iter::from_fn(|| attempts.next_if(|row| row.scene_id == id)).collect(),
            scene,
        }
    }
}
