//! A dataset for the programs of others: the files that VGN's and GIGA's Python code trains on, Parquet for old
//! readers, and scenes for simulators.
//!
//! The same dataset gives the same bytes. Each file gets its name when it is complete, so an interrupted export
//! continues with the missing files; `export-begun.json` identifies it meanwhile. `export.json`, written last, and a
//! page describe the content and what was excluded. `docs/exporting.md` shows how to read the files.

mod plain;
mod scenes;
mod selection;
mod vgn;

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use program::{Context, ExitCode, Failure, FolderLock};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use settings::words;
use shards::{Dataset, Location};

pub use scenes::{SceneFormat, export_scene};
pub use selection::SceneSelection;

/// The file that describes a complete export.
const DONE: &str = "export.json";
/// The file that identifies an incomplete export.
const BEGUN: &str = "export-begun.json";
/// The largest of the two that is read.
const BYTES_MAX: u64 = 1 << 16;

words! {
    /// What to export to.
    pub enum ExportFormat {
        /// VGN's constructed dataset (grasps.csv in voxels, scenes/*.npz), and beside it what GIGA reads in metres.
        Vgn = "vgn",
        /// The three tables as they are, with floats in the plain encoding, for old readers of Parquet.
        Parquet = "parquet",
        /// Scenes for MuJoCo.
        Mjcf = "mjcf",
        /// Scenes for PyBullet and others: a URDF for each body.
        Urdf = "urdf",
        /// Scenes for Isaac Sim and others, with UsdPhysics.
        Usda = "usda",
    }
}

impl ExportFormat {
    /// The folders of an export, in which its files lie.
    fn folders(self) -> &'static [&'static str] {
        match self {
            Self::Vgn => &vgn::FOLDERS,
            Self::Parquet => &plain::FOLDERS,
            Self::Mjcf | Self::Urdf | Self::Usda => &scenes::FOLDERS,
        }
    }

    /// What a simulator reads, if the format is of scenes.
    fn of_scenes(self) -> Option<SceneFormat> {
        match self {
            Self::Vgn | Self::Parquet => None,
            Self::Mjcf => Some(SceneFormat::Mjcf),
            Self::Urdf => Some(SceneFormat::Urdf),
            Self::Usda => Some(SceneFormat::Usda),
        }
    }
}

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
    /// Which scenes, if not all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scenes: Option<String>,
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

/// The content of `export.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Exported {
    /// The identity of the export.
    pub origin: ExportOrigin,
    /// The counts.
    pub counts: ExportCounts,
}

/// Writes a dataset in another format to an empty or new folder, or continues an interrupted equal export. A complete
/// export is not changed. `scenes` selects some of the scenes, of formats for simulators only. `scenes_done` receives
/// the number of newly written scenes. The attempts and objects of one shard, or a few dozen grids, are in memory.
///
/// # Errors
/// [`Failure`] if the dataset cannot be read, does not fit the format, or the folder holds something else.
pub fn export(
    dataset: &Dataset,
    format: ExportFormat,
    scenes: Option<&SceneSelection>,
    out: &Location,
    mut scenes_done: impl FnMut(u64),
) -> Result<Exported, Failure> {
    let refused = |text: String| Failure::new(ExitCode::Config, text);
    let Location::Path(folder) = out else {
        let text = format!("the export must go to a folder on a disk, got {out}: export there, then copy the files");
        return Err(refused(text));
    };
    if folder.is_file() {
        return Err(refused(format!("the export must go to a folder, got a file: {out}")));
    }
    let info = dataset.info();
    if format == ExportFormat::Vgn {
        vgn::suited(info).map_err(refused)?;
    }
    if let Some(scenes) = scenes {
        scenes.check(info).map_err(refused)?;
        if format.of_scenes().is_none() {
            return Err(refused(format!("scenes may be selected of mjcf, urdf and usda, got {}", format.name())));
        }
    }
    let origin = ExportOrigin {
        format: format.name().to_owned(),
        exporter_version: env!("CARGO_PKG_VERSION").to_owned(),
        dataset_id: dataset.id().to_owned(),
        dataset_code_version: info.code_version.clone(),
        dataset_seed: info.seed,
        scenes: scenes.map(ToString::to_string),
    };
    if let Some(done) = begin(folder, &origin)? {
        clear(folder, format); // a run was killed at the very end
        scenes_done(done.counts.scenes + done.counts.scenes_left_out);
        return Ok(done);
    }
    let folders = format.folders().iter();
    let _locks = folders.map(|name| FolderLock::take(&folder.join(name))).collect::<Result<Vec<_>, _>>()?;
    let counts = match format.of_scenes() {
        Some(format) => scenes::write(dataset, format, scenes, folder, &origin, &mut scenes_done)?,
        None if format == ExportFormat::Vgn => vgn::write(dataset, folder, &origin, &mut scenes_done)?,
        None => plain::write(dataset, folder, &origin, &mut scenes_done)?,
    };
    let done = Exported { origin, counts };
    program::write(&folder.join(DONE), program::json(&done)?)?;
    clear(folder, format);
    Ok(done)
}

