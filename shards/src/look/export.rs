//! Exports datasets to the formats of other projects' Python code: VGN's and GIGA's files, and WebDataset tars.
//!
//! The same dataset gives the same bytes. Files are renamed when complete, and an interrupted export continues. A page
//! and `export.json` beside the files describe their content and what was excluded. `docs/exporting.md` shows how to
//! read them.

mod folder;
mod npy;
mod rows;
mod tsdf;
mod vgn;
mod webdataset;

use std::io;

pub use folder::{ExportCounts, ExportOrigin, Exported, ExportedFile};
pub use tsdf::tsdf;

use program::{Exit, ExitCode};

use crate::store::StoreError;
use crate::{Dataset, Location, ReadError};
use folder::{Beginning, ExportFolder};

/// What to export to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum ExportFormat {
    /// VGN's constructed dataset (grasps.csv in voxels, scenes/*.npz), and beside it what GIGA reads in metres
    Vgn,
    /// WebDataset: a tar of .npy and .json files for each shard, a sample for each scene
    #[value(name = "webdataset")]
    WebDataset,
}

impl ExportFormat {
    /// Its name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Vgn => "vgn",
            Self::WebDataset => "webdataset",
        }
    }
}

/// Why a dataset cannot be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The dataset cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The disk refused.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The folder contains something else than an export.
    #[error("it holds {entry:?}, which is no export: give an empty or a new folder: {at}")]
    NotEmpty {
        /// The first thing found.
        entry: String,
        /// The folder.
        at: Location,
    },
    /// The folder's description of its export cannot be read.
    #[error("what it says about its export is damaged: give an empty or a new folder: {0}")]
    NotOurs(Location),
    /// The folder contains another export.
    #[error(
        "it holds an export as {} of dataset {} by version {}: give an empty or a new folder: {at}",
        there.format, there.dataset_id, there.exporter_version
    )]
    Other {
        /// The existing export.
        there: Box<ExportOrigin>,
        /// The folder.
        at: Location,
    },
    /// The target is not a folder.
    #[error("the export must go to a folder, got a file: {0}")]
    NotAFolder(Location),
    /// The target is not on a disk.
    #[error("the export must go to a folder on a disk, got {0}: export there, then copy the files")]
    NotOnADisk(Location),
    /// The format does not support the grid's resolution.
    #[error("VGN's code takes grids of {}^3 voxels, the dataset has {got}^3: export it as webdataset", vgn::RESOLUTION)]
    Resolution {
        /// Voxels along a side.
        got: usize,
    },
    /// The grid is not the one on which the planner plans.
    #[error(
        "the dataset's grid must have {} voxels a side over {} m, got {resolution} over {size_m} m: {at}",
        schema::Grid::PAPER.resolution, schema::Grid::PAPER.size_m
    )]
    Grid {
        /// Voxels along a side.
        resolution: usize,
        /// Length of a side.
        size_m: f32,
        /// The dataset.
        at: Location,
    },
}

impl Exit for ExportError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::Read(error) => error.exit_code(),
            Self::Store(error) => error.exit_code(),
            Self::NotEmpty { .. }
            | Self::NotOurs(_)
            | Self::Other { .. }
            | Self::NotAFolder(_)
            | Self::NotOnADisk(_)
            | Self::Resolution { .. }
            | Self::Grid { .. } => ExitCode::Config,
        }
    }
}

/// Writes a dataset in another format to an empty or new folder, or continues an interrupted equal export. A complete
/// export is not changed. `scenes_done` receives the number of newly written scenes. The attempts and objects of one
/// shard and a few grids are in memory.
///
/// # Errors
/// [`ExportError`] if the dataset cannot be read, does not fit the format, or the folder holds something else.
pub fn export(
    dataset: &Dataset,
    format: ExportFormat,
    out: &Location,
    mut scenes_done: impl FnMut(u64),
) -> Result<Exported, ExportError> {
    let Location::Path(path) = out else { return Err(ExportError::NotOnADisk(out.clone())) };
    let got = dataset.info().grid.resolution;
    if format == ExportFormat::Vgn && got != vgn::RESOLUTION {
        return Err(ExportError::Resolution { got });
    }
    let folder = match ExportFolder::begin(path, ExportOrigin::of(dataset, format))? {
        Beginning::Done(done) => {
            scenes_done(dataset.info().scene_count);
            return Ok(done);
        }
        Beginning::Open(folder) => folder,
    };
    match format {
        ExportFormat::Vgn => vgn::write(dataset, folder, &mut scenes_done),
        ExportFormat::WebDataset => webdataset::write(dataset, folder, &mut scenes_done),
    }
}

/// The name of a scene's files. It begins with letters, because pandas would read a name of digits as a number, and
/// VGN's code could not make a file name of it.
fn scene_name(scene_id: u64) -> String {
    format!("scene-{scene_id:09}")
}

/// The error of a file that could not be written.
fn unwritten(folder: &ExportFolder, name: &str) -> impl FnOnce(io::Error) -> StoreError {
    let at = folder.location(name);
    move |source| StoreError { action: "write a file", at, source }
}
