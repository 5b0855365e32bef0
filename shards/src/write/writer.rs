//! Writes a shard: scenes in order, a few at a time, into three files that are committed together.

use std::ops::Range;

use program::{ExitCode, Failure};
use schema::SceneRows;

use crate::format::check;
use crate::format::summary::{Counts, FileSummary, ShardSummary};
use crate::format::{encode, layout, seal};
use crate::store::{Ready, Storage};
use crate::write::table_writer::{TableWriter, unwritten};
use crate::{DatasetInfo, SCENES_PER_ROW_GROUP, Table};

/// Scenes encoded at once; limits a writer's memory to 4 MB of grids.
const SCENES_PER_BATCH: usize = 16;

/// Writes one shard. If dropped before [`ShardWriter::commit`], it leaves no shard.
#[derive(Debug)]
pub struct ShardWriter {
    info: DatasetInfo,
    dataset_id: String,
    storage: Storage,
    shard: u32,
    scenes: Range<u64>,
    next: u64,
    counts: Counts,
    /// In the order of [`Table::ALL`].
    files: [TableWriter; 3],
    /// Scenes that are not encoded yet.
    pending: Vec<SceneRows>,
}

impl ShardWriter {
    pub(crate) fn create(storage: Storage, info: &DatasetInfo, dataset_id: &str, shard: u32) -> Result<Self, Failure> {
        if shard >= info.shard_count {
            let text = format!("shard must be below {}, got {shard}", info.shard_count);
            return Err(Failure::new(ExitCode::Config, text));
        }
        let sizes = [shard, info.shard_count];
        let open = |table| TableWriter::create(&storage, table, sizes, info.form());
        let scenes = info.scenes_of(shard);
        Ok(Self {
            files: [open(Table::Attempts)?, open(Table::Scenes)?, open(Table::Objects)?],
            pending: Vec::new(),
            info: info.clone(),
            dataset_id: dataset_id.to_owned(),
            storage,
            shard,
            next: scenes.start,
            scenes,
            counts: Counts::zero(),
        })
    }

    /// Adds a scene, strictly in the order of scene ids.
    ///
    /// # Errors
    /// [`Failure`] if the scene is not the next one, a row breaks a rule, or the storage fails.
    pub fn push(&mut self, rows: &SceneRows) -> Result<(), Failure> {
        let scene_id = rows.scene.scene_id;
        if scene_id != self.next || !self.scenes.contains(&scene_id) {
            return Err(self.out_of_order(&format!("scene {scene_id}")));
        }
        check::scene_rows(rows, &self.info).map_err(|rule| {
            let text = format!("shard {}, scene {scene_id}: {rule}", self.shard);
            Failure::new(ExitCode::Internal, text)
        })?;
        self.counts.count(rows);
        self.pending.push(rows.clone());
        self.next += 1;
        let ends_row_group = (self.next - self.scenes.start).is_multiple_of(SCENES_PER_ROW_GROUP);
        if ends_row_group || self.pending.len() >= SCENES_PER_BATCH {
            self.write_batch(ends_row_group)?;
        }
        Ok(())
    }

    fn out_of_order(&self, got: &str) -> Failure {
        let Self { shard, scenes: Range { start, end }, next, .. } = self;
        let text = format!("shard {shard} must go on with scene {next} of {start}..{end}, got {got}");
        Failure::new(ExitCode::Internal, text)
    }

    fn write_batch(&mut self, ends_row_group: bool) -> Result<(), Failure> {
        for (table, file) in Table::ALL.into_iter().zip(&mut self.files) {
            if !self.pending.is_empty() {
                let batch = encode::batch(table, &self.pending, &self.info);
                file.write(&batch.map_err(|e| unwritten(table, &e))?)?;
            }
            if ends_row_group {
                file.flush()?;
            }
        }
        self.pending.clear();
        Ok(())
    }

