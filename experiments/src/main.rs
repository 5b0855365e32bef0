//! The `experiments` program: arguments in, library calls, text out.

use std::io::{IsTerminal, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;

use anyhow::Context;
use clap::{Args, CommandFactory, Parser, Subcommand};
use experiments::config::Config;
use experiments::page::{PageError, Played, page};
use experiments::record::{RoundRecord, TrialRecord};
use experiments::report::{About, comparison, json, markdown, read, svg};
use experiments::round::Round;
use experiments::run::{RunError, run};
use experiments::statistics::results;
use experiments::tables::{bodies, conditions, objects_table, rounds_table, trials_table};
use indicatif::{ProgressBar, ProgressStyle};
use planner::PlannerError;
use program::Exit;
use program::manual::{Manual, Settings};

/// Clears tables in simulation and counts.
#[derive(Debug, Parser)]
#[command(version, after_help = format!("{EXAMPLES}\n\n{}", program::ExitCode::HELP))]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run an experiment, or go on with it: rounds.parquet, attempts.parquet, objects.parquet, report.md, report.json, report.svg
    #[command(after_help = program::ExitCode::HELP)]
    Run(RunArguments),
    /// Set experiments that were run side by side, in a table and a figure
    #[command(after_help = program::ExitCode::HELP)]
    Compare(CompareArguments),
    /// Experiments that were run as a page, one file with everything in it: rates, failures, pictures of scenes with the grasps
    #[command(after_help = format!("{REPORT_EXAMPLES}\n\n{}", program::ExitCode::HELP))]
    Report(ReportArguments),
    /// Write shell completions, man pages, or this program's reference
    #[command(subcommand)]
    Manual(Manual),
}

#[derive(Debug, Args)]
struct RunArguments {
    /// The experiment, as in configs/experiment
    config: PathBuf,

    /// Its folder; made if missing
    #[arg(long, value_name = "DIR")]
    out: PathBuf,

    /// A key of the experiment or, as plan.KEY, of the planner's settings, in place of the file's; may be given again
    #[arg(long, value_name = "KEY=VALUE", value_parser = assignment)]
    set: Vec<(String, String)>,

    /// Rounds of a seed [default: the config's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    rounds: Option<u64>,

    /// The one seed of the scenes [default: the config's]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,

    /// Rounds at once; changes times, not results [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

#[derive(Debug, Args)]
struct CompareArguments {
    /// Folders of experiments that were run
    #[arg(required = true)]
    folders: Vec<PathBuf>,

    /// Where the figure goes
    #[arg(long, value_name = "SVG")]
    figure: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct ReportArguments {
    /// Folders of experiments that were run; several are compared
    #[arg(required = true)]
    folders: Vec<PathBuf>,

    /// The page to write, in place of what is there
    #[arg(long, value_name = "FILE")]
    html: PathBuf,
}

const REPORT_EXAMPLES: &str = "\
Examples:
  experiments report runs/pile --html pile.html
  experiments report runs/pile runs/three --html compared.html";

/// `views.count=3` in two.
fn assignment(text: &str) -> Result<(String, String), String> {
    let parts = text.split_once('=').ok_or_else(|| format!("must be KEY=VALUE, got {text}"))?;
    Ok((parts.0.trim().to_owned(), parts.1.trim().to_owned()))
}

const EXAMPLES: &str = "\
Examples:
  experiments run configs/experiment/pile.toml --out runs/pile
  experiments run configs/experiment/packed.toml --rounds 20 --out runs/packed
  experiments run configs/experiment/pile.toml --set views.count=3 --set plan.ranking.policy=vgn-best --set protocol='pile, 3 views' --out runs/three
  experiments compare runs/pile runs/three --figure compared.svg
  experiments report runs/pile --html pile.html

Stop it and run the same command again: it goes on where it was.";

fn main() -> ExitCode {
    let command = Cli::parse().command;
    let level = tracing_subscriber::filter::LevelFilter::WARN.into();
    let filter = tracing_subscriber::EnvFilter::builder().with_default_directive(level).with_env_var("GRASPMILL_LOG");
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_env_filter(filter.from_env_lossy())
        .init();
    let done = match &command {
        Command::Run(arguments) => run_experiment(arguments),
        Command::Compare(arguments) => compare(arguments),
        Command::Report(arguments) => write_page(arguments),
        Command::Manual(manual) => write_manual(manual),
    };
    match done {
        Ok(code) => code.into(),
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "error: {}", program::text::error_chain(error.as_ref()));
            exit_code_of(&error).into()
        }
    }
}

