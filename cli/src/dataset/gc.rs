//! `graspmill dataset gc`: removes what killed writers left behind.

use clap::Args;
use program::text::bytes;
use program::{ExitCode, Failure, print};
use shards::{Draft, Location, Sweep, Swept};

use crate::parse::LocationParser;

/// Remove what killed writers left behind
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder or URL of the dataset
    #[arg(value_parser = LocationParser)]
    dataset: Location,

    /// Count, remove nothing
    #[arg(long)]
    dry_run: bool,

    /// Also remove files that a running writer may still be writing (without file locks, a file system cannot tell them
    /// apart)
    #[arg(long, conflicts_with = "dry_run")]
    all: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (sweep, done) = match arguments {
        Arguments { dry_run: true, .. } => (Sweep::Look, "to remove"),
        Arguments { all: true, .. } => (Sweep::All, "removed"),
        Arguments { .. } => (Sweep::Dead, "removed"),
    };
    let Swept { files, bytes: size, kept } = Draft::open(&arguments.dataset)?.sweep(sweep)?;
    let mut text = format!("{files} files of killed writers {done}, {}\n", bytes(size));
    if kept > 0 {
        text += &format!("{kept} files kept: a running writer may still need them (--all removes them)\n");
    }
    print(text)?;
    Ok(ExitCode::Ok)
}
