//! `graspmill experiment compare`: experiments side by side.

use std::path::PathBuf;

use clap::Args;
use experiments::page::{Played, comparison, figure};
use program::{ExitCode, Failure, print, write};

/// Compare experiments side by side, in a table and a figure
#[derive(Debug, Args)]
#[command(after_help = ExitCode::HELP)]
pub(crate) struct Arguments {
    /// Folders of completed experiments
    #[arg(required = true)]
    folders: Vec<PathBuf>,

    /// The figure to write
    #[arg(long, value_name = "SVG")]
    figure: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let played = arguments.folders.iter().map(|folder| Played::read(folder)).collect::<Result<Vec<_>, _>>()?;
    if let Some(path) = &arguments.figure {
        write(path, figure(&played).svg()?)?;
    }
    print(comparison(&played).markdown())?;
    Ok(ExitCode::Ok)
}
