//! `graspmill dataset`: look at datasets, and take care of their files.

pub(crate) mod browse;
mod finalize;
mod missing;
mod repeat;
mod replay;
mod report;
mod verify;

use clap::Subcommand;
use program::{ExitCode, Failure};
use shards::Location;

use crate::parse::{Elsewhere, others_do};

/// Verify, report on, show, export and complete datasets of grasp attempts
#[derive(Debug, Subcommand)]
#[command(after_help = format!("{EXAMPLES}\n\n{}\n\n{}", Location::HELP, ExitCode::HELP))]
pub(crate) enum Command {
    Verify(verify::Arguments),
    Report(report::Arguments),
    Browse(browse::Arguments),
    Replay(replay::Arguments),
    Repeat(repeat::Arguments),
    /// Write the dataset or its scenes in formats of others: VGN's, MJCF, URDF, USD
    ///
    /// The program of the Python package does it: `pip install graspmill`, then the same command
    Export(Elsewhere),
    Missing(missing::Arguments),
    Finalize(finalize::Arguments),
}

const EXAMPLES: &str = "\
Examples:
  graspmill dataset verify grasps               read and check everything
  graspmill dataset report grasps               statistics
  graspmill dataset report grasps --json        the same for programs
  graspmill dataset report grasps --html r.html the same as a page
  graspmill dataset browse grasps --out pages   scenes, replays and the report as pages that lead to each other
  graspmill dataset browse mugs --out pages     objects of objects annotate with their grasps, as such pages
  graspmill dataset replay grasps --attempt 7/12 --out attempt.html    one attempt, for a browser
  graspmill dataset verify s3://bucket/grasps   the same in an object store
  graspmill dataset missing grasps              the shards that remain to be made
  graspmill dataset finalize grasps             completes it when all shards exist";

impl Command {
    pub(crate) fn run(&self) -> Result<ExitCode, Failure> {
        match self {
            Self::Verify(arguments) => verify::run(arguments),
            Self::Report(arguments) => report::run(arguments),
            Self::Browse(arguments) => browse::run(arguments),
            Self::Replay(arguments) => replay::run(arguments),
            Self::Repeat(arguments) => repeat::run(arguments),
            Self::Export(_) => Err(others_do("exports", "")),
            Self::Missing(arguments) => missing::run(arguments),
            Self::Finalize(arguments) => finalize::run(arguments),
        }
    }
}
