//! `generator`: writes grasp datasets.

use std::io::{IsTerminal, Write};
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context;
use clap::{CommandFactory, Parser};
use generator::{
    BenchSize, Config, DepthImagesError, Event, GenerateError, ImportError, Overrides, RepeatError, Views, attempts_of,
    bench, generate, repeat, replay, write_depth_images,
};
use indicatif::{ProgressBar, ProgressStyle};
use program::Exit;
use program::manual::{Manual, Settings};
use shards::{Dataset, Draft, FinalizeError, Finalized, ReadError, StoreError, Sweep, Swept};

mod assignment;
mod bench_text;
mod cli;
mod import_command;
mod table;

use assignment::{Assignment, AssignmentError, index_list};
use cli::{
    Arguments, BenchArguments, Command, DatasetArgument, DepthArguments, GcArguments, MissingArguments,
    RepeatArguments, ReplayArguments,
};
use import_command::CatalogueFileError;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_env_filter(tracing_subscriber::EnvFilter::from_env("GRASPMILL_LOG"))
        .init();
    if let Err(error) = program::writes_fail_at_the_file_size_limit() {
        tracing::warn!(%error, "a write beyond the file-size limit will end this program");
    }
    let ended = match &arguments.command {
        Some(Command::Bench(bench)) => run_bench(bench),
        Some(Command::Repeat(repeat)) => run_repeat(repeat),
        Some(Command::Replay(replay)) => run_replay(replay),
        Some(Command::Depth(depth)) => run_depth(depth),
        Some(Command::Missing(missing)) => run_missing(missing),
        Some(Command::Finalize(finalize)) => run_finalize(finalize),
        Some(Command::Gc(gc)) => run_gc(gc),
        Some(Command::ImportObjects(import)) => import_command::run_import(import),
        Some(Command::Manual(manual)) => run_manual(manual),
        None => run(&arguments),
    };
    ended
        .unwrap_or_else(|error| {
            complain(&format!("error: {}", program::text::error_chain(error.as_ref())));
            exit_code_of(&error)
        })
        .into()
}

/// The one place where errors become exit codes.
fn exit_code_of(error: &anyhow::Error) -> program::ExitCode {
    let config = error.downcast_ref().map(settings::Error::exit_code);
    let generate = error.downcast_ref().map(GenerateError::exit_code);
    let repeat = error.downcast_ref().map(RepeatError::exit_code);
    let depth = error.downcast_ref().map(DepthImagesError::exit_code);
    let read = error.downcast_ref().map(ReadError::exit_code);
    let store = error.downcast_ref().map(StoreError::exit_code);
    let finalize = error.downcast_ref().map(FinalizeError::exit_code);
    let write = error.downcast_ref::<ReplayWriteError>().map(|_| program::ExitCode::TryAgain);
    let assignment = error.downcast_ref::<AssignmentError>().map(|_| program::ExitCode::Config);
    let import = error.downcast_ref().map(ImportError::exit_code);
    let catalogue = error.downcast_ref().map(CatalogueFileError::exit_code);
    let codes = [config, generate, repeat, depth, read, store, finalize, write, assignment, import, catalogue];
    codes.into_iter().flatten().next().unwrap_or(program::ExitCode::Internal)
}

