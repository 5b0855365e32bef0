//! `graspmill fit-report`: a run as a page.

use std::path::PathBuf;

use clap::Args;
use program::{ExitCode, Failure, print, start_threads, write};
use shards::Location;
use trainer::evaluate::{TestSet, examine};
use trainer::page::{MISTAKES, TrainedRun, comparison};
use trainer::run_folder::SavedAs;

use crate::parse::{LocationParser, one_of};

const EXAMPLES: &str = "\
Examples:
  graspmill fit-report runs/paper --html run.html
  graspmill fit-report runs/paper --html run.html --data grasps --split test-scenes
  graspmill fit-report runs/paper --html run.html --data s3://bucket/other --split all
  graspmill fit-report runs/paper runs/other --html runs.html";

/// Show training runs as a page
///
/// One file with everything in it: curves, settings and, on a dataset, the best checkpoint's results and its worst
/// errors, with pictures. Several runs are shown in one chart.
#[derive(Debug, Args)]
#[command(after_help = format!("{EXAMPLES}\n\n{}\n\n{}", Location::HELP, ExitCode::HELP))]
pub(crate) struct Arguments {
    /// The run's folder; several are compared.
    #[arg(required = true)]
    run: Vec<PathBuf>,
    /// The page to write; replaces an existing file.
    #[arg(long, value_name = "FILE")]
    html: PathBuf,
    /// A dataset's folder or URL, to evaluate the best checkpoint on.
    #[arg(long, value_parser = LocationParser)]
    data: Option<Location>,
    /// Which of its samples.
    #[arg(long, default_value = TestSet::TestAttempts.name(), value_parser = one_of!(TestSet), requires = "data")]
    split: TestSet,
    /// Threads; all cores by default.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    start_threads(arguments.threads)?;
    let document = match (arguments.run.as_slice(), &arguments.data) {
        ([path], data) => {
            let run = TrainedRun::read(path)?;
            let best = SavedAs::Best.path(path);
            let examined =
                data.as_ref().map(|data| examine(&best, data, arguments.split, None, MISTAKES)).transpose()?;
            run.document(examined.as_ref())?
        }
        (_, Some(_)) => {
            let text = "--data evaluates one run, give one or leave it out: graspmill evaluate compares on a dataset";
            return Err(Failure::new(ExitCode::Config, text));
        }
        (paths, None) => {
            let runs = paths.iter().map(|path| TrainedRun::read(path)).collect::<Result<Vec<_>, _>>()?;
            comparison(&runs)
        }
    };
    write(&arguments.html, document.html()?)?;
    print(format_args!("{}\n", arguments.html.display()))?;
    Ok(ExitCode::Ok)
}
