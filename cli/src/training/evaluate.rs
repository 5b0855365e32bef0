//! `graspmill evaluate`: a checkpoint's results on a dataset.

use std::path::{Path, PathBuf};

use clap::Args;
use program::{ExitCode, Failure, json, print, start_threads};
use shards::Location;
use trainer::config::Targets;
use trainer::evaluate::{TestSet, evaluate};
use trainer::run_folder::SavedAs;

use super::report::{document, write_report};
use crate::parse::{LocationParser, one_of};

/// Evaluate a checkpoint on a dataset
///
/// Accuracy, precision–recall, calibration, errors of the grasps, by shape and by rule.
#[derive(Debug, Args)]
#[command(after_help = format!("{}\n\n{}", Location::HELP, ExitCode::HELP))]
pub(crate) struct Arguments {
    /// The run's folder.
    #[arg(long, required_unless_present = "model")]
    run: Option<PathBuf>,
    /// Which of its checkpoints: that of the epoch with the best test accuracy, or the latest.
    #[arg(long, default_value = SavedAs::Best.name(), value_parser = one_of!(SavedAs))]
    checkpoint: SavedAs,
    /// A checkpoint's file, in place of a run's.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["run", "checkpoint"])]
    model: Option<PathBuf>,
    /// The dataset's folder or URL.
    #[arg(long, value_parser = LocationParser)]
    data: Location,
    /// Which samples: held-out attempts of training scenes, held-out scenes, or every sample.
    #[arg(long, default_value = TestSet::TestAttempts.name(), value_parser = one_of!(TestSet))]
    split: TestSet,
    /// Ask about every attempt, also a network that learned one answer a voxel (training.targets = "voxel"); with
    /// --split all.
    #[arg(long)]
    per_attempt: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// A folder for evaluation.md, and evaluation.json, which also has the points of precision–recall.
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
        (None, run) => arguments.checkpoint.path(run.as_deref().unwrap_or(Path::new("."))),
    };
    if arguments.per_attempt && arguments.split != TestSet::All {
        // What was held out of the voxels would be others than of the attempts.
        return Err(Failure::new(ExitCode::Usage, "--per-attempt needs --split all"));
    }
    let asked = arguments.per_attempt.then_some(Targets::Attempt);
    execute(&path, &arguments.data, arguments.split, asked, arguments.json, arguments.report.as_deref())
}

/// Evaluates a checkpoint, and writes and prints the results.
pub(crate) fn execute(
    checkpoint: &Path,
    data: &Location,
    split: TestSet,
    targets: Option<Targets>,
    is_json: bool,
    report: Option<&Path>,
) -> Result<ExitCode, Failure> {
    let evaluation = evaluate(checkpoint, data, split, targets)?;
    if let Some(folder) = report {
        write_report(&evaluation, folder)?;
    }
    print(if is_json { json(&evaluation)? } else { document(&evaluation).text() })?;
    Ok(ExitCode::Ok)
}
