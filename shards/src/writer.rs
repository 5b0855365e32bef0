//! Writing a shard: scenes in order, a few at a time, into three files that appear together or not at all.

use std::ops::Range;
use std::path::Path;

use schema::{AttemptRecord, ObjectRecord, SceneRecord, SceneRows};

use crate::check::{self, RowError};
use crate::store::{Published, Store, StoreError};
use crate::summary::{Counts, ShardSummary};
use crate::table_writer::{TableError, TableWriter};
use crate::{DatasetInfo, ExitCode, Table, encode, layout, seal};

/// Scenes of a row group, in every table: row group `k` of each holds the same scenes.
pub const SCENES_PER_ROW_GROUP: u64 = 256;
/// Scenes turned into columns at once; bounds what a writer holds, 4 MB of grids.
const SCENES_PER_BATCH: usize = 16;

/// Why a shard was not written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// There is no such shard.
    #[error("shard must be below {shard_count}, got {shard}")]
    NoSuchShard {
        /// What was asked for.
        shard: u32,
        /// How many there are.
        shard_count: u32,
    },
    /// A row breaks a rule: a defect of whoever made it.
    #[error("shard {shard}, scene {scene_id}: {source}")]
    Row {
        /// The shard.
        shard: u32,
        /// The scene.
        scene_id: u64,
        /// The rule.
        source: RowError,
    },
    /// A scene came out of order, or too few came.
    #[error("shard {shard} must go on with scene {expected} of {}..{}, got {got}", .scenes.start, .scenes.end)]
    Order {
        /// The shard.
        shard: u32,
        /// Its scenes.
        scenes: Range<u64>,
        /// The next scene.
        expected: u64,
        /// What came instead.
        got: String,
    },
    /// The disk refused.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A table could not be written.
    #[error("shard {shard}: {source}")]
    Table {
        /// The shard.
        shard: u32,
        /// What happened.
        source: TableError,
    },
    /// The shard was written before, with other bytes.
    #[error(
        "shard {shard} came out differently from before, {before} then and {now} now: is the code or the machine another?"
    )]
    NotReproduced {
        /// The shard.
        shard: u32,
        /// SHA-256 of the marker that is there.
        before: String,
        /// SHA-256 of the new one.
        now: String,
    },
}

impl WriteError {
    /// The code to end with.
    #[must_use]
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::NoSuchShard { .. } => ExitCode::Config,
            Self::Row { .. } | Self::Order { .. } => ExitCode::Internal,
            Self::Store(error) => error.exit_code(),
            Self::Table { source: TableError::Store(error), .. } => error.exit_code(),
            Self::Table { .. } => ExitCode::Internal,
            Self::NotReproduced { .. } => ExitCode::Data,
        }
    }
}

/// Writes one shard. Dropped before [`ShardWriter::commit`], it leaves nothing that counts.
pub struct ShardWriter {
    info: DatasetInfo,
    store: Store,
    shard: u32,
    scenes: Range<u64>,
    next: u64,
    counts: Counts,
    attempts: (TableWriter, Vec<AttemptRecord>),
    objects: (TableWriter, Vec<ObjectRecord>),
    grids: (TableWriter, Vec<SceneRecord>),
}

impl std::fmt::Debug for ShardWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ShardWriter").field("shard", &self.shard).field("next", &self.next).finish_non_exhaustive()
    }
}

impl ShardWriter {
    /// Begins a shard of the dataset in `dir`, which [`crate::begin_dataset`] has made.
    ///
    /// # Errors
    /// [`WriteError`] if there is no such shard or the disk refuses.
    pub fn create(dir: &Path, info: &DatasetInfo, shard: u32) -> Result<Self, WriteError> {
        Self::create_in(Store::new(dir), info, shard)
    }

