//! `graspmill dataset export`: says who does it.

use clap::Args;
use program::{ExitCode, Failure};

use crate::parse::others_do;

/// Write the dataset or its scenes in formats of others: VGN's, Parquet for old readers, MJCF, URDF, USD
///
/// The program of the Python package does it: `pip install graspmill`, then the same command
#[derive(Debug, Args)]
#[command(disable_help_flag = true)]
pub(crate) struct Arguments {
    /// As the program of the package takes them.
    #[arg(hide = true, trailing_var_arg = true, allow_hyphen_values = true)]
    _words: Vec<String>,
}

pub(crate) fn run() -> Result<ExitCode, Failure> {
    Err(others_do("exports", ""))
}
