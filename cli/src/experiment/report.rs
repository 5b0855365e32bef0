//! `graspmill experiment report`: experiments as a page.

use std::path::PathBuf;

use clap::Args;
use program::{ExitCode, Failure, print, write};

use super::page::document;

/// Completed experiments, one or several: rates with their intervals, and why grasps failed; as text or a page
#[derive(Debug, Args)]
#[command(after_help = ExitCode::HELP)]
pub(crate) struct Arguments {
    /// Folders of completed experiments
    #[arg(required = true)]
    folders: Vec<PathBuf>,

    /// Write a page, one file with everything in it, and replace an existing one; nothing is printed but its name
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let document = document(&arguments.folders)?;
    match &arguments.html {
        Some(path) => {
            write(path, document.html())?;
            print(format_args!("{}\n", path.display()))?;
        }
        None => print(document.text())?,
    }
    Ok(ExitCode::Ok)
}
