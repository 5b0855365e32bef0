//! What a stopped run keeps: the scenes that it finished of a shard that is not complete, for the next run.
//!
//! They are the shard's three tables as far as they came, and a marker that names them by their SHA-256, all under
//! names of staging. The marker is written last. It belongs to one dataset, whose id covers config, seed and version,
//! and is gone when the shard is there. Scenes are a function of that id and their number, so any number of processes
//! may keep and take up the same ones: at worst a scene is made again.

use std::iter::from_fn;
use std::sync::atomic::AtomicBool;

use arrow::RecordBatch;
use schema::SceneRows;

use crate::format::frame::Expected;
use crate::format::summary::{FileSummary, ShardSummary};
use crate::format::{check, decode, layout, seal};
use crate::read::dataset::take_while_is;
use crate::read::table_reader::{Batches, Part};
use crate::store::Storage;
use crate::{DatasetInfo, Table};

/// Scenes decoded at once, and rows of the small tables.
const BATCH_SCENES: usize = 8;
const BATCH_ROWS: usize = 1024;

/// A dataset: its storage, its info and its id.
type Place<'a> = (&'a Storage, &'a DatasetInfo, &'a str);

/// What is kept of a shard, if something is. The files may be gone or damaged.
pub(crate) fn summary((storage, info, dataset_id): Place<'_>, shard: u32) -> Result<Option<ShardSummary>, String> {
    if storage.folder().is_none() {
        return Ok(None);
    }
    let Some(marker) = storage.read(&layout::kept_marker(shard)).map_err(|e| e.to_string())? else { return Ok(None) };
    let summary: ShardSummary = seal::unseal(marker)?;
    if (summary.dataset_id.as_str(), summary.shard) != (dataset_id, shard) {
        return Err("they are of another dataset or shard".to_owned());
    }
    if summary.counts.scenes != summary.scenes.rows || !Table::ALL.iter().all(|table| is_named(&summary, *table, info))
    {
        return Err("their marker contradicts itself".to_owned());
    }
    Ok(Some(summary))
}

/// Whether a file has the name of its content, so that no marker leads to another file. Each row takes a byte or more.
fn is_named(summary: &ShardSummary, table: Table, info: &DatasetInfo) -> bool {
    let FileSummary { path, bytes, rows, sha256 } = summary.file(table);
    let is_digest = sha256.len() == 64 && sha256.bytes().all(|b| b.is_ascii_hexdigit());
    is_digest && rows <= bytes && *path == layout::kept_file(table, summary.shard, info.shard_count, sha256)
}

/// Removes what is kept of a shard.
pub(crate) fn remove(place: Place<'_>, shard: u32) {
    let (storage, ..) = place;
    if storage.folder().is_none() {
        return;
    }
    let before = summary(place, shard);
    if !matches!(before, Ok(None)) {
        storage.remove(&layout::kept_marker(shard));
    }
    for table in Table::ALL {
        if let Ok(Some(before)) = &before {
            storage.remove(&before.file(table).path);
        }
    }
}

/// The scenes that a stopped run kept of a shard, in order. If they are damaged, or of another dataset, they are thrown
/// away with a warning: the iterator ends, and the scenes are to be made again.
pub struct KeptScenes<'a> {
    place: Place<'a>,
    shard: u32,
    rows: Rows<'a, SceneRows>,
}

impl std::fmt::Debug for KeptScenes<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("KeptScenes").field("shard", &self.shard).finish_non_exhaustive()
    }
}

impl<'a> KeptScenes<'a> {
    pub(crate) fn new(place: Place<'a>, shard: u32) -> Self {
        let rows = match open(place, shard) {
            Ok(rows) => rows,
            Err(problem) => Box::new(std::iter::once(Err(problem))),
        };
        Self { place, shard, rows }
    }
}

impl Iterator for KeptScenes<'_> {
    type Item = SceneRows;

    fn next(&mut self) -> Option<SceneRows> {
        let problem = match self.rows.next()? {
            Ok(rows) => return Some(rows),
            Err(problem) => problem,
        };
        tracing::warn!(shard = self.shard, problem, "scenes kept by a stopped run are thrown away and made again");
        self.rows = Box::new(std::iter::empty());
        remove(self.place, self.shard);
        None
    }
}

type Rows<'a, R> = Box<dyn Iterator<Item = Result<R, String>> + 'a>;

