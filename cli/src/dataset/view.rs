//! `graspmill dataset view`: one scene in 3-D.

use std::path::PathBuf;

use clap::Args;
use inspect::scene_view;
use program::{ExitCode, Failure, print, write};
use shards::{Dataset, Location};

use crate::parse::LocationParser;

/// Show one scene in 3-D: objects, surface, cameras and every attempt, as a page that needs no other file.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The dataset's folder or URL.
    #[arg(value_parser = LocationParser)]
    dataset: Location,
    /// The scene's number, from 0.
    #[arg(long)]
    scene: u64,
    /// The file; replaced if it exists. Not needed with --json, which then prints.
    #[arg(long, required_unless_present = "json", value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write what the page shows as JSON instead; scripts/view_rrd.py makes a Rerun recording of it.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let dataset = Dataset::open(&arguments.dataset)?;
    let view = scene_view(dataset.info(), dataset.id(), &dataset.read_scene(arguments.scene)?);
    let text = if arguments.json { view.to_json() } else { view.page() };
    match &arguments.out {
        Some(path) => write(path, text)?,
        None => print(text)?,
    }
    Ok(ExitCode::Ok)
}
