//! `graspmill experiment`: clears tables in simulation and counts.

pub mod page;
mod report;
pub(crate) mod run;

use clap::Subcommand;
use program::{ExitCode, Failure};

/// Clear tables in simulation and count
#[derive(Debug, Subcommand)]
#[command(after_help = format!("{EXAMPLES}\n\n{}", ExitCode::HELP))]
pub(crate) enum Command {
    Run(run::Arguments),
    Report(report::Arguments),
}

const EXAMPLES: &str = "\
Examples:
  graspmill experiment run configs/experiment/pile.toml --out runs/pile
  graspmill experiment run configs/experiment/packed.toml --rounds 20 --out runs/packed
  graspmill experiment run configs/experiment/pile.toml --set views.count=3 --set plan.ranking.policy=vgn-best --set protocol='pile, 3 views' --out runs/three
  graspmill experiment report runs/pile runs/three
  graspmill experiment report runs/pile runs/three --html compared.html

Interrupt a run and start the same command again: it continues where it stopped.";

impl Command {
    pub(crate) fn run(&self) -> Result<ExitCode, Failure> {
        match self {
            Self::Run(arguments) => run::run(arguments),
            Self::Report(arguments) => report::run(arguments),
        }
    }
}
