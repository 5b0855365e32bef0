//! `graspmill dataset finalize`: completes a dataset.

use clap::Args;
use program::{ExitCode, Failure, print};
use shards::{Draft, Finalized, Location};

use crate::parse::LocationParser;
use crate::table;

/// Complete a dataset whose shards all exist; exit 69 and name those that are missing
///
/// Any process may do this, at any time, any number of times.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder or URL of the dataset
    #[arg(value_parser = LocationParser)]
    dataset: Location,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let state = Draft::open(&arguments.dataset)?.finalize()?;
    print(table::state(&state, &arguments.dataset))?;
    Ok(match state {
        Finalized::Complete(_) => ExitCode::Ok,
        Finalized::Incomplete { .. } => ExitCode::Incomplete,
    })
}
