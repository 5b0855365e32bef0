//! `graspmill dataset replay`: executes stored attempts again and shows them.

use std::path::PathBuf;

use clap::Args;
use generator::AttemptId;
use inspect::replayed;
use program::{ExitCode, Failure, print, print_error, write};
use shards::{Dataset, Location};

use crate::parse::LocationParser;

/// Execute a stored attempt again and show each step; exit 65 if the outcome differs
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder or URL of the dataset
    #[arg(value_parser = LocationParser)]
    dataset: Location,

    /// Which attempt of which scene, both from 0
    #[arg(long, value_name = "SCENE/ATTEMPT")]
    attempt: AttemptId,

    /// A page for a browser, in one file, or JSON with --json; replaced if it exists
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,

    /// JSON instead of a page, printed if there is no --out; scripts/view_rrd.py makes a Rerun recording of it
    #[arg(long)]
    json: bool,
}

/// The course of the attempt goes to standard output, unless the JSON goes there.
pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let dataset = Dataset::open(&arguments.dataset)?;
    let (replay, view) = replayed(&dataset, arguments.attempt)?;
    let shown = if arguments.json { view.to_json() } else { view.page() };
    match &arguments.out {
        Some(path) => {
            write(path, shown)?;
            print(replay.describe())?;
        }
        None if arguments.json => {
            print(shown)?;
            if !replay.is_reproduced() {
                print_error(replay.describe().trim_end());
            }
        }
        None => print(replay.describe())?,
    }
    Ok(if replay.is_reproduced() { ExitCode::Ok } else { ExitCode::Data })
}
