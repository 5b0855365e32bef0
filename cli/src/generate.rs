//! `graspmill generate`: makes the shards of this process.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use clap::Args;
use generator::{Config, Event, Overrides, REJECTED_SHARE_MAX, attempts_of, generate};
use indicatif::ProgressBar;
use program::text::key_and_value;
use program::{Context, ExitCode, Failure, print, print_error, start_threads, stop_on_signals};
use shards::{Finalized, Location};

use crate::assignment::{Task, assigned, index_list, shard_indices, task};
use crate::parse::LocationParser;
use crate::progress::style;
use crate::table;

/// Generate a grasp dataset
///
/// Random stacked scenes, rule-based grasps executed in physics, labels, Parquet shards.
///
/// Running the same command again continues: committed shards are skipped, and the bytes are those of an uninterrupted
/// run. A run that a signal stops (Ctrl-C, SIGTERM) ends within a second or two and loses what it made of incomplete
/// shards. A dataset is a pure function of the config, the seed and this program's version.
#[derive(Debug, Args)]
#[command(after_help = format!("{EXAMPLES}\n\n{}\n\n{ENVIRONMENT}\n\n{}", ExitCode::HELP, Location::HELP))]
pub(crate) struct Arguments {
    /// Number of shards; part of the dataset's identity [default: the config's]
    #[arg(long, value_name = "N")]
    shards: Option<u64>,

    /// Only these shards: one, several, or ranges, such as 3 or 0,4,8-11 [default: the scheduler's index, see below, or
    /// all]
    #[arg(long, value_name = "LIST", value_parser = shard_indices)]
    shard_index: Option<BTreeSet<u32>>,

    /// Only every T-th shard, from t on: t, t+T, t+2T, ...; for schedulers whose arrays are short
    #[arg(long, value_name = "t/T", conflicts_with = "shard_index", value_parser = task)]
    task: Option<Task>,

    /// Attempts in the whole dataset [default: the config's]
    #[arg(long, value_name = "N")]
    attempts: Option<u64>,

    /// Seed of every random draw [default: the config's]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,

    /// Threads; never changes the bytes [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    threads: Option<u16>,

    /// Config file [default: the built-in configs/generate/paper.toml]
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,

    /// Weights of a judge, whose best grasps are executed (shares.judged) [default: the config's]
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,

    /// A key of the config, such as gripper or objects.size_m, in place of the file's; may be repeated. Paths begin in
    /// the config's folder
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value)]
    set: Vec<(String, String)>,

    /// End with 78 if a larger share of the scenes that this run builds is thrown away, because objects do not come to
    /// rest; 1 for no limit
    #[arg(long, value_name = "SHARE", default_value_t = REJECTED_SHARE_MAX)]
    rejected_max: f64,

    /// Folder or URL of the dataset; created if missing
    #[arg(long, value_name = "DIR|URL", value_parser = LocationParser)]
    out: Location,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let overrides = Overrides {
        seed: arguments.seed,
        shards: arguments.shards,
        attempts: arguments.attempts,
        policy: arguments.policy.as_deref(),
        set: &arguments.set,
    };
    let config = Config::load(arguments.config.as_deref(), overrides)?;
    let environment = |name: &str| std::env::var_os(name);
    let (wanted, variable) = assigned(arguments.shard_index.as_ref(), arguments.task, environment, config.shards)?;
    if let Some(variable) = variable {
        let (shard, of) = (index_list(&wanted), config.shards);
        print_error(&format!("shard {shard} of {of}, as {variable} says (--task 0/1 makes all)"));
    }
    start_threads(arguments.threads)?;
    let on_first = || print_error("stopping: abandoning the scenes under way; a second signal stops at once");
    let stop = stop_on_signals(on_first).context("failed to listen for signals")?;

    let (info, out) = (config.dataset_info(), &arguments.out);
    let bar = ProgressBar::new(wanted.iter().map(|shard| attempts_of(&info, *shard)).sum());
    let (bar, held) = (bar.with_style(style("attempts · {per_sec:1}")), AtomicU64::new(0));
    let on_event = |event: Event| match event {
        Event::Skipped { attempts } => bar.dec_length(attempts),
        Event::Scene { attempts, positives } => {
            bar.inc(attempts);
            let held = held.fetch_add(positives, Ordering::Relaxed) + positives;
            bar.set_message(format!("{:.1} % positive", 100.0 * held as f64 / bar.position() as f64));
        }
    };
    let started = Instant::now();
    let report = generate(&config, out, &wanted, arguments.rejected_max, &stop, &on_event)?;
    bar.finish_and_clear();
    print(table::render(&report, out, info.shard_count, started.elapsed().as_secs_f64()))?;
    table::few_positives(&report).iter().for_each(|line| print_error(line));
    Ok(match report.dataset {
        _ if report.stopped.is_some() => ExitCode::TryAgain,
        Some(Finalized::Incomplete { .. }) if wanted.len() == info.shard_count as usize => ExitCode::Incomplete,
        _ => ExitCode::Ok,
    })
}

const EXAMPLES: &str = "\
Examples:
  graspmill generate --shards 64 --out grasps                    the paper's 200,000 attempts
  graspmill generate --config my.toml --shards 4 --attempts 2400 --out small
  graspmill generate --shards 64 --shard-index 3 --out grasps    one shard, as a cluster job does
  graspmill generate --shards 5000 --task 3/100 --out s3://bucket/grasps

GRASPMILL_LOG=info shows which shards are skipped and committed.";

const ENVIRONMENT: &str = "\
Without --shard-index and --task, the index comes from SHARD_INDEX, SLURM_ARRAY_TASK_ID, JOB_COMPLETION_INDEX or \
AWS_BATCH_JOB_ARRAY_INDEX, the first that is set. (--task 0/1 makes all shards wherever it runs.)";
