//! The `experiments` program: arguments in, library calls, text out.

use std::io::{IsTerminal, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;

use anyhow::Context;
use clap::{Args, Parser, Subcommand};
use experiments::config::{Config, ConfigError};
use experiments::record::{RoundRecord, TrialRecord};
use experiments::report::{About, json, markdown, svg};
use experiments::round::Round;
use experiments::run::{RunError, run};
use experiments::statistics::results;
use experiments::tables::{rounds_table, trials_table};
use indicatif::{ProgressBar, ProgressStyle};
use planner::PlannerError;

/// Worlds are built and dropped all the time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Clears tables in simulation and counts.
#[derive(Debug, Parser)]
#[command(version, after_help = format!("{EXAMPLES}\n\n{}", shards::ExitCode::HELP))]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run an experiment, or go on with it: rounds.parquet, attempts.parquet, report.md, report.json, report.svg
    #[command(after_help = shards::ExitCode::HELP)]
    Run(RunArguments),
}

#[derive(Debug, Args)]
struct RunArguments {
    /// The experiment, as in configs/experiment
    config: PathBuf,

    /// Its folder; made if missing
    #[arg(long, value_name = "DIR")]
    out: PathBuf,

    /// Rounds [default: the config's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    rounds: Option<u64>,

    /// Seed of the scenes [default: the config's]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,

    /// Rounds at once; changes times, not results [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

const EXAMPLES: &str = "\
Examples:
  experiments run configs/experiment/pile.toml --out runs/pile
  experiments run configs/experiment/packed.toml --rounds 20 --out runs/packed

Stop it and run the same command again: it goes on where it was.";

fn main() -> ExitCode {
    let Command::Run(arguments) = Cli::parse().command;
    let level = tracing_subscriber::filter::LevelFilter::WARN.into();
    let filter = tracing_subscriber::EnvFilter::builder().with_default_directive(level).with_env_var("GRASPMILL_LOG");
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_env_filter(filter.from_env_lossy())
        .init();
    match run_experiment(&arguments) {
        Ok(code) => code.into(),
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "error: {}", shards::text::told(error.as_ref()));
            exit_code_of(&error).into()
        }
    }
}

/// The one place where errors become exit codes.
fn exit_code_of(error: &anyhow::Error) -> shards::ExitCode {
    let codes = [
        error.downcast_ref::<ConfigError>().map(|_| shards::ExitCode::Config),
        error.downcast_ref().map(RunError::exit_code),
        error.downcast_ref().map(PlannerError::exit_code),
        error.downcast_ref::<std::io::Error>().map(|_| shards::ExitCode::TryAgain),
    ];
    codes.into_iter().flatten().next().unwrap_or(shards::ExitCode::Internal)
}

fn run_experiment(arguments: &RunArguments) -> anyhow::Result<shards::ExitCode> {
    let mut config = Config::read(&arguments.config)?;
    config.rounds = arguments.rounds.unwrap_or(config.rounds);
    config.seed = arguments.seed.unwrap_or(config.seed);
    let planner = config.planner()?;
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let threads = arguments.threads.map_or_else(cores, usize::from);
    let told = || {
        let _ = writeln!(std::io::stderr(), "stopping after the rounds under way; again to stop at once");
    };
    let stop = shards::stop_on_signals(told).context("failed to listen for signals")?;
    let bar = progress_bar(config.rounds);
    let counts = Mutex::new((0_u64, 0_u64));
    let on_round = |round: &Round| {
        let mut counts = counts.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        counts.0 += u64::from(round.record.attempt_count);
        counts.1 += u64::from(round.record.removed_count);
        bar.set_message(format!("{} of {} grasps held", counts.1, counts.0));
        bar.inc(1);
    };
    let rounds = run(&config, &planner, threads, &arguments.out, &stop, &on_round)?;
    bar.finish_and_clear();
    let is_whole = rounds.len() as u64 == config.rounds;
    if is_whole {
        write_reports(&config, planner.model_id(), rounds, &arguments.out)?;
    }
    Ok(if is_whole { shards::ExitCode::Ok } else { shards::ExitCode::TryAgain })
}

fn write_reports(config: &Config, model_id: &str, rounds: Vec<Round>, folder: &Path) -> anyhow::Result<()> {
    let (records, trials): (Vec<RoundRecord>, Vec<Vec<TrialRecord>>) =
        rounds.into_iter().map(|round| (round.record, round.trials)).unzip();
    let trials: Vec<TrialRecord> = trials.into_iter().flatten().collect();
    let results = results(&config.protocol, &records, &trials);
    let about = About {
        command: std::env::args().skip(1).fold("experiments".to_owned(), |line, word| line + " " + &word),
        config: config.text.clone(),
        model_id: model_id.to_owned(),
        versions: [("experiments".to_owned(), env!("CARGO_PKG_VERSION").to_owned())].into(),
    };
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).with_context(|| format!("failed to write {}", path.display()))
    };
    write("rounds.parquet", &rounds_table(&records)?)?;
    write("attempts.parquet", &trials_table(&trials)?)?;
    write("report.json", json(&results, &about).as_bytes())?;
    write("report.svg", svg(std::slice::from_ref(&results))?.as_bytes())?;
    let text = markdown(&results, &about);
    write("report.md", text.as_bytes())?;
    let _ = write!(std::io::stdout().lock(), "{text}");
    Ok(())
}

fn progress_bar(rounds: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:32} {human_pos}/{human_len} rounds · {msg} · {eta} left");
    // Without a terminal indicatif draws nothing.
    ProgressBar::new(rounds).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
