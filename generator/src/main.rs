//! `generator`: writes grasp datasets.

use std::io::Write;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use anyhow::Context;
use clap::Parser;
use generator::{Config, ConfigError, Event, GenerateError, Overrides, attempts_of, generate};
use indicatif::{ProgressBar, ProgressStyle};

mod cli;
mod table;

use cli::Arguments;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_env_filter(tracing_subscriber::EnvFilter::from_env("GRASPMILL_LOG"))
        .init();
    run(&arguments)
        .unwrap_or_else(|error| {
            complain(&format!("error: {error:#}"));
            exit_code_of(&error)
        })
        .into()
}

/// The one place where errors become exit codes.
fn exit_code_of(error: &anyhow::Error) -> shards::ExitCode {
    match error.downcast_ref::<ConfigError>() {
        Some(error) => error.exit_code(),
        None => error.downcast_ref().map_or(shards::ExitCode::Internal, GenerateError::exit_code),
    }
}

/// Says something to the person; a closed stderr is no reason to fail.
fn complain(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

fn run(arguments: &Arguments) -> anyhow::Result<shards::ExitCode> {
    let overrides = Overrides { seed: arguments.seed, shards: arguments.shards, attempts: arguments.attempts };
    let config = Config::load(arguments.config.as_deref(), overrides)?;
    let wanted: Vec<u32> = match &arguments.shard_index {
        Some(indices) => indices.0.iter().copied().collect(),
        None => (0..config.shard_count).collect(),
    };
    let threads = usize::try_from(arguments.threads.unwrap_or(0))?;
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("failed to start threads")?;
    let stop = stop_on_signals()?;

    let info = config.dataset_info();
    let in_range = wanted.iter().filter(|shard| **shard < info.shard_count);
    let bar = progress_bar(in_range.map(|shard| attempts_of(&info, *shard)).sum());
    let (made, held) = (AtomicU64::new(0), AtomicU64::new(0));
    let started = Instant::now();
    let report = generate(&config, &arguments.out, &wanted, &stop, &|event| match event {
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
    let text = table::render(&report, &arguments.out, started.elapsed().as_secs_f64());
    let _ = write!(std::io::stdout().lock(), "{text}");
    Ok(if report.is_stopped { shards::ExitCode::TryAgain } else { shards::ExitCode::Ok })
}

/// A flag that SIGINT and SIGTERM raise; the second signal ends the process at once, which loses nothing committed.
fn stop_on_signals() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(shards::ExitCode::TryAgain.code().into());
        }
        complain("stopping after the scenes under way; again to stop at once");
    })
    .context("failed to listen for signals")?;
    Ok(stop)
}

fn progress_bar(attempts: u64) -> ProgressBar {
    let style =
        ProgressStyle::with_template("{bar:32} {human_pos}/{human_len} attempts · {per_sec} · {msg} · {eta} left");
    let bar = ProgressBar::new(attempts);
    // Without a terminal indicatif draws nothing.
    bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
