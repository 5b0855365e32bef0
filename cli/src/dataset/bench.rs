//! `graspmill dataset bench`: what generating costs on this machine.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use generator::{BenchReport, Comparison, Config, Cost, Overrides, bench};
use indicatif::ProgressBar;
use program::text::{grouped, percent};
use program::{Context, ExitCode, Failure, json, print};
use report::document::{Block, Cell, Document, Table};

/// Measure what generating costs, stage by stage, and what its shortcuts change
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Attempts of every run
    #[arg(long, value_name = "N", default_value_t = 12_000)]
    attempts: u64,

    /// Attempts that are executed again without shortcuts; 0 for none
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

    /// Print JSON instead of Markdown
    #[arg(long)]
    json: bool,
}

/// The datasets of the bench are made in a temporary folder, which is removed.
pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let shards = Some(arguments.attempts.div_ceil(3_000).max(1));
    let overrides =
        Overrides { seed: arguments.seed, shards, attempts: Some(arguments.attempts), ..Overrides::default() };
    let config = Config::load(arguments.config.as_deref(), overrides)?;
    let threads = arguments.threads.map_or_else(crate::experiment::run::cores, usize::from);
    let scratch = tempfile::tempdir().context("failed to make a temporary folder")?;
    let spinner = ProgressBar::new_spinner();
    spinner.enable_steady_tick(Duration::from_millis(200));
    let on_phase = |phase: &str| spinner.set_message(phase.to_owned());
    let report = bench(&config, threads, arguments.repeat, scratch.path(), &on_phase)?;
    spinner.finish_and_clear();
    print(if arguments.json { json(&report)? } else { document(&report).markdown() })?;
    Ok(ExitCode::Ok)
}

fn document(report: &BenchReport) -> Document {
    let heading = |text: &str| Block::Heading(text.to_owned());
    let attempts = report.runs.first().map_or(1, |run| run.count);
    let Comparison { attempts: repeated, same_label, same_outcome, total_s: [ours_s, theirs_s] } =
        &report.without_shortcuts;
    let share = |part: &u64| percent(*part as f64 / (*repeated).max(1) as f64);
    let mut blocks = vec![
        heading("Attempts of whole runs, from nothing to committed shards"),
        costs(&report.runs),
        Block::Text(format!("{:.0} bytes an attempt on disk, scenes included.", report.bytes as f64 / attempts as f64)),
        heading("Stages, one thread"),
        costs(&report.stages),
        heading("Attempts by outcome, one thread"),
        costs(&report.outcomes),
    ];
    if *repeated > 0 {
        blocks.push(heading("Without shortcuts"));
        blocks.push(Block::Text(format!(
            "Of {} attempts with everything simulated, {} end with the same label, {} with the same outcome, in {:.1} \
             times the time.",
            grouped(*repeated),
            share(same_label),
            share(same_outcome),
            theirs_s / ours_s
        )));
    }
    Document { title: "graspmill dataset bench".to_owned(), blocks, footer: String::new() }
}

fn costs(costs: &[Cost]) -> Block {
    let row = |cost: &Cost| {
        let each = |total: f64| format!("{:.1}", total / cost.count.max(1) as f64);
        let seconds = format!("{:.2}", cost.total_s);
        let numbers = [grouped(cost.count), each(cost.steps as f64), each(1e6 * cost.total_s), seconds];
        std::iter::once(cost.name.as_str().into()).chain(numbers.map(Cell::Number)).collect()
    };
    Block::Table(Table::new(["", "times", "steps each", "µs each", "seconds"], costs.iter().map(row)))
}