    /// Commits the shard: the three files are published, then the marker, with which the shard exists. Existing files
    /// are compared, not replaced, because all writers of a shard write the same bytes.
    ///
    /// # Errors
    /// [`Failure`] if scenes are missing, the storage fails, or the shard exists with other bytes.
    pub fn commit(self) -> Result<ShardSummary, Failure> {
        if self.next != self.scenes.end {
            return Err(self.out_of_order("the end"));
        }
        let (storage, files, summary) = self.finish()?;
        let shard = summary.shard;
        let marker = layout::marker(shard);
        let text = seal::seal(&summary);
        // The folder may have been emptied and another dataset begun in it in the meantime.
        storage.check_in_place(&summary.dataset_id)?;
        // An equal marker proves our bytes: any other existing file is damaged.
        let is_proven = match storage.read(&marker)? {
            Some(before) => compare(shard, &marker, &before, &text)?,
            None => false,
        };
        for (table, file) in Table::ALL.into_iter().zip(files) {
            publish(&storage, shard, file, summary.file(table), is_proven)?;
        }
        storage.check_in_place(&summary.dataset_id)?;
        if let Some(before) = storage.publish_new(&marker, text.as_bytes())?
            && !compare(shard, &marker, &before, &text)?
        {
            storage.publish(&marker, text.as_bytes())?; // replaces a damaged one
        }
        Ok(summary)
    }

    /// Writes the footers. Returns the files, complete but not published yet, where they lie, and what the marker says
    /// of them.
    fn finish(mut self) -> Result<(Storage, [Ready; 3], ShardSummary), Failure> {
        self.write_batch(false)?;
        let Self { storage, dataset_id, shard, counts, files: [attempts, scenes, objects], .. } = self;
        let [(first, attempts), (second, scenes), (third, objects)] =
            [attempts.finish()?, scenes.finish()?, objects.finish()?];
        let summary = ShardSummary { dataset_id, shard, attempts, scenes, objects, counts };
        Ok((storage, [first, second, third], summary))
    }
}

/// Publishes a file, or finds an equal one. A different one is replaced only if ours is proven to be correct.
fn publish(storage: &Storage, shard: u32, file: Ready, summary: &FileSummary, is_proven: bool) -> Result<(), Failure> {
    let before = if is_proven { storage.digest(&summary.path)? } else { None };
    if before.is_some_and(|before| before != summary.sha256) {
        return file.publish();
    }
    if file.publish_new()? {
        return Ok(());
    }
    let before = storage.digest(&summary.path)?.ok_or_else(|| storage.vanished(&summary.path))?;
    if before == summary.sha256 {
        return Ok(());
    }
    Err(not_reproduced(shard, &summary.path, &before, &summary.sha256))
}

/// Whether an existing marker is equal; false if it is damaged.
fn compare(shard: u32, marker: &str, before: &[u8], now: &str) -> Result<bool, Failure> {
    if before == now.as_bytes() {
        return Ok(true);
    }
    if seal::unseal::<ShardSummary>(before.to_vec()).is_err() {
        return Ok(false);
    }
    let (before, now) = (seal::sha256_hex(before), seal::sha256_hex(now.as_bytes()));
    Err(not_reproduced(shard, marker, &before, &now))
}

/// The error of a shard that exists with other bytes.
fn not_reproduced(shard: u32, file: &str, before: &str, now: &str) -> Failure {
    let text = format!(
        "shard {shard} came out differently from before, {file} has SHA-256 {before} there and {now} now: is the code \
         or the machine another? If the file is damaged, delete it and run again"
    );
    Failure::new(ExitCode::Data, text)
}

#[cfg(test)]
mod tests {

    use super::*;
    use crate::Draft;
    use crate::store::{Fault, Kind, Store};
    use crate::synthetic;
    use std::path::Path;
    use std::process::{Command, Stdio};

    fn info() -> DatasetInfo {
        let mut info = synthetic::info(9, 2, 70, 5);
        info.grid.resolution = 4;
        info
    }

    fn write(dir: &Path, fault: Fault) -> Result<ShardSummary, Failure> {
        let draft = Draft::begin(dir, &info()).unwrap();
        let draft = Draft { storage: Storage::Folder(Store::faulty(dir, fault)), ..draft };
        let mut writer = draft.shard(1)?;
        for scene in draft.info.scenes_of(1) {
            writer.push(&synthetic::scene_rows(scene, draft.info.seed, &draft.info))?;
        }
        writer.commit()
    }

