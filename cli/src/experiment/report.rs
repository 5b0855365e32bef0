//! `graspmill experiment report`: experiments as a page.

use std::path::PathBuf;

use clap::Args;
use experiments::page::{Played, document};
use program::{ExitCode, Failure, print, write};

const EXAMPLES: &str = "\
Examples:
  graspmill experiment report runs/pile --html pile.html
  graspmill experiment report runs/pile runs/three --html compared.html";

/// Completed experiments as a page, one file with everything in it: rates, failures, pictures of scenes with the grasps
#[derive(Debug, Args)]
#[command(after_help = format!("{EXAMPLES}\n\n{}", ExitCode::HELP))]
pub(crate) struct Arguments {
    /// Folders of completed experiments; several are compared
    #[arg(required = true)]
    folders: Vec<PathBuf>,

    /// The page to write; replaces an existing file
    #[arg(long, value_name = "FILE")]
    html: PathBuf,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let played = arguments.folders.iter().map(|folder| Played::read(folder)).collect::<Result<Vec<_>, _>>()?;
    write(&arguments.html, document(&played).html()?)?;
    print(format_args!("{}\n", arguments.html.display()))?;
    Ok(ExitCode::Ok)
}
