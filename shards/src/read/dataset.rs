//! Reading a dataset: it is opened by its manifest; each file's size and checksum are checked before it is decoded, and
//! each row afterwards.

use std::fs::File;
use std::iter::{Peekable, from_fn};
use std::ops::Range;
use std::sync::atomic::AtomicBool;

use arrow::RecordBatch;
use program::{ExitCode, Failure};
use schema::{AttemptRecord, ObjectRecord, SceneRecord, SceneRows};

use crate::format::check;
use crate::format::frame::Expected;
use crate::format::summary::Manifest;
use crate::format::{decode, layout, seal};
use crate::read::table_reader::{Batches, Part, undecoded};
use crate::store::{Patience, Storage, size_in, size_problem};
use crate::{DatasetInfo, Location, Table};

/// A complete dataset, on disk or in an object store. Rows are read on request.
#[derive(Debug)]
pub struct Dataset {
    pub(crate) storage: Storage,
    info: DatasetInfo,
    manifest: Manifest,
    /// Whether a file's checksum was verified, by shard, in the order of [`Table::ALL`].
    is_checked: Vec<[AtomicBool; 3]>,
}

/// Rows per batch of the small tables.
const BATCH_ROWS: usize = 8192;
/// Scenes decoded at once; each takes half a megabyte during decoding.
const BATCH_SCENES: usize = 8;

/// Reads and checks `meta/info.json`; returns the info and the dataset's id.
pub(crate) fn read_info(storage: &Storage) -> Result<(DatasetInfo, String), Failure> {
    let none = || {
        let text = format!("no dataset here, there is no {}: {}", layout::INFO, storage.location(""));
        Failure::new(ExitCode::Config, text)
    };
    let bytes = storage.read(layout::INFO)?.ok_or_else(none)?;
    let info = DatasetInfo::from_json(&bytes).map_err(|wrong| {
        let text = format!("{wrong}: {}", storage.location(layout::INFO));
        Failure::new(ExitCode::Data, text)
    })?;
    Ok((info, seal::sha256_hex(&bytes)))
}

impl Dataset {
    /// Opens a dataset. Reads only `meta/` and checks the size of every file. Web servers do not support listing; there
    /// a size is checked when the file is read.
    ///
    /// # Errors
    /// [`Failure`] if there is no dataset, or it is incomplete, has an unknown version, or is visibly damaged without
    /// reading the shards.
    pub fn open(at: impl Into<Location>) -> Result<Self, Failure> {
        let dataset = Self::of_storage(Storage::open(&at.into(), Patience::Reader)?)?;
        dataset.look_at_sizes()?;
        Ok(dataset)
    }

    pub(crate) fn look_at_sizes(&self) -> Result<(), Failure> {
        let mut listings = Vec::new();
        for table in Table::ALL {
            listings.push((table, self.storage.list(table.name())?));
        }
        for shard in 0..self.shard_count() {
            for (table, listing) in &listings {
                let Some(listing) = listing else { continue };
                let expected = self.manifest.shards[shard as usize].file(*table);
                if let Some(problem) = size_problem(expected, size_in(listing, &expected.path)) {
                    return Err(self.wrong(shard, *table, &problem));
                }
            }
        }
        Ok(())
    }

    /// Opens a dataset without checking its shards, so that faults can be reported for each shard.
    pub(crate) fn of_storage(storage: Storage) -> Result<Self, Failure> {
        let (info, dataset_id) = read_info(&storage)?;
        let none = || {
            let name = layout::MANIFEST;
            let text = format!("the dataset is not complete, there is no {name}: run the missing shards and finalize");
            Failure::new(ExitCode::Incomplete, format!("{text}: {}", storage.location("")))
        };
        let bytes = storage.read(layout::MANIFEST)?.ok_or_else(none)?;
        let wrong = |text: &str| {
            let text = format!("{text}: {}", storage.location(layout::MANIFEST));
            Failure::new(ExitCode::Data, text)
        };
        let manifest: Manifest = seal::unseal(bytes).map_err(|e| wrong(&e))?;
        let problems = manifest.problems(&info, &dataset_id);
        if !problems.is_empty() {
            return Err(wrong(&problems.join("; ")));
        }
        let is_checked = manifest.shards.iter().map(|_| Default::default()).collect();
        Ok(Self { storage, info, manifest, is_checked })
    }

