//! `graspmill dataset tsdf`: one scene's voxel grid as a file.

use std::path::PathBuf;

use clap::Args;
use inspect::tsdf;
use program::{ExitCode, Failure, write};
use shards::{Dataset, Location};

use crate::parse::LocationParser;

/// Write one scene's TSDF as NumPy's array, [40, 40, 40] in VGN's values, for `graspmill plan --tsdf`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The dataset's folder or URL.
    #[arg(value_parser = LocationParser)]
    dataset: Location,
    /// The scene's number, from 0.
    #[arg(long)]
    scene: u64,
    /// The file; replaced if it exists.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    write(&arguments.out, tsdf(&Dataset::open(&arguments.dataset)?, arguments.scene)?)?;
    Ok(ExitCode::Ok)
}
