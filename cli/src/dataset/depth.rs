//! `graspmill dataset depth`: depth images of a stored scene.

use std::path::PathBuf;

use clap::Args;
use generator::write_depth_images;
use program::{ExitCode, Failure, print};
use shards::{Dataset, Location};

use crate::parse::LocationParser;

/// Write a stored scene's depth images, and a views.toml for graspmill plan
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder or URL of the dataset
    #[arg(value_parser = LocationParser)]
    dataset: Location,

    /// Which scene
    #[arg(long, value_name = "N", default_value_t = 0)]
    scene: u64,

    /// From N points evenly around the scene [default: the views of its TSDF]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=32))]
    views: Option<u8>,

    /// Folder for depth-0.png and so on (16 bit, 0.1 mm per unit) and views.toml
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let dataset = Dataset::open(&arguments.dataset)?;
    let path = write_depth_images(&dataset, arguments.scene, arguments.views, &arguments.out)?;
    print(format_args!("{}\n", path.display()))?;
    Ok(ExitCode::Ok)
}
