//! `trainer evaluate`: a checkpoint's results on a dataset.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use clap::{Args, ValueEnum};
use program::{ExitCode, Failure, json, print, start_threads};
use shards::{Location, LocationParser};
use trainer::evaluate::evaluate;
use trainer::evaluate::report::{document, write_report};
use trainer::run_folder::checkpoint_path;

use super::SplitArgument;

/// Evaluate a checkpoint on a dataset: accuracy, precision–recall, calibration, errors of the grasps.
#[derive(Args)]
#[command(after_help = format!("{}\n\n{}", Location::HELP, ExitCode::HELP))]
pub(crate) struct Arguments {
    /// The run's folder.
    #[arg(long, required_unless_present = "model")]
    run: Option<PathBuf>,
    /// Which of its checkpoints.
    #[arg(long, value_enum, default_value_t = Which::Best)]
    checkpoint: Which,
    /// A checkpoint's file, in place of a run's.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["run", "checkpoint"])]
    model: Option<PathBuf>,
    /// The dataset's folder or URL.
    #[arg(long, value_parser = LocationParser)]
    data: Location,
    /// Which samples.
    #[arg(long, value_enum, default_value_t = SplitArgument::TestAttempts)]
    split: SplitArgument,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// A folder for evaluation.md, evaluation.json, and pictures of precision–recall and calibration (SVG and PNG).
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Threads; all cores by default.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Which {
    /// Of the epoch with the best test accuracy.
    Best,
    /// The latest.
    Last,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    start_threads(arguments.threads)?;
    let name = match arguments.checkpoint {
        Which::Best => "best",
        Which::Last => "last",
    };
    let path = match (&arguments.model, &arguments.run) {
        (Some(model), _) => model.clone(),
        (None, run) => checkpoint_path(run.as_deref().unwrap_or(Path::new(".")), name), // clap asks for one of the two
    };
    let (scratch, stop) = (std::env::temp_dir(), AtomicBool::new(false));
    let evaluation = evaluate(&path, &arguments.data, arguments.split.into(), &scratch, &stop, &|| {})?;
    print(if arguments.json { json(&evaluation)? } else { document(&evaluation).text() })?;
    if let Some(folder) = &arguments.report {
        write_report(&evaluation, folder)?;
    }
    Ok(ExitCode::Ok)
}
