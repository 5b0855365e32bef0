//! `graspmill experiment report`: experiments as a page.

use std::path::PathBuf;

use clap::Args;
use program::{ExitCode, Failure, print, write};

use super::page::{Played, document};

const EXAMPLES: &str = "\
Examples:
  graspmill experiment report runs/pile runs/three > compared.md
  graspmill experiment report runs/pile runs/three --html compared.html";

/// Completed experiments, several side by side with what differs: rates, and why grasps failed; as Markdown or a page
#[derive(Debug, Args)]
#[command(after_help = format!("{EXAMPLES}\n\n{}", ExitCode::HELP))]
pub(crate) struct Arguments {
    /// Folders of completed experiments
    #[arg(required = true)]
    folders: Vec<PathBuf>,

    /// Write a page, one file with everything in it, and replace an existing one; nothing is printed but its name
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let played = arguments.folders.iter().map(|folder| Played::read(folder)).collect::<Result<Vec<_>, _>>()?;
    match &arguments.html {
        Some(path) => {
            write(path, document(&played).html()?)?;
            print(format_args!("{}\n", path.display()))?;
        }
        None => print(document(&played).markdown())?,
    }
    Ok(ExitCode::Ok)
}
