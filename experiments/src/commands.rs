//! The commands of `experiments`, one file each.

mod compare;
mod report;
mod run;

use clap::{CommandFactory, Parser, Subcommand};
use program::manual::{Manual, Settings};
use program::{ExitCode, Failure};

/// Clears tables in simulation and counts.
#[derive(Debug, Parser)]
#[command(version, after_help = format!("{EXAMPLES}\n\n{}", ExitCode::HELP))]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Run(run::Arguments),
    Compare(compare::Arguments),
    Report(report::Arguments),
    /// Write shell completions, man pages, or this program's reference
    #[command(subcommand)]
    Manual(Manual),
}

/// Runs the command.
///
/// # Errors
/// As its message says; the exit code is documented in the help.
pub fn run(cli: Cli) -> Result<ExitCode, Failure> {
    match cli.command {
        Command::Run(arguments) => run::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Manual(manual) => manual.run(Cli::command(), &[SETTINGS], ""),
    }
}

const SETTINGS: Settings = Settings {
    path: "configs/experiment/pile.toml",
    toml: experiments::config::REFERENCE,
    rows: experiments::config::rows,
};

const EXAMPLES: &str = "\
Examples:
  experiments run configs/experiment/pile.toml --out runs/pile
  experiments run configs/experiment/packed.toml --rounds 20 --out runs/packed
  experiments run configs/experiment/pile.toml --set views.count=3 --set plan.ranking.policy=vgn-best --set protocol='pile, 3 views' --out runs/three
  experiments compare runs/pile runs/three --figure compared.svg
  experiments report runs/pile --html pile.html

Interrupt a run and start the same command again: it continues where it stopped.";
