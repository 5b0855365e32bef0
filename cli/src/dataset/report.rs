//! `graspmill dataset report`: statistics of a dataset as text, JSON or a page.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use program::{ExitCode, Failure, print, write};
use shards::report::{PageParts, document, page};
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
    /// Write a page with figures and pictures of scenes, everything in one file.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let dataset = Dataset::open(&arguments.dataset)?;
    let report = shards::report(&dataset)?;
    match &arguments.html {
        Some(path) => {
            let parts = PageParts { written_over: written_over(&dataset), ..PageParts::default() };
            write(path, page(&report, &dataset, &parts)?.html()?)?;
            print(format_args!("{}\n", path.display()))?;
        }
        None if arguments.json => print(report.to_json())?,
        None => print(document(&report, dataset.info()).text())?,
    }
    Ok(ExitCode::Ok)
}

/// From the first to the last of a folder's markers, by their times: as long as making it took, if it was made in one
/// go.
fn written_over(dataset: &Dataset) -> Option<Duration> {
    let Location::Path(folder) = dataset.location() else { return None };
    let meta = folder.join("meta");
    let modified = |name: &str| std::fs::metadata(meta.join(name)).and_then(|of| of.modified()).ok();
    modified("manifest.json")?.duration_since(modified("info.json")?).ok()
}
