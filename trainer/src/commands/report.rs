//! `trainer report`: a run as a page.

use std::path::PathBuf;

use clap::Args;
use program::{ExitCode, Failure, print, start_threads, write};
use shards::Location;
use trainer::evaluate::{TestSet, examine};
use trainer::page::{MISTAKES, TrainedRun};
use trainer::run_folder::SavedAs;

const EXAMPLES: &str = "\
Examples:
  trainer report runs/paper --html run.html
  trainer report runs/paper --html run.html --data grasps --split test-scenes
  trainer report runs/paper --html run.html --data s3://bucket/other --split all";

/// Show a run as a page, one file with everything in it: curves, recipe and, on a dataset, the best checkpoint's
/// results and its worst mistakes, with pictures.
#[derive(Args)]
#[command(after_help = format!("{EXAMPLES}\n\n{}\n\n{}", Location::HELP, ExitCode::HELP))]
pub(crate) struct Arguments {
    /// The run's folder.
    run: PathBuf,
    /// The page to write; replaces an existing file.
    #[arg(long, value_name = "FILE")]
    html: PathBuf,
    /// A dataset's folder or URL, to evaluate the best checkpoint on.
    #[arg(long)]
    data: Option<Location>,
    /// Which of its samples.
    #[arg(long, value_enum, default_value_t = TestSet::TestAttempts, requires = "data")]
    split: TestSet,
    /// Threads; all cores by default.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    start_threads(arguments.threads)?;
    let run = TrainedRun::read(&arguments.run)?;
    let best = SavedAs::Best.path(&arguments.run);
    let examined =
        arguments.data.as_ref().map(|data| examine(&best, data, arguments.split, 0.5, MISTAKES)).transpose()?;
    write(&arguments.html, run.document(examined.as_ref())?.html()?)?;
    print(format_args!("{}\n", arguments.html.display()))?;
    Ok(ExitCode::Ok)
}
