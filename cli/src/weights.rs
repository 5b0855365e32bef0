//! `graspmill weights`: says who writes weights for other programs.

use clap::{Args, Subcommand};
use program::{ExitCode, Failure};

use crate::parse::others_do;

/// Write networks for ONNX runtimes
#[derive(Debug, Subcommand)]
#[command(after_help = ExitCode::HELP)]
pub(crate) enum Command {
    Export(Arguments),
}

/// Write a network of voxels or a judge as ONNX; PyTorch reads checkpoints as they are
///
/// The program of the Python package does it: `pip install graspmill[onnx]`, then the same command
#[derive(Debug, Args)]
#[command(disable_help_flag = true)]
pub(crate) struct Arguments {
    /// As the program of the package takes them.
    #[arg(hide = true, trailing_var_arg = true, allow_hyphen_values = true)]
    _words: Vec<String>,
}

impl Command {
    pub(crate) fn run(&self) -> Result<ExitCode, Failure> {
        let Self::Export(_) = self;
        Err(others_do("writes ONNX", "[onnx]"))
    }
}