/// Says something to the person; a closed stderr is no reason to fail.
fn complain(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Datasets of the bench go to a temporary folder, which is removed.
fn run_bench(arguments: &BenchArguments) -> anyhow::Result<program::ExitCode> {
    let shards = Some(arguments.attempts.div_ceil(3_000).max(1));
    let overrides = Overrides { seed: arguments.seed, shards, attempts: Some(arguments.attempts) };
    let config = Config::load(arguments.config.as_deref(), overrides)?;
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let threads = arguments.threads.map_or_else(|| Ok(cores()), usize::try_from)?;
    let size = BenchSize { threads, repeated_attempts: arguments.repeat };
    let scratch = tempfile::tempdir().context("failed to make a temporary folder")?;
    let spinner = ProgressBar::new_spinner();
    spinner.enable_steady_tick(Duration::from_millis(200));
    let report = bench(&config, size, scratch.path(), &|phase| spinner.set_message(phase.to_owned()))?;
    spinner.finish_and_clear();
    let command = std::env::args().skip(1).fold("generator".to_owned(), |line, word| line + " " + &word);
    let text = bench_text::markdown(&report, &command);
    let write = |path: &Path, text: &str| {
        std::fs::write(path, text).with_context(|| format!("failed to write {}", path.display()))
    };
    if let Some(path) = &arguments.markdown {
        write(path, &text)?;
    }
    if let Some(path) = &arguments.json {
        write(path, &(serde_json::to_string_pretty(&report)? + "\n"))?;
    }
    let _ = write!(std::io::stdout().lock(), "{text}");
    Ok(program::ExitCode::Ok)
}

/// Differences shown at most.
const DIFFERENCES_SHOWN: usize = 20;

fn run_repeat(arguments: &RepeatArguments) -> anyhow::Result<program::ExitCode> {
    start_threads(arguments.threads)?;
    let dataset = Dataset::open(&arguments.dataset).map_err(RepeatError::from)?;
    let began = Instant::now();
    let repeated = repeat(&dataset, arguments.scenes.unwrap_or(u64::MAX))?;
    let rate = repeated.attempts as f64 / began.elapsed().as_secs_f64();
    let mut text = format!(
        "{} attempts executed again at {rate:.0}/s: {} end otherwise than stored\n",
        repeated.attempts,
        repeated.different.len()
    );
    for one in repeated.different.iter().take(DIFFERENCES_SHOWN) {
        let (stored, now) = (one.stored.name(), one.now.name());
        text += &format!("scene {}, attempt {}: stored {stored}, now {now}\n", one.scene_id, one.attempt_id);
    }
    let _ = write!(std::io::stdout().lock(), "{text}");
    Ok(if repeated.different.is_empty() { program::ExitCode::Ok } else { program::ExitCode::Data })
}

/// What happened is told on stdout, unless the JSON goes there.
fn run_replay(arguments: &ReplayArguments) -> anyhow::Result<program::ExitCode> {
    let dataset = Dataset::open(&arguments.dataset).map_err(RepeatError::from)?;
    let replay = replay(&dataset, arguments.attempt)?;
    if let Some(path) = &arguments.out {
        let written = shards::write_view(&replay.view, arguments.json, path);
        written.map_err(|source| ReplayWriteError { source, path: path.clone() })?;
    }
    let is_json_printed = arguments.json && arguments.out.is_none();
    let text = if is_json_printed { replay.view.to_json() } else { replay.told() };
    let _ = write!(std::io::stdout().lock(), "{text}");
    if replay.is_reproduced() {
        return Ok(program::ExitCode::Ok);
    }
    if is_json_printed {
        complain(replay.told().trim_end());
    }
    Ok(program::ExitCode::Data)
}

/// A replay that could not be written.
#[derive(Debug, thiserror::Error)]
#[error("failed to write: {source}: {}", .path.display())]
struct ReplayWriteError {
    source: std::io::Error,
    path: std::path::PathBuf,
}

fn run_depth(arguments: &DepthArguments) -> anyhow::Result<program::ExitCode> {
    let dataset = Dataset::open(&arguments.dataset)?;
    let views = arguments.views.map_or(Views::Stored, |count| Views::Around(count.into()));
    let path = write_depth_images(&dataset, arguments.scene, views, &arguments.out)?;
    let _ = writeln!(std::io::stdout().lock(), "{}", path.display());
    Ok(program::ExitCode::Ok)
}

fn run_missing(arguments: &MissingArguments) -> anyhow::Result<program::ExitCode> {
    let mut missing = Draft::open(&arguments.dataset)?.missing()?;
    if let Some(tasks) = arguments.tasks {
        missing.iter_mut().for_each(|shard| *shard %= tasks);
        missing.sort_unstable();
        missing.dedup();
    }
    if !missing.is_empty() {
        let _ = writeln!(std::io::stdout().lock(), "{}", index_list(&missing));
    }
    Ok(program::ExitCode::Ok)
}

fn run_finalize(arguments: &DatasetArgument) -> anyhow::Result<program::ExitCode> {
    let state = Draft::open(&arguments.dataset)?.finalize()?;
    let _ = write!(std::io::stdout().lock(), "{}", table::state(&state, &arguments.dataset));
    Ok(match state {
        Finalized::Complete(_) => program::ExitCode::Ok,
        Finalized::Incomplete { .. } => program::ExitCode::Incomplete,
    })
}

fn run_gc(arguments: &GcArguments) -> anyhow::Result<program::ExitCode> {
    let (sweep, done) = match arguments {
        GcArguments { dry_run: true, .. } => (Sweep::Look, "to remove"),
        GcArguments { all: true, .. } => (Sweep::All, "removed"),
        GcArguments { .. } => (Sweep::Dead, "removed"),
    };
    let Swept { files, bytes, kept } = Draft::open(&arguments.dataset)?.sweep(sweep)?;
    let mut text = format!("{files} files of killed writers {done}, {}\n", program::text::bytes(bytes));
    if kept > 0 {
        text += &format!("{kept} files are being written, or may be, and stay (--all removes them)\n");
    }
    let _ = write!(std::io::stdout().lock(), "{text}");
    Ok(program::ExitCode::Ok)
}

fn run_manual(manual: &Manual) -> anyhow::Result<program::ExitCode> {
    let settings = [
        Settings { path: "configs/generate/paper.toml", toml: include_str!("../../configs/generate/paper.toml") },
        Settings {
            path: "configs/grippers/parallel_jaw_80.toml",
            toml: include_str!("../../configs/grippers/parallel_jaw_80.toml"),
        },
    ];
    manual.make(Arguments::command(), &settings, "").context("failed to write the manual")?;
    Ok(program::ExitCode::Ok)
}

fn start_threads(threads: Option<u64>) -> anyhow::Result<()> {
    let threads = usize::try_from(threads.unwrap_or(0))?;
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("failed to start threads")
}

fn run(arguments: &Arguments) -> anyhow::Result<program::ExitCode> {
    let out = arguments.out.as_ref().context("--out is missing")?;
    let overrides = Overrides { seed: arguments.seed, shards: arguments.shards, attempts: arguments.attempts };
    let config = Config::load(arguments.config.as_deref(), overrides)?;
    let assignment = Assignment::new(arguments.shard_index.as_ref(), arguments.task, |name| std::env::var_os(name))?;
    let wanted = assignment.shards(config.shards)?;
    if let Some(variable) = assignment.variable() {
        let (shard, of) = (index_list(&wanted), config.shards);
        complain(&format!("shard {shard} of {of}, as {variable} says (--task 0/1 makes all)"));
    }
    start_threads(arguments.threads)?;
    let told = || complain("stopping after the scenes under way; again to stop at once");
    let stop = program::stop_on_signals(told).context("failed to listen for signals")?;

    let info = config.dataset_info();
    let bar = progress_bar(wanted.iter().map(|shard| attempts_of(&info, *shard)).sum());
    let (made, held) = (AtomicU64::new(0), AtomicU64::new(0));
    let started = Instant::now();
    let report = generate(&config, out, &wanted, &stop, &|event| match event {
        Event::Skipped { shard, attempts } => {
            tracing::info!(shard, "skipped: an earlier run committed it");
            bar.dec_length(attempts);
        }
        Event::Scene { attempts, positives } => {
            let made = made.fetch_add(attempts, Ordering::Relaxed) + attempts;
            let held = held.fetch_add(positives, Ordering::Relaxed) + positives;
            bar.set_message(format!("{:.1} % positive", 100.0 * held as f64 / made as f64));
            bar.inc(attempts);
        }
        Event::Committed { shard } => tracing::info!(shard, "committed"),
    })?;
    bar.finish_and_clear();
    let text = table::render(&report, out, started.elapsed().as_secs_f64());
    let _ = write!(std::io::stdout().lock(), "{text}");
    Ok(match report.dataset {
        _ if report.is_stopped => program::ExitCode::TryAgain,
        Some(Finalized::Incomplete { .. }) if wanted.len() == info.shard_count as usize => {
            program::ExitCode::Incomplete
        }
        _ => program::ExitCode::Ok,
    })
}

fn progress_bar(attempts: u64) -> ProgressBar {
    let style =
        ProgressStyle::with_template("{bar:32} {human_pos}/{human_len} attempts · {per_sec} · {msg} · {eta} left");
    let bar = ProgressBar::new(attempts);
    // Without a terminal indicatif draws nothing.
    bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