    /// Its location.
    #[must_use]
    pub fn location(&self) -> Location {
        self.storage.location("")
    }

    /// Its id: the SHA-256 of its `meta/info.json` in hex.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.manifest.dataset_id
    }

    /// Whether an id is this dataset's. Up to 0.2 the trainer used the id of the parsed info, in which numbers of the
    /// config may differ in their last digit; such checkpoints are still accepted.
    #[must_use]
    pub fn has_id(&self, id: &str) -> bool {
        id == self.id() || id == self.info.dataset_id()
    }

    /// The dataset's info.
    #[must_use]
    pub fn info(&self) -> &DatasetInfo {
        &self.info
    }

    /// The dataset's manifest.
    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Shards.
    #[must_use]
    pub fn shard_count(&self) -> u32 {
        self.info.shard_count
    }

    /// The attempts of a shard, or those of some of its scenes.
    fn attempts(
        &self,
        shard: u32,
        wanted: Option<&[u64]>,
    ) -> Result<impl Iterator<Item = Result<AttemptRecord, Failure>> + use<'_>, Failure> {
        let scenes = self.scenes_of(shard)?;
        let rows_of = |scene: &u64| {
            let first = (scene - scenes.start) as usize * self.info.attempts_per_scene as usize;
            first..first + self.info.attempts_of_scene(*scene) as usize
        };
        let rows = wanted.map(|wanted| wanted.iter().flat_map(rows_of).collect::<Vec<_>>());
        let part = Part { batch_rows: BATCH_ROWS, rows: rows.as_deref(), ..Part::default() };
        let wanted = wanted.map_or_else(|| scenes.clone().collect(), <[u64]>::to_vec);
        let of_scene = |scene| (0..self.info.attempts_of_scene(scene)).map(move |id| (scene, id));
        let mut ids = wanted.into_iter().flat_map(of_scene);
        let check = move |row: Option<&AttemptRecord>| {
            row.map_or(Ok(()), |row| check::attempt(row, self.info.gripper_of(row.scene_id)))?;
            let is_next = row.map(|row| (row.scene_id, row.attempt_id)) == ids.next();
            if is_next { Ok(()) } else { Err("attempt ids must count up in every scene".to_owned()) }
        };
        self.checked(shard, Table::Attempts, part, |batch| decode::attempts(batch, &self.info), check)
    }

    fn objects(&self, shard: u32) -> Result<impl Iterator<Item = Result<ObjectRecord, Failure>>, Failure> {
        let part = Part { batch_rows: BATCH_ROWS, ..Part::default() };
        let scenes = self.scenes_of(shard)?;
        let (mut next_scene, mut next_id) = (scenes.start, 0);
        let check = move |row: Option<&ObjectRecord>| {
            let Some(row) = row else {
                let is_over = next_scene == scenes.end;
                return if is_over { Ok(()) } else { Err(format!("scene {next_scene} has no objects")) };
            };
            check::object(row)?;
            if (row.scene_id, row.object_id) == (next_scene, 0) {
                (next_scene, next_id) = (next_scene + 1, 0);
            }
            if row.scene_id + 1 != next_scene || row.object_id != next_id {
                let (scene, object) = (row.scene_id, row.object_id);
                return Err(format!("object ids must count up in every scene, got scene {scene} object {object}"));
            }
            next_id += 1;
            Ok(())
        };
        self.checked(shard, Table::Objects, part, |batch| decode::objects(batch, &self.info.models), check)
    }

    /// Some scenes of a shard. `wanted` has their ids, ascending; no other grid is read. A few grids at a time are in
    /// memory, and each file is opened once.
    ///
    /// # Errors
    /// [`Failure`] if a file is damaged; each item is an error if a row breaks a rule.
    ///
    /// # Panics
    /// If a scene is not in the shard.
    pub fn some_scenes(
        &self,
        shard: u32,
        wanted: Vec<u64>,
    ) -> Result<impl Iterator<Item = Result<SceneRows, Failure>>, Failure> {
        let all = self.scenes_of(shard)?;
        assert!(wanted.iter().all(|scene| all.contains(scene)), "scenes of shard {shard} are {all:?}");
        let wanted = Some(wanted).filter(|wanted| (wanted.len() as u64) < all.end - all.start);
        let attempts = self.attempts(shard, wanted.as_deref())?;
        self.joined(shard, self.scenes_with(shard, None, wanted)?, attempts)
    }

    /// The attempts of a shard, a scene at a time.
    ///
    /// # Errors
    /// [`Failure`] if the file is damaged; each item is an error if a row breaks a rule.
    pub fn attempts_by_scene(
        &self,
        shard: u32,
    ) -> Result<impl Iterator<Item = Result<Vec<AttemptRecord>, Failure>>, Failure> {
        let mut attempts = self.attempts(shard, None)?.peekable();
        Ok(self.scenes_of(shard)?.map(move |scene| take_while_is(&mut attempts, |row| row.scene_id == scene)))
    }

    fn scenes_with(
        &self,
        shard: u32,
        without: Option<&'static str>,
        wanted: Option<Vec<u64>>,
    ) -> Result<impl Iterator<Item = Result<SceneRecord, Failure>>, Failure> {
        let scenes = self.scenes_of(shard)?;
        let rows = wanted.as_ref().map(|ids| ids.iter().map(|id| (id - scenes.start) as usize).collect::<Vec<_>>());
        let part = Part { batch_rows: BATCH_SCENES, without, rows: rows.as_deref() };
        let mut ids = wanted.unwrap_or_else(|| scenes.collect()).into_iter();
        let check = move |scene: Option<&SceneRecord>| match (ids.next(), scene) {
            (None, None) => Ok(()),
            (Some(expected), None) => Err(format!("scene {expected} is missing")),
            (expected, Some(scene)) if expected == Some(scene.scene_id) => {
                let grid = if without.is_none() { check::tsdf(&scene.tsdf, &self.info) } else { Ok(()) };
                check::scene_head(scene, &self.info).and(grid).map_err(|e| format!("scene {}: {e}", scene.scene_id))
            }
            (expected, Some(scene)) => {
                Err(format!("scene ids must count up: expected {expected:?}, got {}", scene.scene_id))
            }
        };
        self.checked(shard, Table::Scenes, part, |batch| decode::scenes(batch, &self.info), check)
    }

    pub(crate) fn scenes_of(&self, shard: u32) -> Result<Range<u64>, Failure> {
        let no_such = || out_of_range("shard", self.shard_count().into(), shard.into());
        if shard < self.shard_count() { Ok(self.info.scenes_of(shard)) } else { Err(no_such()) }
    }

    /// The rows of a table, decoded a batch at a time; none after an error. `check` sees each row, then the end.
    fn checked<'a, R, D, C>(
        &'a self,
        shard: u32,
        table: Table,
        part: Part<'_>,
        decode: D,
        mut check: C,
    ) -> Result<impl Iterator<Item = Result<R, Failure>> + use<'a, R, D, C>, Failure>
    where
        D: Fn(&RecordBatch) -> Result<Vec<R>, String>,
        C: FnMut(Option<&R>) -> Result<(), String>,
    {
        let mut batches = self.batches(shard, table, part)?;
        let mut decoded = Vec::new().into_iter();
        let mut next = move || {
            loop {
                if let Some(row) = decoded.next() {
                    return check(Some(&row)).map(|()| Some(row));
                }
                match batches.next() {
                    Some(batch) => decoded = decode(&batch?)?.into_iter(),
                    None => return check(None).map(|()| None),
                }
            }
        };
        let mut is_over = false;
        Ok(from_fn(move || {
            if is_over {
                return None;
            }
            let found = next();
            is_over = !matches!(found, Ok(Some(_)));
            found.map_err(|message| self.wrong(shard, table, &message)).transpose()
        }))
    }

    /// Iterates over all rows of a shard, a scene at a time. The rows of a scene fit together. Without the grids `tsdf`
    /// is empty, and few bytes are read.
    ///
    /// # Errors
    /// [`Failure`] if a file is damaged; each item is an error if a row breaks a rule.
    pub fn rows(&self, shard: u32, grids: bool) -> Result<impl Iterator<Item = Result<SceneRows, Failure>>, Failure> {
        let scenes = self.scenes_with(shard, (!grids).then_some("tsdf"), None)?;
        Ok(self.joined(shard, scenes, self.attempts(shard, None)?)?.map(move |rows| {
            let rows = rows?;
            check::links(&rows.scene, &rows.objects, &rows.attempts)
                .map_err(|e| self.wrong(shard, Table::Attempts, &format!("scene {}: {e}", rows.scene.scene_id)))?;
            Ok(rows)
        }))
    }

    /// Adds to each of some scenes of a shard its objects and its attempts, which are in the same order. Whether they
    /// fit together is not checked.
    fn joined(
        &self,
        shard: u32,
        scenes: impl Iterator<Item = Result<SceneRecord, Failure>>,
        attempts: impl Iterator<Item = Result<AttemptRecord, Failure>>,
    ) -> Result<impl Iterator<Item = Result<SceneRows, Failure>>, Failure> {
        let (mut objects, mut attempts) = (self.objects(shard)?.peekable(), attempts.peekable());
        Ok(scenes.map(move |scene| {
            let scene = scene?;
            let id = scene.scene_id;
            while objects.next_if(|row| row.as_ref().is_ok_and(|row| row.scene_id < id)).is_some() {}
            let objects = take_while_is(&mut objects, |row| row.scene_id == id)?;
            let attempts = take_while_is(&mut attempts, |row| row.scene_id == id)?;
            Ok(SceneRows { scene, objects, attempts })
        }))
    }

    /// All rows of one scene.
    ///
    /// # Errors
    /// [`Failure`] if there is no such scene, a file is damaged, or a row breaks a rule.
    pub fn read_scene(&self, scene_id: u64) -> Result<SceneRows, Failure> {
        let no_such = || out_of_range("scene", self.info.scene_count, scene_id);
        let shard = self.info.shard_of(scene_id).ok_or_else(no_such)?;
        let missing = || Err(self.wrong(shard, Table::Scenes, &format!("scene {scene_id} is missing")));
        let rows = self.some_scenes(shard, vec![scene_id])?.next().unwrap_or_else(missing)?;
        check::scene_rows(&rows, &self.info).map_err(|e| self.wrong(shard, Table::Attempts, &e))?;
        Ok(rows)
    }

    pub(crate) fn batches(&self, shard: u32, table: Table, part: Part<'_>) -> Result<Batches, Failure> {
        let file = self.open_file(shard, table)?;
        let rows = self.manifest.shards[shard as usize].file(table).rows;
        let expected = Expected { table, form: self.info.form(), rows };
        Batches::open(file, expected, part).map_err(|m| self.wrong(shard, table, &m))
    }

    /// Opens a file after checking its size and checksum.
    fn open_file(&self, shard: u32, table: Table) -> Result<File, Failure> {
        let summary = &self.manifest.shards[shard as usize];
        let is_checked = &self.is_checked[shard as usize][table as usize];
        let opened = self.storage.open_file(summary.file(table), is_checked)?;
        opened.map_err(|message| self.wrong(shard, table, &message))
    }

    fn wrong(&self, shard: u32, table: Table, message: &str) -> Failure {
        let at = self.storage.location(&layout::table_file(table, shard, self.info.shard_count));
        undecoded(format!("shard {shard}: {message}: {at}"))
    }
}

/// The failure to find the number of something that there is not, such as a scene.
fn out_of_range(what: &str, limit: u64, got: u64) -> Failure {
    Failure::new(ExitCode::Config, format!("{what} must be below {limit}, got {got}"))
}

/// The next rows for which a condition holds.
fn take_while_is<R, E>(
    rows: &mut Peekable<impl Iterator<Item = Result<R, E>>>,
    holds: impl Fn(&R) -> bool,
) -> Result<Vec<R>, E> {
    from_fn(|| rows.next_if(|row| row.as_ref().map_or(true, &holds))).collect()
}
