//! `graspmill weights`: says who writes weights for other programs.

use clap::Subcommand;
use program::{ExitCode, Failure};

use crate::parse::{Elsewhere, others_do};

/// Write networks for ONNX runtimes
#[derive(Debug, Subcommand)]
#[command(after_help = ExitCode::HELP)]
pub(crate) enum Command {
    /// Write a network of voxels or a judge as ONNX; PyTorch reads checkpoints as they are
    ///
    /// The program of the Python package does it: `pip install graspmill[onnx]`, then the same command
    Export(Elsewhere),
}

impl Command {
    pub(crate) fn run(&self) -> Result<ExitCode, Failure> {
        let Self::Export(_) = self;
        Err(others_do("writes ONNX", "[onnx]"))
    }
}
