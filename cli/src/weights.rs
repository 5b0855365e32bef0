//! `graspmill weights`: weights from and for other programs.

mod export;
mod import;

use clap::Subcommand;
use program::{ExitCode, Failure};

/// Exchange weights with PyTorch and ONNX runtimes
#[derive(Debug, Subcommand)]
#[command(after_help = ExitCode::HELP)]
pub(crate) enum Command {
    Import(import::Arguments),
    Export(export::Arguments),
}

impl Command {
    pub(crate) fn run(&self) -> Result<ExitCode, Failure> {
        match self {
            Self::Import(arguments) => import::run(arguments),
            Self::Export(arguments) => export::run(arguments),
        }
    }
}