    pub(crate) fn create_in(store: Store, info: &DatasetInfo, shard: u32) -> Result<Self, WriteError> {
        if shard >= info.shard_count {
            return Err(WriteError::NoSuchShard { shard, shard_count: info.shard_count });
        }
        let open = |table| {
            TableWriter::create(&store, table, [shard, info.shard_count], info.grid.resolution)
                .map_err(|source| WriteError::Table { shard, source })
        };
        let scenes = info.scenes_of(shard);
        Ok(Self {
            attempts: (open(Table::Attempts)?, Vec::new()),
            objects: (open(Table::Objects)?, Vec::new()),
            grids: (open(Table::Scenes)?, Vec::new()),
            info: info.clone(),
            store,
            shard,
            next: scenes.start,
            scenes,
            counts: Counts::zero(),
        })
    }

    /// The scene that comes next; the end of the shard's range when all are there.
    #[must_use]
    pub fn next_scene(&self) -> u64 {
        self.next
    }

    /// Adds a scene, strictly in the order of scene ids.
    ///
    /// # Errors
    /// [`WriteError`] if the scene is not the next one, a row breaks a rule, or the disk refuses.
    pub fn push(&mut self, rows: &SceneRows) -> Result<(), WriteError> {
        let scene_id = rows.scene.scene_id;
        if scene_id != self.next || !self.scenes.contains(&scene_id) {
            return Err(self.out_of_order(format!("scene {scene_id}")));
        }
        check::scene_rows(rows, &self.info).map_err(|source| WriteError::Row {
            shard: self.shard,
            scene_id,
            source,
        })?;
        self.counts.count(rows);
        self.attempts.1.extend_from_slice(&rows.attempts);
        self.objects.1.extend_from_slice(&rows.objects);
        self.grids.1.push(rows.scene.clone());
        self.next += 1;
        let ends_row_group = (self.next - self.scenes.start).is_multiple_of(SCENES_PER_ROW_GROUP);
        if ends_row_group || self.grids.1.len() >= SCENES_PER_BATCH {
            self.write_batch(ends_row_group).map_err(|source| WriteError::Table { shard: self.shard, source })?;
        }
        Ok(())
    }

    fn out_of_order(&self, got: String) -> WriteError {
        WriteError::Order { shard: self.shard, scenes: self.scenes.clone(), expected: self.next, got }
    }

    fn write_batch(&mut self, ends_row_group: bool) -> Result<(), TableError> {
        let made = |table, batch: Result<_, arrow::error::ArrowError>| {
            batch.map_err(|e| TableError::Write { table, message: e.to_string() })
        };
        if !self.grids.1.is_empty() {
            self.attempts.0.write(&made(Table::Attempts, encode::attempts(&self.attempts.1))?)?;
            self.objects.0.write(&made(Table::Objects, encode::objects(&self.objects.1))?)?;
            let resolution = self.info.grid.resolution;
            self.grids.0.write(&made(Table::Scenes, encode::scenes(&self.grids.1, resolution))?)?;
        }
        self.attempts.1.clear();
        self.objects.1.clear();
        self.grids.1.clear();
        if ends_row_group {
            for table in [&mut self.attempts.0, &mut self.objects.0, &mut self.grids.0] {
                table.flush()?;
            }
        }
        Ok(())
    }

    /// Ends the shard: the three files get their names, then the marker is written, which makes the shard count.
    ///
    /// # Errors
    /// [`WriteError`] if scenes are missing, the disk refuses, or the shard was committed before with other bytes.
    pub fn commit(mut self) -> Result<ShardSummary, WriteError> {
        if self.next != self.scenes.end {
            return Err(self.out_of_order("the end".to_owned()));
        }
        let shard = self.shard;
        let in_shard = |source| WriteError::Table { shard, source };
        self.write_batch(false).map_err(in_shard)?;
        let (attempts_file, attempts) = self.attempts.0.finish().map_err(in_shard)?;
        let (objects_file, objects) = self.objects.0.finish().map_err(in_shard)?;
        let (scenes_file, scenes) = self.grids.0.finish().map_err(in_shard)?;
        let dataset_id = self.info.dataset_id();
        let summary = ShardSummary { dataset_id, shard, attempts, scenes, objects, counts: self.counts };
        let marker = layout::marker(shard);
        let text = seal::seal(&summary);
        if let Some(before) = self.store.read(&marker)? {
            compare(shard, &before, &text)?;
        }
        for file in [attempts_file, objects_file, scenes_file] {
            file.publish()?;
        }
        if let Published::Existing(before) = self.store.publish_new(&marker, text.as_bytes())? {
            compare(shard, &before, &text)?;
            self.store.publish(&marker, text.as_bytes())?; // in place of a damaged one
        }
        Ok(summary)
    }
}

