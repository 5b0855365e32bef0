//! `experiments compare`: experiments side by side.

use std::path::{Path, PathBuf};

use clap::Args;
use experiments::report::{Report, comparison, figure};
use experiments::statistics::Results;
use program::{Context, ExitCode, Failure, print, write};

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
    let results = arguments.folders.iter().map(|folder| results_of(folder)).collect::<Result<Vec<_>, _>>()?;
    if let Some(path) = &arguments.figure {
        write(path, figure(&results).svg()?)?;
    }
    print(comparison(&results).markdown())?;
    Ok(ExitCode::Ok)
}

fn results_of(folder: &Path) -> Result<Results, Failure> {
    let path = folder.join("report.json");
    let text = std::fs::read_to_string(&path).context(format_args!("failed to read {}", path.display()))?;
    let damaged = |error: serde_json::Error| format!("not the report of an experiment: {error}: {}", path.display());
    let report: Report = serde_json::from_str(&text).map_err(|error| Failure::new(ExitCode::Data, damaged(error)))?;
    Ok(report.results)
}
