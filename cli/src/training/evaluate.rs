//! `graspmill evaluate`: a checkpoint's results on a dataset.

use std::path::{Path, PathBuf};

use clap::Args;
use program::{ExitCode, Failure, json, print, start_threads};
use shards::Location;
use trainer::evaluate::{TestSet, evaluate};
use trainer::run_folder::BEST;

use super::report::{document, write_report};
use crate::parse::{LocationParser, one_of};

/// Evaluate a checkpoint on a dataset
///
/// Accuracy, precision–recall, calibration, errors of the grasps, by shape and by rule.
#[derive(Debug, Args)]
#[command(after_help = format!("{}\n\n{}", Location::HELP, ExitCode::HELP))]
pub(crate) struct Arguments {
    /// The run's folder, of which the checkpoint with the best test accuracy is evaluated.
    #[arg(long, required_unless_present = "model")]
    run: Option<PathBuf>,
    /// A checkpoint's file, in place of a run's.
    #[arg(long, value_name = "FILE", conflicts_with = "run")]
    model: Option<PathBuf>,
    /// The dataset's folder or URL.
    #[arg(long, value_parser = LocationParser)]
    data: Location,
    /// Which samples: held-out attempts of training scenes, held-out scenes, or every sample.
    #[arg(long, default_value = TestSet::TestAttempts.name(), value_parser = one_of!(TestSet))]
    split: TestSet,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// A folder for evaluation.html, and evaluation.json, which also has the points of precision–recall.
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Threads; all cores by default.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    start_threads(arguments.threads)?;
    let path = match (&arguments.model, &arguments.run) {
        (Some(model), _) => model.clone(),
        // clap asks for one of the two.
        (None, run) => run.as_deref().unwrap_or(Path::new(".")).join(BEST),
    };
    let evaluation = evaluate(&path, &arguments.data, arguments.split)?;
    if let Some(folder) = &arguments.report {
        write_report(&evaluation, folder)?;
    }
    print(if arguments.json { json(&evaluation)? } else { document(&evaluation).text() })?;
    Ok(ExitCode::Ok)
}
