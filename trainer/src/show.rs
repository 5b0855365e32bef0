//! `trainer report`: a run as a page.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use clap::Args;
use program::publish;
use shards::{Location, LocationParser};
use trainer::evaluate::examine;
use trainer::page::{MISTAKES, TrainedRun};
use trainer::run_folder::checkpoint_path;

use crate::{Failure, SplitArg, console, set_threads};

/// What stands below `--help`.
pub(crate) const EXAMPLES: &str = "\
Examples:
  trainer report runs/paper --html run.html
  trainer report runs/paper --html run.html --data grasps --split test-scenes
  trainer report runs/paper --html run.html --data s3://bucket/other --split all";

#[derive(Args)]
pub(crate) struct ReportArgs {
    /// The run's folder.
    run: PathBuf,
    /// The page to write, in place of what is there.
    #[arg(long, value_name = "FILE")]
    html: PathBuf,
    /// A dataset's folder or URL, to evaluate the best checkpoint on.
    #[arg(long, value_parser = LocationParser)]
    data: Option<Location>,
    /// Which of its samples.
    #[arg(long, value_enum, default_value_t = SplitArg::TestAttempts, requires = "data")]
    split: SplitArg,
    /// Threads; all cores by default.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(crate) fn run_report(args: &ReportArgs) -> Result<program::ExitCode, Failure> {
    set_threads(args.threads)?;
    let run = TrainedRun::read(&args.run)?;
    let examined = match &args.data {
        None => None,
        Some(data) => {
            let best = checkpoint_path(&args.run, "best");
            let (scratch, stop) = (std::env::temp_dir(), AtomicBool::new(false));
            Some(examine(&best, data, args.split.into(), &scratch, &stop, &|| {}, MISTAKES)?)
        }
    };
    let page = run.page(examined.as_ref())?;
    publish(&args.html, page.as_bytes()).map_err(|error| {
        let told = anyhow::anyhow!("failed to write the page: {error}: {}", args.html.display());
        Failure(told, program::ExitCode::TryAgain)
    })?;
    console::print(&format!("{}", args.html.display()));
    Ok(program::ExitCode::Ok)
}
