//! `graspmill bench generate`: what generating costs on this machine.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use generator::{Config, Overrides, bench};
use indicatif::ProgressBar;
use program::{Context, ExitCode, Failure, json, print, write};

use super::generate_text;
use crate::command_line;

/// Measure what generating costs, stage by stage, and what its shortcuts change
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Attempts of every run
    #[arg(long, value_name = "N", default_value_t = 12_000)]
    attempts: u64,

    /// Attempts that are executed again by slower settings; 0 for none
    #[arg(long, value_name = "N", default_value_t = 3_000)]
    repeat: u64,

    /// Seed of every random draw [default: the config's]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,

    /// Threads of the widest run [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    threads: Option<u16>,

    /// Config file [default: the built-in configs/generate/paper.toml]
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,

    /// Write the report as Markdown too
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,

    /// Write everything as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The datasets of the bench are made in a temporary folder, which is removed.
pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let shards = Some(arguments.attempts.div_ceil(3_000).max(1));
    let overrides =
        Overrides { seed: arguments.seed, shards, attempts: Some(arguments.attempts), ..Overrides::default() };
    let config = Config::load(arguments.config.as_deref(), overrides)?;
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let threads = arguments.threads.map_or_else(cores, usize::from);
    let scratch = tempfile::tempdir().context("failed to make a temporary folder")?;
    let spinner = ProgressBar::new_spinner();
    spinner.enable_steady_tick(Duration::from_millis(200));
    let on_phase = |phase: &str| spinner.set_message(phase.to_owned());
    let report = bench(&config, threads, arguments.repeat, scratch.path(), &on_phase)?;
    spinner.finish_and_clear();
    let text = generate_text::document(&report, &command_line()).markdown();
    if let Some(path) = &arguments.markdown {
        write(path, &text)?;
    }
    if let Some(path) = &arguments.json {
        write(path, json(&report)?)?;
    }
    print(text)?;
    Ok(ExitCode::Ok)
}
