//! The folder of an export: begun for one dataset and format, then filled with complete files.
//!
//! `export-begun.json` identifies the export while files are written. Each file is renamed when complete, so an
//! interrupted export continues with the missing files. `export.json` is written last and describes the export.

use std::path::Path;

use program::{ExitCode, Failure};
use serde::{Deserialize, Serialize};

use super::ExportFormat;
use crate::format::seal::pretty;
use crate::store::{Storage, Sweep, Swept, failed, is_staging};
use crate::{Dataset, Location};

/// The file that describes a complete export.
const DONE: &str = "export.json";
/// The file that identifies an incomplete export.
const BEGUN: &str = "export-begun.json";

/// The identity of an export: equal for equal bytes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExportOrigin {
    /// The format's name.
    pub format: String,
    /// Version of the exporting code.
    pub exporter_version: String,
    /// The dataset's id, [`Dataset::id`].
    pub dataset_id: String,
    /// Version of the code that made the dataset.
    pub dataset_code_version: String,
    /// The dataset's seed.
    pub dataset_seed: u64,
}

/// Counts of an export.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExportCounts {
    /// Attempts of the dataset.
    pub attempts: u64,
    /// Exported grasps.
    pub grasps: u64,
    /// Of those, the grasps that held the object.
    pub positives: u64,
    /// Grasps excluded because their origin is outside the grid or too close to its faces.
    pub left_out: u64,
    /// Exported scenes.
    pub scenes: u64,
    /// Scenes excluded because none of their grasps is exported.
    pub scenes_left_out: u64,
}

/// A file of an export with few files.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExportedFile {
    /// Its name.
    pub name: String,
    /// Its size.
    pub bytes: u64,
    /// Its SHA-256 in hex.
    pub sha256: String,
    /// Scenes in it.
    pub scenes: u64,
}

/// The content of `export.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Exported {
    /// The identity of the export.
    pub origin: ExportOrigin,
    /// The counts.
    pub counts: ExportCounts,
    /// The files, for formats of few files.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub files: Vec<ExportedFile>,
}

impl ExportOrigin {
    /// A sentence for the export's page.
    pub(super) fn told(&self) -> String {
        let Self { exporter_version, dataset_id, dataset_code_version, dataset_seed, .. } = self;
        format!(
            "Exported by Graspmill {exporter_version} from dataset `{dataset_id}` (made by {dataset_code_version} from seed \
             {dataset_seed})."
        )
    }

    pub(super) fn of(dataset: &Dataset, format: ExportFormat) -> Self {
        Self {
            format: format.name().to_owned(),
            exporter_version: env!("CARGO_PKG_VERSION").to_owned(),
            dataset_id: dataset.id().to_owned(),
            dataset_code_version: dataset.info().code_version.clone(),
            dataset_seed: dataset.info().seed,
        }
    }
}

/// An export that is being written.
#[derive(Debug)]
pub(super) struct ExportFolder {
    /// The folder for files.
    pub(super) storage: Storage,
    pub(super) origin: ExportOrigin,
}

/// The result of beginning an export.
#[derive(Debug)]
pub(super) enum Beginning {
    /// The export must be written.
    Open(ExportFolder),
    /// The export is complete already.
    Done(Exported),
}

impl ExportFolder {
    /// Begins an export in an empty or new folder, or continues this export.
    pub(super) fn begin(folder: &Path, origin: ExportOrigin) -> Result<Beginning, Failure> {
        let at = Location::Path(folder.to_owned());
        if folder.is_file() {
            let text = format!("the export must go to a folder, got a file: {at}");
            return Err(Failure::new(ExitCode::Config, text));
        }
        let refused = |text| Failure::new(ExitCode::Config, format!("{text}: give an empty or a new folder: {at}"));
        let damaged = |_| refused("what it says about its export is damaged".to_owned());
        let check = |there: &ExportOrigin| {
            let ExportOrigin { format, exporter_version: version, dataset_id, .. } = there;
            let other =
                || refused(format!("it holds an export as {format} of dataset {dataset_id} by version {version}"));
            if *there == origin { Ok(()) } else { Err(other()) }
        };
        let storage = Storage::open_to_write(&at)?;
        if let Some(bytes) = storage.read(DONE)? {
            let done: Exported = serde_json::from_slice(&bytes).map_err(damaged)?;
            check(&done.origin)?;
            remove(folder, BEGUN)?; // a run was killed at the very end
            return Ok(Beginning::Done(done));
        }
        if let Some(bytes) = storage.read(BEGUN)? {
            check(&serde_json::from_slice(&bytes).map_err(damaged)?)?;
        } else {
            let is_foreign = |name: &String| !is_staging(name) && name != "lost+found";
            if let Some(entry) = storage.names("")?.into_iter().filter(is_foreign).min() {
                return Err(refused(format!("it holds {entry:?}, which is no export")));
            }
            storage.publish(BEGUN, pretty(&origin).as_bytes())?;
        }
        Ok(Beginning::Open(Self { storage, origin }))
    }

    /// Removes leftovers of killed writers from one of its folders.
    pub(super) fn sweep(&self, folder: &str) -> Result<(), Failure> {
        self.storage.sweep(folder, Sweep::Dead, true, &mut Swept::default())
    }

    /// Writes `export.json`, which completes the export.
    pub(super) fn finish(self, counts: ExportCounts, files: Vec<ExportedFile>) -> Result<Exported, Failure> {
        let done = Exported { origin: self.origin, counts, files };
        self.storage.publish(DONE, pretty(&done).as_bytes())?;
        if let Some(folder) = self.storage.folder() {
            remove(folder, BEGUN)?;
        }
        Ok(done)
    }
}

fn remove(folder: &Path, name: &str) -> Result<(), Failure> {
    let path = folder.join(name);
    match std::fs::remove_file(&path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(failed("remove a file", &path)(e)),
        _ => Ok(()),
    }
}
