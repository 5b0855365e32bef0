//! `graspmill experiment run`: runs an experiment, or continues it.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use clap::Args;
use experiments::config::Config;
use experiments::record::Round;
use indicatif::ProgressBar;
use program::text::key_and_value;
use program::{Context, ExitCode, Failure, print, print_error, stop_on_signals};

use super::page::{PAGE, play};
use crate::command_line;
use crate::parse::others_do;
use crate::progress::style;

/// Run an experiment, or continue it: rounds.parquet, attempts.parquet, objects.parquet, report.json, report.html
#[derive(Debug, Args)]
#[command(after_help = ExitCode::HELP)]
pub(crate) struct Arguments {
    /// The experiment, as in configs/experiment
    config: PathBuf,

    /// Its folder; created if missing
    #[arg(long, value_name = "DIR")]
    out: PathBuf,

    /// A key of the experiment or, as plan.KEY, of the planner's settings, in place of the file's; may be repeated
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value)]
    set: Vec<(String, String)>,

    /// Rounds per seed [default: the config's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    rounds: Option<u64>,

    /// The only seed of the scenes [default: the config's]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,

    /// Anyone's planner in place of ours: the address of its /predict, as servers of GraspGen-X and DexGraspNet 2 have
    /// it. The program of the Python package asks it
    #[arg(long, value_name = "URL")]
    planner: Option<String>,

    /// Of --planner: from its grasps' origin along the approach to the finger tips' end, in metres [default: what its
    /// /config says]
    #[arg(long = "tip-depth", value_name = "M", requires = "planner", allow_hyphen_values = true)]
    _tip_depth: Option<f32>,

    /// Seconds that --planner has for an answer
    #[arg(long = "planner-timeout-s", value_name = "S", requires = "planner", default_value_t = 60, value_parser = clap::value_parser!(u16).range(1..=3600))]
    _planner_timeout_s: u16,

    /// Rounds at once; changes times, not results [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    if arguments.planner.is_some() {
        return Err(others_do("asks another planner", ""));
    }
    let mut set = arguments.set.clone();
    set.extend(arguments.rounds.map(|rounds| ("rounds".to_owned(), rounds.to_string())));
    set.extend(arguments.seed.map(|seed| ("seeds".to_owned(), format!("[{seed}]"))));
    let config = Config::read(Some(&arguments.config), &set)?;
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let threads = arguments.threads.map_or_else(cores, usize::from);
    let on_first = || print_error("stopping after the rounds under way; a second signal stops at once");
    let stop = stop_on_signals(on_first).context("failed to listen for signals")?;
    let planner = config.planner()?;
    let bar = ProgressBar::new(config.round_count()).with_style(style("rounds"));
    let counts = Mutex::new((0_u64, 0_u64));
    let on_round = |round: &Round| {
        let mut counts = counts.lock().unwrap_or_else(PoisonError::into_inner);
        counts.0 += round.attempts.len() as u64;
        counts.1 += u64::from(round.removed_count);
        bar.set_message(format!("{} of {} grasps held", counts.1, counts.0));
        bar.inc(1);
    };
    let played = play(&config, &planner, command_line(), threads, &arguments.out, &stop, &on_round)?;
    bar.finish_and_clear();
    let Some(in_short) = played else { return Ok(ExitCode::TryAgain) };
    print(format_args!(
        "{}  failures and how it was run; also report.json and tables as Parquet\n\n{in_short}",
        arguments.out.join(PAGE).display()
    ))?;
    Ok(ExitCode::Ok)
}