/// A marker that is there already must say the same, unless it is damaged and says nothing.
fn compare(shard: u32, before: &[u8], now: &str) -> Result<(), WriteError> {
    let is_damaged = || seal::unseal::<ShardSummary>(&String::from_utf8_lossy(before)).is_err();
    if before == now.as_bytes() || is_damaged() {
        return Ok(());
    }
    let (before, now) = (seal::sha256_hex(before), seal::sha256_hex(now.as_bytes()));
    Err(WriteError::NotReproduced { shard, before, now })
}

/// Whether a shard is there: its marker, of this dataset, and files of the sizes that the marker says.
///
/// # Errors
/// [`StoreError`] if the disk refuses.
pub fn is_committed(dir: &Path, info: &DatasetInfo, shard: u32) -> Result<bool, StoreError> {
    Ok(committed(&Store::new(dir), info, &info.dataset_id(), shard)?.is_some())
}

/// The marker of a committed shard.
pub(crate) fn committed(
    store: &Store,
    info: &DatasetInfo,
    dataset_id: &str,
    shard: u32,
) -> Result<Option<ShardSummary>, StoreError> {
    let Some(bytes) = store.read(&layout::marker(shard))? else { return Ok(None) };
    let Ok(summary) = seal::unseal::<ShardSummary>(&String::from_utf8_lossy(&bytes)) else { return Ok(None) };
    if summary.shard != shard || !summary.problems(info, dataset_id).is_empty() {
        return Ok(None);
    }
    for table in Table::ALL {
        let file = summary.file(table);
        if store.size(&file.path)? != Some(file.bytes) {
            return Ok(None);
        }
    }
    Ok(Some(summary))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Fault;
    use crate::{begin_dataset, synthetic};

    fn info() -> DatasetInfo {
        let mut info = synthetic::info(9, 2, 70, 5);
        info.grid.resolution = 4;
        info
    }

    fn write(store: Store, info: &DatasetInfo) -> Result<ShardSummary, WriteError> {
        let mut writer = ShardWriter::create_in(store, info, 1)?;
        for scene in info.scenes_of(1) {
            writer.push(&synthetic::scene_rows(scene, info.seed, info))?;
        }
        writer.commit()
    }

    #[test]
    fn whichever_operation_fails_the_shard_does_not_count_and_can_be_written_again() {
        let info = info();
        let whole = tempfile::tempdir().unwrap();
        begin_dataset(whole.path(), &info).unwrap();
        let expected = write(Store::new(whole.path()), &info).unwrap();
        for operations in 0..10_000 {
            let dir = tempfile::tempdir().unwrap();
            begin_dataset(dir.path(), &info).unwrap();
            let result = write(Store::faulty(dir.path(), Fault::after(operations)), &info);
            if let Ok(summary) = result {
                assert_eq!(summary, expected);
                assert!(operations > 10, "a shard takes more than {operations} operations");
                return;
            }
            assert_eq!(result.unwrap_err().exit_code(), ExitCode::TryAgain, "after {operations} operations");
            assert!(!is_committed(dir.path(), &info, 1).unwrap(), "after {operations} operations");
            assert_eq!(write(Store::new(dir.path()), &info).unwrap(), expected);
            assert!(is_committed(dir.path(), &info, 1).unwrap());
        }
        panic!("a shard takes fewer than 10,000 operations");
    }
}
