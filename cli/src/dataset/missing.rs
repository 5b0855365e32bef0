//! `graspmill dataset missing`: the shards that remain to be made.

use clap::Args;
use program::{ExitCode, Failure, print};
use shards::{Draft, Location};

use crate::assignment::index_list;
use crate::parse::LocationParser;

/// Print the shards that do not exist yet, as 0-2,5: the format of --shard-index and of schedulers' arrays
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder or URL of the dataset
    #[arg(value_parser = LocationParser)]
    dataset: Location,

    /// Print tasks instead: the t of --task t/T that have a missing shard
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u32).range(1..))]
    tasks: Option<u32>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut missing = Draft::open(&arguments.dataset)?.missing()?;
    if let Some(tasks) = arguments.tasks {
        missing.iter_mut().for_each(|shard| *shard %= tasks);
        missing.sort_unstable();
        missing.dedup();
    }
    if !missing.is_empty() {
        print(format_args!("{}\n", index_list(&missing)))?;
    }
    Ok(ExitCode::Ok)
}
