//! Reading a dataset: open it by its manifest, check each file's size and checksum before its first byte is decoded,
//! and each row after.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use arrow::array::RecordBatch;
use schema::{AttemptRecord, ObjectRecord, SceneRows};

use crate::check::{self, RowError};
use crate::store::{Store, StoreError};
use crate::summary::Manifest;
use crate::table_reader::{Batches, Part, hash};
use crate::{DatasetInfo, InfoError, ReadError, SCENES_PER_ROW_GROUP, Scenes, Table, decode, layout, seal};

/// A complete dataset on disk. Cheap to hold: rows are read when asked for.
#[derive(Debug)]
pub struct Dataset {
    dir: PathBuf,
    store: Store,
    info: DatasetInfo,
    manifest: Manifest,
    /// Whether a file's checksum was found right, by shard, in the order of [`Table::ALL`].
    is_checked: Vec<[AtomicBool; 3]>,
}

/// Rows of a batch of small rows.
const BATCH_ROWS: usize = 8192;
/// Scenes decoded at once: half a megabyte each while they are being decoded.
const BATCH_SCENES: usize = 8;

/// Reads and checks `meta/info.json`; the info and the dataset's id.
pub(crate) fn read_info(store: &Store, dir: &Path) -> Result<(DatasetInfo, String), ReadError> {
    let bytes = store.read(layout::INFO)?.ok_or_else(|| ReadError::NotADataset(dir.to_owned()))?;
    let wrong = |source| ReadError::Info { source, path: store.path(layout::INFO) };
    let text = std::str::from_utf8(&bytes).map_err(|e| wrong(InfoError::Parse(e.to_string())))?;
    let info = DatasetInfo::from_json(text).map_err(wrong)?;
    Ok((info, seal::sha256_hex(&bytes)))
}

impl Dataset {
    /// Opens a dataset. Reads only `meta/`, and looks at the size of every file.
    ///
    /// # Errors
    /// [`ReadError`] if there is no dataset, it is incomplete, of an unknown version, or damaged as far as that can be
    /// seen without reading the shards.
    pub fn open(dir: &Path) -> Result<Self, ReadError> {
        let dataset = Self::open_with_any_files(dir)?;
        for shard in 0..dataset.shard_count() {
            for table in Table::ALL {
                dataset.check_size(shard, table)?;
            }
        }
        Ok(dataset)
    }

    /// Opens a dataset without a look at its shards, so that each can be told what is wrong with it.
    pub(crate) fn open_with_any_files(dir: &Path) -> Result<Self, ReadError> {
        let store = Store::new(dir);
        let (info, dataset_id) = read_info(&store, dir)?;
        let bytes = store.read(layout::MANIFEST)?.ok_or_else(|| ReadError::Incomplete(dir.to_owned()))?;
        let path = store.path(layout::MANIFEST);
        let manifest: Manifest = seal::unseal(&String::from_utf8_lossy(&bytes))
            .map_err(|e| ReadError::Manifest { problems: vec![e.to_string()], path: path.clone() })?;
        let problems = manifest.problems(&info, &dataset_id);
        if !problems.is_empty() {
            return Err(ReadError::Manifest { problems, path });
        }
        let is_checked = manifest.shards.iter().map(|_| Default::default()).collect();
        Ok(Self { dir: dir.to_owned(), store, info, manifest, is_checked })
    }

    /// The folder.
    #[must_use]
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// What the dataset is.
    #[must_use]
    pub fn info(&self) -> &DatasetInfo {
        &self.info
    }

    /// What the dataset holds.
    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Shards.
    #[must_use]
    pub fn shard_count(&self) -> u32 {
        self.info.shard_count
    }

    /// Compares size and SHA-256 of the shard's three files with the manifest. Each file is read once in the life of
    /// this value; the reading functions do it by themselves.
    ///
    /// # Errors
    /// [`ReadError::File`] for the first file that differs.
    pub fn verify_shard_bytes(&self, shard: u32) -> Result<(), ReadError> {
        self.known(shard)?;
        Table::ALL.into_iter().try_for_each(|table| self.open_file(shard, table).map(drop))
    }

