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

pub use folder::{ExportCounts, ExportOrigin, Exported, ExportedFile};
pub use tsdf::tsdf;

use program::{ExitCode, Failure};
use settings::words;

use crate::{Dataset, Location};
use folder::{Beginning, ExportFolder};

words! {
    /// What to export to.
    pub enum ExportFormat {
        /// VGN's constructed dataset (grasps.csv in voxels, scenes/*.npz), and beside it what GIGA reads in metres.
        Vgn = "vgn",
        /// WebDataset: a tar of .npy and .json files for each shard, a sample for each scene.
        WebDataset = "webdataset",
    }
}

/// Writes a dataset in another format to an empty or new folder, or continues an interrupted equal export. A complete
/// export is not changed. `scenes_done` receives the number of newly written scenes. The attempts and objects of one
/// shard and a few grids are in memory.
///
/// # Errors
/// [`Failure`] if the dataset cannot be read, does not fit the format, or the folder holds something else.
pub fn export(
    dataset: &Dataset,
    format: ExportFormat,
    out: &Location,
    mut scenes_done: impl FnMut(u64),
) -> Result<Exported, Failure> {
    let refused = |text| Err(Failure::new(ExitCode::Config, text));
    let Location::Path(path) = out else {
        return refused(format!(
            "the export must go to a folder on a disk, got {out}: export there, then copy the files"
        ));
    };
    let (taken, got) = (vgn::RESOLUTION, dataset.info().grid.resolution);
    if format == ExportFormat::Vgn && got != taken {
        let text =
            format!("VGN's code takes grids of {taken}^3 voxels, the dataset has {got}^3: export it as webdataset");
        return refused(text);
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
