//! `graspmill objects`: catalogues of objects.

mod import;
mod make;

use clap::Subcommand;
use program::{ExitCode, Failure};

/// Make catalogues of objects, of meshes or drawn by seed
#[derive(Debug, Subcommand)]
#[command(after_help = format!("{EXAMPLES}\n\n{}", ExitCode::HELP))]
pub(crate) enum Command {
    Import(import::Arguments),
    Make(make::Arguments),
}

const EXAMPLES: &str = "\
Examples:
  graspmill objects import meshes --scale 0.001 --out my-objects.toml
  graspmill objects make --count 270 --seed 1 --out household.toml";

impl Command {
    pub(crate) fn run(&self) -> Result<ExitCode, Failure> {
        match self {
            Self::Import(arguments) => import::run(arguments),
            Self::Make(arguments) => make::run(arguments),
        }
    }
}