/// Begins an export in an empty or new folder, or continues this export. Returns it if it is complete.
fn begin(folder: &Path, origin: &ExportOrigin) -> Result<Option<Exported>, Failure> {
    let refused = |text: String| {
        let text = format!("{text}: give an empty or a new folder: {}", folder.display());
        Failure::new(ExitCode::Config, text)
    };
    let check = |there: &ExportOrigin| {
        let ExportOrigin { format, exporter_version: version, dataset_id, scenes, .. } = there;
        let of = scenes.as_ref().map_or(String::new(), |scenes| format!("scenes {scenes} of "));
        let other =
            || refused(format!("it holds an export as {format} of {of}dataset {dataset_id} by version {version}"));
        if there == origin { Ok(()) } else { Err(other()) }
    };
    let damaged = || refused("what it says about its export is damaged".to_owned());
    // Listed before it is asked whose it is: what another exporter of the same writes meanwhile is not foreign.
    let failed = || format!("failed to make or read the folder {}", folder.display());
    fs::create_dir_all(folder).context(failed())?;
    let names = fs::read_dir(folder).and_then(|entries| {
        entries.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned())).collect::<Result<Vec<_>, _>>()
    });
    let names = names.context(failed())?;
    if let Some(bytes) = bytes(&folder.join(DONE))? {
        let done: Exported = parsed(&bytes).ok_or_else(damaged)?;
        return check(&done.origin).map(|()| Some(done));
    }
    if let Some(bytes) = bytes(&folder.join(BEGUN))? {
        return check(&parsed(&bytes).ok_or_else(damaged)?).map(|()| None);
    }
    let is_foreign = |name: &String| name != "lost+found" && !program::is_temporary(name);
    if let Some(name) = names.into_iter().filter(is_foreign).min() {
        return Err(refused(format!("it holds {name:?}, which is no export")));
    }
    program::write(&folder.join(BEGUN), program::json(origin)?)?;
    Ok(None)
}

/// The bytes of a small file, `None` if there is none.
fn bytes(path: &Path) -> Result<Option<Vec<u8>>, Failure> {
    match program::read(path, BYTES_MAX) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        read => read.map(Some).context(format_args!("failed to read {}", path.display())),
    }
}

fn parsed<T: DeserializeOwned>(bytes: &[u8]) -> Option<T> {
    serde_json::from_slice(bytes).ok()
}

/// A file's name while it is written. A continued export begins it anew.
fn part(path: &Path) -> PathBuf {
    path.with_extension("part")
}

/// Gives a file that is complete its name.
fn finish(file: &File, path: &Path) -> Result<(), Failure> {
    file.sync_all().and_then(|()| fs::rename(part(path), path)).context(failed(path))
}

fn failed(path: &Path) -> String {
    format!("failed to write {}", path.display())
}

/// Removes what only an incomplete export needs. What stays does no harm.
fn clear(folder: &Path, format: ExportFormat) {
    let locks = format.folders().iter().map(|name| folder.join(name).join(FolderLock::NAME));
    for path in locks.chain([folder.join(BEGUN)]) {
        let _ = fs::remove_file(path);
    }
}