    /// All attempts of a shard, in order.
    ///
    /// # Errors
    /// [`ReadError`] if the file is damaged or a row breaks a rule.
    pub fn read_attempts(&self, shard: u32) -> Result<Vec<AttemptRecord>, ReadError> {
        let part = Part { batch_rows: BATCH_ROWS, ..Part::default() };
        let rows = self.read(shard, Table::Attempts, part, decode::attempts)?;
        let scenes = self.info.scenes_of(shard);
        let expected = scenes.flat_map(|s| (0..self.info.attempts_of_scene(s)).map(move |a| (s, a)));
        self.check(shard, Table::Attempts, || {
            rows.iter().try_for_each(|row| check::attempt(row, &self.info.gripper))?;
            let found = rows.iter().map(|r| (r.scene_id, r.attempt_id));
            found
                .eq(expected)
                .then_some(())
                .ok_or_else(|| RowError("attempt ids must count up in every scene".to_owned()))
        })?;
        Ok(rows)
    }

    /// All objects of a shard, in order.
    ///
    /// # Errors
    /// [`ReadError`] if the file is damaged or a row breaks a rule.
    pub fn read_objects(&self, shard: u32) -> Result<Vec<ObjectRecord>, ReadError> {
        let part = Part { batch_rows: BATCH_ROWS, ..Part::default() };
        let rows = self.read(shard, Table::Objects, part, decode::objects)?;
        self.check(shard, Table::Objects, || {
            rows.iter().try_for_each(check::object)?;
            object_ids(&rows, self.info.scenes_of(shard), self.manifest.shards[shard as usize].objects.rows)
        })?;
        Ok(rows)
    }

