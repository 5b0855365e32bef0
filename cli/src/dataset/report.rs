//! `graspmill dataset report`: statistics of a dataset as text, JSON or a page.

use std::path::PathBuf;

use clap::Args;
use program::{ExitCode, Failure, print, write};
use shards::{Dataset, Location};

use crate::parse::LocationParser;

/// Count attempts: positives by shape, rule and objects in the scene; outcomes, widths, angles, sizes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The dataset's folder or URL.
    #[arg(value_parser = LocationParser)]
    dataset: Location,
    /// Print JSON.
    #[arg(long, conflicts_with = "html")]
    json: bool,
    /// Write a page, everything in one file.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let dataset = Dataset::open(&arguments.dataset)?;
    let report = inspect::report(&dataset)?;
    match &arguments.html {
        Some(path) => {
            write(path, report.page(&dataset).html())?;
            print(format_args!("{}\n", path.display()))?;
        }
        None if arguments.json => print(program::json(&report)?)?,
        None => print(report.document(dataset.info()).text())?,
    }
    Ok(ExitCode::Ok)
}
