//! `graspmill objects`: catalogues of objects.

mod annotate;
mod import;

use clap::Subcommand;
use program::{ExitCode, Failure};

/// Make catalogues of objects from meshes, and label grasps of them
#[derive(Debug, Subcommand)]
#[command(after_help = format!("{EXAMPLES}\n\n{}", ExitCode::HELP))]
pub(crate) enum Command {
    Annotate(Box<annotate::Arguments>),
    Import(import::Arguments),
}

const EXAMPLES: &str = "\
Examples:
  graspmill objects import meshes --scale 0.001 --out my-objects.toml
  graspmill objects annotate mug.obj --gripper franka_hand --grasps 2000 --format isaac_grasp --out grasps";

impl Command {
    pub(crate) fn run(&self) -> Result<ExitCode, Failure> {
        match self {
            Self::Annotate(arguments) => annotate::run(arguments),
            Self::Import(arguments) => import::run(arguments),
        }
    }
}
