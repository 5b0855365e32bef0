//! The command line.

use std::path::PathBuf;

use clap::{Parser, Subcommand};
use generator::AttemptId;
use program::ExitCode;
use program::manual::Manual;
use shards::{Location, LocationParser};

use crate::assignment::{ShardIndices, Task};
use crate::import_command::ImportArguments;

/// Generate a grasp dataset: random stacked scenes, rule-based grasps executed in physics, labels, Parquet shards.
///
/// Running the same command again continues: committed shards are skipped, and the bytes are those of an uninterrupted
/// run. A dataset is a pure function of the config, the seed and this program's version.
#[derive(Debug, Parser)]
#[command(name = "generator", version, after_help = format!("{EXAMPLES}\n\n{}\n\n{ENVIRONMENT}\n\n{}", ExitCode::HELP, Location::HELP))]
#[command(subcommand_negates_reqs = true, args_conflicts_with_subcommands = true, subcommand_value_name = "COMMAND")]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub command: Option<Command>,

    /// Number of shards; part of the dataset's identity [default: the config's]
    #[arg(long, value_name = "N")]
    pub shards: Option<u64>,

    /// Only these shards: one, several, or ranges, such as 3 or 0,4,8-11 [default: the scheduler's index, see below, or all]
    #[arg(long, value_name = "LIST")]
    pub shard_index: Option<ShardIndices>,

    /// Only every T-th shard, from t on: t, t+T, t+2T, ..., where arrays are short
    #[arg(long, value_name = "t/T", conflicts_with = "shard_index")]
    pub task: Option<Task>,

    /// Attempts in the whole dataset [default: the config's]
    #[arg(long, value_name = "N")]
    pub attempts: Option<u64>,

    /// Seed of every random draw [default: the config's]
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,

    /// Threads; never changes the bytes [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=4096))]
    pub threads: Option<u64>,

    /// Config file [default: the built-in configs/generate/paper.toml]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,

    /// Folder or URL of the dataset; made if missing
    #[arg(long, value_name = "DIR|URL", required = true, value_parser = LocationParser)]
    pub out: Option<Location>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Measure what generating costs, stage by stage, and what its shortcuts change
    Bench(BenchArguments),
    /// Execute a dataset's attempts again, from its rows alone: do they end as stored?
    Repeat(RepeatArguments),
    /// Execute one stored attempt again and show it, step by step; exit 65 if it does not end as stored
    Replay(ReplayArguments),
    /// Write a stored scene's depth images, and the file with which planner plan reads them
    Depth(DepthArguments),
    /// Print the shards that are not there, as 0-2,5: what --shard-index and schedulers' arrays take
    Missing(MissingArguments),
    /// Complete a dataset whose shards are all there; exit 69 and name those that are not
    ///
    /// Anyone may do this, at any time, any number of times.
    Finalize(DatasetArgument),
    /// Remove what killed writers left behind
    Gc(GcArguments),
    /// Make objects of your own meshes: measure them, take them apart into convex parts, write a catalogue
    ImportObjects(ImportArguments),
    /// Write shell completions, man pages, or this program's reference
    #[command(subcommand)]
    Manual(Manual),
}

#[derive(Debug, clap::Args)]
pub(crate) struct DatasetArgument {
    /// Folder or URL of the dataset
    #[arg(value_parser = LocationParser)]
    pub dataset: Location,
}

#[derive(Debug, clap::Args)]
pub(crate) struct MissingArguments {
    /// Folder or URL of the dataset
    #[arg(value_parser = LocationParser)]
    pub dataset: Location,

    /// Print tasks instead: the t of --task t/T that have a missing shard
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u32).range(1..))]
    pub tasks: Option<u32>,
}

#[derive(Debug, clap::Args)]
pub(crate) struct GcArguments {
    /// Folder or URL of the dataset
    #[arg(value_parser = LocationParser)]
    pub dataset: Location,

    /// Count, remove nothing
    #[arg(long)]
    pub dry_run: bool,

    /// Also what live writers may be writing (where a file system has no locks, dead ones cannot be told from them)
    #[arg(long, conflicts_with = "dry_run")]
    pub all: bool,
}

#[derive(Debug, clap::Args)]
pub(crate) struct DepthArguments {
    /// Folder or URL of the dataset
    #[arg(value_parser = LocationParser)]
    pub dataset: Location,

    /// Which scene
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub scene: u64,

    /// From so many points evenly around the scene [default: the views of its TSDF]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=32))]
    pub views: Option<u8>,

    /// Folder for depth-0.png and so on (16 bit, 0.1 mm a unit) and views.toml
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

#[derive(Debug, clap::Args)]
pub(crate) struct RepeatArguments {
    /// Folder or URL of the dataset
    #[arg(value_parser = LocationParser)]
    pub dataset: Location,

    /// Only the first N scenes [default: all]
    #[arg(long, value_name = "N")]
    pub scenes: Option<u64>,

    /// Threads [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=4096))]
    pub threads: Option<u64>,
}

#[derive(Debug, clap::Args)]
pub(crate) struct ReplayArguments {
    /// Folder or URL of the dataset
    #[arg(value_parser = LocationParser)]
    pub dataset: Location,

    /// Which attempt of which scene, both from 0
    #[arg(long, value_name = "SCENE/ATTEMPT")]
    pub attempt: AttemptId,

    /// A page for a browser that needs nothing else, or JSON with --json; replaced if it is there
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,

    /// JSON instead of a page, printed if there is no --out; scripts/view_rrd.py makes a Rerun recording of it
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, clap::Args)]
pub(crate) struct BenchArguments {
    /// Attempts of every run
    #[arg(long, value_name = "N", default_value_t = 12_000)]
    pub attempts: u64,

    /// Attempts that are executed again by slower settings; 0 for none
    #[arg(long, value_name = "N", default_value_t = 3_000)]
    pub repeat: u64,

    /// Seed of every random draw [default: the config's]
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,

    /// Threads of the widest run [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=4096))]
    pub threads: Option<u64>,

    /// Config file [default: the built-in configs/generate/paper.toml]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,

    /// Write the report as Markdown too
    #[arg(long, value_name = "FILE")]
    pub markdown: Option<PathBuf>,

    /// Write everything as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

const EXAMPLES: &str = "\
Examples:
  generator --shards 64 --out grasps                    the paper's 200,000 attempts
  generator --config my.toml --shards 4 --attempts 2400 --out small
  generator --shards 64 --shard-index 3 --out grasps    one shard, as a cluster job does
  shards verify grasps && shards report grasps
  generator --shards 5000 --task 3/100 --out s3://bucket/grasps
  generator missing grasps                              what is left to make
  generator finalize grasps                             complete it, when all is there
  generator depth grasps --scene 7 --out scene-7 && planner plan --views scene-7/views.toml
  generator replay grasps --attempt 7/12 --out attempt.html    one attempt, to be looked at in a browser
  generator import-objects meshes --scale 0.001 --out my-objects.toml
  generator bench --markdown bench.md                   what an attempt costs on this machine

GRASPMILL_LOG=info shows which shards are skipped and committed.";

const ENVIRONMENT: &str = "\
Without --shard-index and --task the index is that of SHARD_INDEX, SLURM_ARRAY_TASK_ID, JOB_COMPLETION_INDEX or \
AWS_BATCH_JOB_ARRAY_INDEX, if one is set; two that disagree are an error. (--task 0/1 makes all shards wherever it runs.) The number of shards is never taken from the \
environment: it is part of what the dataset is.";