/// The one place where errors become exit codes.
fn exit_code_of(error: &anyhow::Error) -> program::ExitCode {
    let codes = [
        error.downcast_ref().map(settings::Error::exit_code),
        error.downcast_ref().map(RunError::exit_code),
        error.downcast_ref().map(PageError::exit_code),
        error.downcast_ref().map(PlannerError::exit_code),
        error.downcast_ref::<std::io::Error>().map(|_| program::ExitCode::TryAgain),
        error.downcast_ref::<serde_json::Error>().map(|_| program::ExitCode::Data),
    ];
    codes.into_iter().flatten().next().unwrap_or(program::ExitCode::Internal)
}

fn run_experiment(arguments: &RunArguments) -> anyhow::Result<program::ExitCode> {
    let mut set = arguments.set.clone();
    set.extend(arguments.rounds.map(|rounds| ("rounds".to_owned(), rounds.to_string())));
    set.extend(arguments.seed.map(|seed| ("seeds".to_owned(), format!("[{seed}]"))));
    let config = Config::read(&arguments.config, &set)?;
    let planner = config.planner()?;
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let threads = arguments.threads.map_or_else(cores, usize::from);
    let told = || {
        let _ = writeln!(std::io::stderr(), "stopping after the rounds under way; again to stop at once");
    };
    let stop = program::stop_on_signals(told).context("failed to listen for signals")?;
    let bar = progress_bar(config.round_count());
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
    let is_whole = rounds.len() as u64 == config.round_count();
    if is_whole {
        write_reports(&config, planner.model_id(), rounds, &arguments.out)?;
    }
    Ok(if is_whole { program::ExitCode::Ok } else { program::ExitCode::TryAgain })
}

fn compare(arguments: &CompareArguments) -> anyhow::Result<program::ExitCode> {
    let one = |folder: &PathBuf| {
        let path = folder.join("report.json");
        let text = std::fs::read_to_string(&path).with_context(|| format!("failed to read {}", path.display()))?;
        read(&text).with_context(|| format!("not an experiment's report: {}", path.display()))
    };
    let results = arguments.folders.iter().map(one).collect::<anyhow::Result<Vec<_>>>()?;
    if let Some(path) = &arguments.figure {
        std::fs::write(path, svg(&results)?).with_context(|| format!("failed to write {}", path.display()))?;
    }
    let _ = write!(std::io::stdout().lock(), "{}", comparison(&results));
    Ok(program::ExitCode::Ok)
}

fn write_manual(manual: &Manual) -> anyhow::Result<program::ExitCode> {
    let settings = [Settings { path: "configs/experiment/pile.toml", toml: experiments::config::REFERENCE }];
    manual.make(Cli::command(), &settings, "").context("failed to write the manual")?;
    Ok(program::ExitCode::Ok)
}

fn write_page(arguments: &ReportArguments) -> anyhow::Result<program::ExitCode> {
    let played = arguments.folders.iter().map(|folder| Played::read(folder)).collect::<Result<Vec<_>, _>>()?;
    let (path, html) = (&arguments.html, page(&played)?);
    program::publish(path, html.as_bytes()).with_context(|| format!("failed to write {}", path.display()))?;
    let _ = writeln!(std::io::stdout().lock(), "{}", path.display());
    Ok(program::ExitCode::Ok)
}

fn write_reports(config: &Config, model_id: &str, rounds: Vec<Round>, folder: &Path) -> anyhow::Result<()> {
    let (records, trials): (Vec<RoundRecord>, Vec<Vec<TrialRecord>>) =
        rounds.into_iter().map(|round| (round.record, round.trials)).unzip();
    let trials: Vec<TrialRecord> = trials.into_iter().flatten().collect();
    let results = results(&config.protocol, &records, &trials);
    let about = About {
        command: std::env::args().skip(1).fold("experiments".to_owned(), |line, word| line + " " + &quoted(&word)),
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
    write("objects.parquet", &objects_table(&trials)?)?;
    write("bodies.json", bodies(config).as_bytes())?;
    write("run.json", conditions(config).as_bytes())?;
    write("report.json", json(&results, &about).as_bytes())?;
    write("report.svg", svg(std::slice::from_ref(&results))?.as_bytes())?;
    let text = markdown(&results, &about);
    write("report.md", text.as_bytes())?;
    let _ = write!(std::io::stdout().lock(), "{text}");
    Ok(())
}

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    let is_plain = |letter: char| letter.is_alphanumeric() || "-_./=:,+".contains(letter);
    if word.chars().all(is_plain) { word.to_owned() } else { format!("'{}'", word.replace('\'', "'\\''")) }
}

fn progress_bar(rounds: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:32} {human_pos}/{human_len} rounds · {msg} · {eta} left");
    // Without a terminal indicatif draws nothing.
    ProgressBar::new(rounds).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