    /// The scenes of a shard one by one; a few grids at a time are in memory.
    ///
    /// # Errors
    /// [`ReadError`] if the file is damaged; each item is an error if a row breaks a rule.
    pub fn scenes(&self, shard: u32) -> Result<Scenes<'_>, ReadError> {
        self.scenes_with(shard, None)
    }

    /// As [`Self::scenes`] but without the grids: `tsdf` is empty. Reads a thousandth of the bytes.
    ///
    /// # Errors
    /// [`ReadError`] if the file is damaged; each item is an error if a row breaks a rule.
    pub fn scene_heads(&self, shard: u32) -> Result<Scenes<'_>, ReadError> {
        self.scenes_with(shard, Some("tsdf"))
    }

    fn scenes_with(&self, shard: u32, without: Option<&'static str>) -> Result<Scenes<'_>, ReadError> {
        let part = Part { batch_rows: BATCH_SCENES, without, ..Part::default() };
        let batches = self.batches(shard, Table::Scenes, part)?;
        Ok(Scenes::new(self, shard, batches, without.is_none()))
    }

    /// All rows of one scene. Reads one row group of the small tables and a few pages of the grids.
    ///
    /// # Errors
    /// [`ReadError`] if there is no such scene, a file is damaged, or a row breaks a rule.
    pub fn read_scene(&self, scene_id: u64) -> Result<SceneRows, ReadError> {
        let out_of_range = ReadError::OutOfRange { what: "scene", limit: self.info.scene_count, got: scene_id };
        let shard = self.info.shard_of(scene_id).ok_or(out_of_range)?;
        let place = scene_id - self.info.scenes_of(shard).start;
        let in_group = (place % SCENES_PER_ROW_GROUP) as usize; // below 256
        let group = usize::try_from(place / SCENES_PER_ROW_GROUP).ok();
        let attempts = self.info.attempts_of_scene(scene_id) as usize;
        let part = Part { row_group: group, batch_rows: BATCH_ROWS, ..Part::default() };
        let one = Part { offset: in_group, limit: Some(1), batch_rows: 1, ..part };
        let of_scene = Part { offset: in_group * self.info.attempts_per_scene as usize, limit: Some(attempts), ..part };
        let mut objects = self.read(shard, Table::Objects, part, decode::objects)?;
        objects.retain(|object| object.scene_id == scene_id);
        let attempts = self.read(shard, Table::Attempts, of_scene, decode::attempts)?;
        let scene = self.read(shard, Table::Scenes, one, decode::scenes)?.into_iter().find(|s| s.scene_id == scene_id);
        let missing = || self.wrong(shard, Table::Scenes, format!("scene {scene_id} is not where it should be"));
        let rows = SceneRows { scene: scene.ok_or_else(missing)?, objects, attempts };
        self.check(shard, Table::Attempts, || check::scene_rows(&rows, &self.info))?;
        Ok(rows)
    }

    /// A file of `meta/`, `None` if there is none.
    pub(crate) fn read_meta(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        self.store.read(name)
    }

    fn known(&self, shard: u32) -> Result<std::ops::Range<u64>, ReadError> {
        if shard < self.shard_count() {
            return Ok(self.info.scenes_of(shard));
        }
        Err(ReadError::OutOfRange { what: "shard", limit: u64::from(self.shard_count()), got: u64::from(shard) })
    }

    fn read<R>(
        &self,
        shard: u32,
        table: Table,
        part: Part,
        decode: fn(&RecordBatch) -> Result<Vec<R>, RowError>,
    ) -> Result<Vec<R>, ReadError> {
        let mut rows = Vec::new();
        for batch in self.batches(shard, table, part)? {
            let batch = batch.map_err(|message| self.wrong(shard, table, message))?;
            rows.extend(decode(&batch).map_err(|e| self.wrong(shard, table, e.to_string()))?);
        }
        Ok(rows)
    }

    fn batches(&self, shard: u32, table: Table, part: Part) -> Result<Batches, ReadError> {
        self.known(shard)?;
        let file = self.open_file(shard, table)?;
        Batches::open(file, table, self.info.grid.resolution, part).map_err(|m| self.wrong(shard, table, m))
    }

    /// Opens a file, and the first time compares its checksum.
    fn open_file(&self, shard: u32, table: Table) -> Result<File, ReadError> {
        let path = self.check_size(shard, table)?;
        let io = |action, source| StoreError { action, path: path.clone(), source };
        let mut file = File::open(&path).map_err(|e| io("open a file", e))?;
        let is_checked = &self.is_checked[shard as usize][table as usize];
        if !is_checked.load(Ordering::Acquire) {
            let expected = &self.manifest.shards[shard as usize].file(table).sha256;
            let found = hash(&mut file).map_err(|e| io("read a file", e))?;
            if found != *expected {
                return Err(self.wrong(shard, table, format!("sha256 must be {expected}, got {found}")));
            }
            is_checked.store(true, Ordering::Release);
        }
        Ok(file)
    }

    fn check_size(&self, shard: u32, table: Table) -> Result<PathBuf, ReadError> {
        let file = self.manifest.shards[shard as usize].file(table);
        match self.store.size(&file.path)? {
            Some(bytes) if bytes == file.bytes => Ok(self.path(shard, table)),
            Some(bytes) => Err(self.wrong(shard, table, format!("size must be {} bytes, got {bytes}", file.bytes))),
            None => Err(self.wrong(shard, table, "the file is missing".to_owned())),
        }
    }

    fn path(&self, shard: u32, table: Table) -> PathBuf {
        self.store.path(&layout::table_file(table, shard, self.info.shard_count))
    }

    pub(crate) fn wrong(&self, shard: u32, table: Table, message: String) -> ReadError {
        ReadError::File { shard, message, path: self.path(shard, table) }
    }

    fn check(&self, shard: u32, table: Table, rule: impl FnOnce() -> Result<(), RowError>) -> Result<(), ReadError> {
        rule().map_err(|e| self.wrong(shard, table, e.to_string()))
    }
}

/// Objects must number from 0 in every scene of the shard, and every scene must have one.
fn object_ids(rows: &[ObjectRecord], scenes: std::ops::Range<u64>, expected: u64) -> Result<(), RowError> {
    let wrong = |message: String| Err(RowError(message));
    if rows.len() as u64 != expected {
        return wrong(format!("objects must have {expected} rows, got {}", rows.len()));
    }
    let mut next = scenes.start;
    let mut count = 0;
    for row in rows {
        if row.object_id == 0 && row.scene_id == next {
            next += 1;
            count = 0;
        }
        if row.scene_id + 1 != next || row.object_id != count {
            return wrong(format!(
                "object ids must count up in every scene, got scene {} object {}",
                row.scene_id, row.object_id
            ));
        }
        count += 1;
    }
    if next == scenes.end { Ok(()) } else { wrong(format!("scene {next} has no objects")) }
}