    fn is_committed(dir: &Path) -> bool {
        Draft::open(dir).unwrap().is_committed(1).unwrap()
    }

    /// A shard exists only if it is complete, at whatever operation its writer stopped.
    fn check_stopped(dir: &Path, expected: &ShardSummary, when: u64) {
        let storage = Storage::Folder(Store::new(dir));
        for file in Table::ALL.map(|table| expected.file(table)) {
            let found = storage.digest(&file.path).unwrap();
            assert!(found.is_none_or(|found| found == file.sha256), "half a file after {when} operations");
        }
        let marker = storage.read(&layout::marker(1)).unwrap();
        assert_eq!(is_committed(dir), marker.is_some(), "after {when} operations");
        assert_eq!(&write(dir, Fault::default()).unwrap(), expected);
        assert!(is_committed(dir));
    }

    #[test]
    fn whichever_operation_fails_the_shard_does_not_count_and_can_be_written_again() {
        let whole = tempfile::tempdir().unwrap();
        let expected = write(whole.path(), Fault::default()).unwrap();
        for operations in 0..10_000 {
            let dir = tempfile::tempdir().unwrap();
            let result = write(dir.path(), Fault::after(operations, Kind::Fail));
            if let Ok(summary) = result {
                assert_eq!(summary, expected);
                assert!(operations > 10, "a shard takes more than {operations} operations");
                return;
            }
            assert_eq!(result.unwrap_err().exit_code(), ExitCode::TryAgain, "after {operations} operations");
            check_stopped(dir.path(), &expected, operations);
        }
        panic!("a shard takes fewer than 10,000 operations");
    }

    const KILLED_DIR: &str = "SHARDS_TEST_KILLED_AT_DIR";
    const KILLED_AT: &str = "SHARDS_TEST_KILLED_AT";

    /// Not a test of its own: the writer that is killed.
    #[test]
    fn killed_child() {
        if let (Ok(dir), Ok(at)) = (std::env::var(KILLED_DIR), std::env::var(KILLED_AT)) {
            let fault = Fault::after(at.parse().unwrap(), Kind::Kill);
            write(Path::new(&dir), fault).unwrap();
        }
    }

    #[test]
    fn whichever_operation_it_is_killed_at_the_next_writer_ends_with_the_same_bytes() {
        let whole = tempfile::tempdir().unwrap();
        let expected = write(whole.path(), Fault::default()).unwrap();
        let (_, module) = module_path!().split_once("::").unwrap(); // without the crate's name
        for operations in 0..10_000 {
            let dir = tempfile::tempdir().unwrap();
            let killed = Command::new(std::env::current_exe().unwrap())
                .args(["--exact", &format!("{module}::killed_child")])
                .env(KILLED_DIR, dir.path())
                .env(KILLED_AT, operations.to_string())
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .status()
                .unwrap();
            if killed.success() {
                assert!(operations > 10 && is_committed(dir.path()), "killed {operations} times");
                return;
            }
            check_stopped(dir.path(), &expected, operations);
        }
        panic!("a shard takes fewer than 10,000 operations");
    }

    #[test]
    fn a_file_without_a_marker_is_compared_and_kept() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(layout::table_file(Table::Objects, 1, 2));
        write(dir.path(), Fault::default()).unwrap();
        std::fs::remove_file(dir.path().join(layout::marker(1))).unwrap();
        write(dir.path(), Fault::default()).unwrap();
        std::fs::remove_file(dir.path().join(layout::marker(1))).unwrap();
        std::fs::write(&path, "of another writer").unwrap();
        let error = write(dir.path(), Fault::default()).unwrap_err();
        assert_eq!(error.exit_code(), ExitCode::Data);
        let there = seal::sha256_hex(b"of another writer");
        assert!(
            error.to_string().contains(&format!("objects/shard-00001-of-00002.parquet has SHA-256 {there}")),
            "{error}"
        );
        assert_eq!(std::fs::read(&path).unwrap(), b"of another writer");
    }
}
