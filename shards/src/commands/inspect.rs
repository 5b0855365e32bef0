//! `shards inspect`: one scene as text.

use clap::Args;
use program::{ExitCode, Failure, print};
use shards::{Dataset, Location, inspection};

/// Show one scene: objects, cameras, attempts, two cuts through its voxel grid.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The dataset's folder or URL.
    dataset: Location,
    /// The scene's number, from 0.
    #[arg(long)]
    scene: u64,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let dataset = Dataset::open(&arguments.dataset)?;
    let rows = dataset.read_scene(arguments.scene)?;
    print(inspection(dataset.info(), &rows).text())?;
    Ok(ExitCode::Ok)
}
