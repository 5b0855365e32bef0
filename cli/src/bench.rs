//! `graspmill bench`: what work costs on this machine.

#[cfg(feature = "full")]
mod fit;
#[cfg(feature = "full")]
mod generate;
#[cfg(feature = "full")]
mod generate_text;
mod plan;

use clap::Subcommand;
use program::{ExitCode, Failure};

/// Measure what generating, training or planning costs on this machine
#[derive(Debug, Subcommand)]
#[command(after_help = ExitCode::HELP)]
pub(crate) enum Command {
    #[cfg(feature = "full")]
    Generate(generate::Arguments),
    #[cfg(feature = "full")]
    Fit(fit::Arguments),
    Plan(plan::Arguments),
}

impl Command {
    pub(crate) fn run(&self) -> Result<ExitCode, Failure> {
        match self {
            #[cfg(feature = "full")]
            Self::Generate(arguments) => generate::run(arguments),
            #[cfg(feature = "full")]
            Self::Fit(arguments) => fit::run(arguments),
            Self::Plan(arguments) => plan::run(arguments),
        }
    }
}
