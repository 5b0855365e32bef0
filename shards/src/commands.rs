//! The commands of `shards`, one file each.

mod browse;
mod export;
mod report;
mod tsdf;
mod verify;
mod view;

use ::report::document::{Block, Document};
use clap::{CommandFactory, Parser, Subcommand};
use program::manual::Manual;
use program::{ExitCode, Failure};
use shards::{Form, Location, Table};

const EXAMPLES: &str = "\
Examples:
  shards verify grasps               read and check everything
  shards report grasps               statistics with bars
  shards report grasps --json        the same for programs
  shards report grasps --html r.html the same as a page, with pictures of scenes
  shards browse grasps --out pages   scenes, replays and the report as pages that lead to each other
  shards view grasps --scene 17 --out scene.html   one scene in 3-D, for a browser
  shards tsdf grasps --scene 17 --out scene.npy    its voxel grid, for planner plan --tsdf
  shards verify s3://bucket/grasps  the same in an object store
  shards export grasps --format vgn --out grasps-vgn    what VGN's and GIGA's Python code trains on";

/// Verify, report on, show and export a dataset of grasp attempts. No command changes the dataset.
#[derive(Debug, Parser)]
#[command(name = "shards", version, after_help = format!("{EXAMPLES}\n\n{}\n\n{}", Location::HELP, ExitCode::HELP))]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Verify(verify::Arguments),
    Report(report::Arguments),
    Tsdf(tsdf::Arguments),
    Export(export::Arguments),
    View(view::Arguments),
    Browse(browse::Arguments),
    /// Write shell completions, man pages, or this program's reference.
    #[command(subcommand)]
    Manual(Manual),
}

/// Runs the command.
///
/// # Errors
/// As its message says; the exit code is documented in the help.
pub fn run(cli: Cli) -> Result<ExitCode, Failure> {
    match cli.command {
        Command::Verify(arguments) => verify::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Tsdf(arguments) => tsdf::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Browse(arguments) => browse::run(&arguments),
        Command::View(arguments) => view::run(&arguments),
        Command::Manual(manual) => manual.run(Cli::command(), &[], &chapters()),
    }
}

/// The tables in the reference: the paper's voxels, and all columns.
const FORM: Form = Form { resolution: 40, has_hands: true };

/// The reference ends with what all programs share: the tables on disk and the exit codes.
fn chapters() -> String {
    let tables = Table::ALL
        .into_iter()
        .flat_map(|table| [Block::Heading(format!("Table `{}`", table.name())), Block::Table(table.described(FORM))]);
    let exits = [Block::Heading("Exit codes".to_owned()), Block::Code("text", ExitCode::HELP.to_owned())];
    format!("\n{}", Document { blocks: tables.chain(exits).collect(), ..Document::default() }.markdown())
}