/// The kept scenes of a shard, read and checked one by one.
fn open<'a>(place: Place<'a>, shard: u32) -> Result<Rows<'a, SceneRows>, String> {
    let (_, info, _) = place;
    let Some(summary) = summary(place, shard)? else { return Ok(Box::new(std::iter::empty())) };
    let table = |table, batch_rows| batches(place, &summary, table, batch_rows);
    let scenes = table(Table::Scenes, BATCH_SCENES)?;
    let (objects, attempts) = (table(Table::Objects, BATCH_ROWS)?, table(Table::Attempts, BATCH_ROWS)?);
    let mut scenes = decoded(scenes, |batch| decode::scenes(batch, info));
    let mut objects = decoded(objects, |batch| decode::objects(batch, &info.models)).peekable();
    let mut attempts = decoded(attempts, |batch| decode::attempts(batch, info)).peekable();
    let mut left = info.scenes_of(shard);
    let mut next = move || {
        let Some(scene) = scenes.next().transpose()? else { return Ok(None) };
        let scene_id = scene.scene_id;
        if !left.contains(&scene_id) {
            return Err(format!("scene ids must count up within {left:?}, got {scene_id}"));
        }
        left.start = scene_id + 1;
        let objects = take_while_is(&mut objects, |row| row.scene_id == scene_id)?;
        let attempts = take_while_is(&mut attempts, |row| row.scene_id == scene_id)?;
        let rows = SceneRows { scene, objects, attempts };
        check::scene_rows(&rows, info)?;
        Ok(Some(rows))
    };
    Ok(Box::new(from_fn(move || next().transpose())))
}

/// A table's batches, once its checksum is verified.
fn batches(
    (storage, info, _): Place<'_>,
    summary: &ShardSummary,
    table: Table,
    batch_rows: usize,
) -> Result<Batches, String> {
    let file = summary.file(table);
    let opened = storage.open_file(file, &AtomicBool::new(false)).map_err(|e| e.to_string())??;
    Batches::open(
        opened,
        Expected { table, form: info.form(), rows: file.rows },
        Part { batch_rows, ..Part::default() },
    )
}

fn decoded<'a, R: 'a>(batches: Batches, decode: impl Fn(&RecordBatch) -> Result<Vec<R>, String> + 'a) -> Rows<'a, R> {
    let rows = move |batch: Result<RecordBatch, String>| match batch.and_then(|batch| decode(&batch)) {
        Ok(rows) => rows.into_iter().map(Ok).collect(),
        Err(problem) => vec![Err(problem)],
    };
    Box::new(batches.flat_map(rows))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Draft;
    use crate::store::{Fault, Kind, Store};
    use crate::synthetic;

    fn info() -> DatasetInfo {
        let mut info = synthetic::info(9, 1, 60, 5);
        info.grid.resolution = 4;
        info
    }

    fn rows(scene: u64) -> SceneRows {
        synthetic::scene_rows(scene, info().seed, &info())
    }

    /// Keeps some of the scenes; `passing` operations of the disk pass.
    fn keep(draft: &Draft, passing: u64, scenes: &[u64]) -> Result<u64, program::Failure> {
        let folder = draft.storage.folder().unwrap();
        let storage = Storage::Folder(Store::faulty(folder, Fault::after(passing, Kind::Fail)));
        let draft = Draft { storage, info: info(), dataset_id: draft.dataset_id.clone() };
        let mut writer = draft.shard(0)?;
        for scene in scenes {
            writer.skip_to(*scene);
            writer.push(&rows(*scene))?;
        }
        writer.keep().map(|kept| kept.scenes)
    }

    #[test]
    fn the_scenes_come_back_and_fewer_do_not_replace_more() {
        let folder = tempfile::tempdir().unwrap();
        let draft = Draft::begin(folder.path(), &info()).unwrap();
        assert_eq!(draft.kept(0).count(), 0);
        for (scenes, kept) in [(&[1, 4, 5][..], &[1, 4, 5][..]), (&[0, 2], &[1, 4, 5]), (&[0, 1, 2, 9], &[0, 1, 2, 9])]
        {
            assert_eq!(keep(&draft, u64::MAX, scenes).unwrap(), kept.len() as u64);
            assert!(draft.kept(0).eq(kept.iter().map(|scene| rows(*scene))), "{scenes:?}");
        }
        assert_eq!(draft.sweep(crate::Sweep::Look).unwrap().kept, 4, "what was replaced is gone");
    }

    #[test]
    fn a_shard_with_gaps_is_not_committed() {
        let folder = tempfile::tempdir().unwrap();
        let draft = Draft::begin(folder.path(), &info()).unwrap();
        let mut writer = draft.shard(0).unwrap();
        for scene in draft.info().scenes_of(0).filter(|scene| *scene != 3) {
            writer.skip_to(scene);
            writer.push(&rows(scene)).unwrap();
        }
        assert_eq!(writer.commit().unwrap_err().to_string(), "shard 0 must have 12 scenes, got 11");
    }

    #[test]
    fn whichever_operation_fails_all_scenes_or_none_are_kept() {
        let scenes = [0, 1, 2, 5];
        for passing in 0..1000 {
            let folder = tempfile::tempdir().unwrap();
            let draft = Draft::begin(folder.path(), &info()).unwrap();
            let result = keep(&draft, passing, &scenes);
            let found = draft.kept(0).count();
            if result.is_ok() {
                assert!(found == scenes.len() && passing > 10, "{found} scenes after {passing} operations");
                return;
            }
            assert!(found == 0 || found == scenes.len(), "{found} scenes after {passing} operations");
        }
        panic!("keeping takes fewer than 1,000 operations");
    }
}
