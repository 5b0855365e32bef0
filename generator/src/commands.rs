//! The commands of `generator`, one file each.

mod assignment;
mod bench;
mod bench_text;
mod depth;
mod finalize;
mod gc;
mod generate;
mod import_objects;
mod make_objects;
mod missing;
mod repeat;
mod replay;
mod table;

use clap::{CommandFactory, Parser, Subcommand};
use program::manual::{Manual, Settings};
use program::{ExitCode, Failure};
use settings::rows_of;
use shards::Location;

/// Generate a grasp dataset: random stacked scenes, rule-based grasps executed in physics, labels, Parquet shards.
///
/// Running the same command again continues: committed shards are skipped, and the bytes are those of an uninterrupted
/// run. A run that a signal stops (Ctrl-C, SIGTERM) ends within a second or two and loses at most the scene that each
/// thread is in: in a folder, finished scenes of incomplete shards are kept, and the next run takes them up. A dataset
/// is a pure function of the config, the seed and this program's version.
#[derive(Debug, Parser)]
#[command(name = "generator", version, after_help = format!("{EXAMPLES}\n\n{}\n\n{ENVIRONMENT}\n\n{}", ExitCode::HELP, Location::HELP))]
#[command(subcommand_negates_reqs = true, args_conflicts_with_subcommands = true, subcommand_value_name = "COMMAND")]
pub struct Cli {
    #[command(subcommand)]
    command: Option<Command>,

    #[command(flatten)]
    generate: generate::Arguments,
}

#[derive(Debug, Subcommand)]
enum Command {
    Bench(bench::Arguments),
    Repeat(repeat::Arguments),
    Replay(replay::Arguments),
    Depth(depth::Arguments),
    Missing(missing::Arguments),
    Finalize(finalize::Arguments),
    Gc(gc::Arguments),
    ImportObjects(import_objects::Arguments),
    MakeObjects(make_objects::Arguments),
    /// Write shell completions, man pages, or this program's reference
    #[command(subcommand)]
    Manual(Manual),
}

/// Runs the command.
///
/// # Errors
/// As its message says; the exit code is documented in the help.
pub fn run(cli: Cli) -> Result<ExitCode, Failure> {
    match cli.command {
        None => generate::run(&cli.generate),
        Some(Command::Bench(arguments)) => bench::run(&arguments),
        Some(Command::Repeat(arguments)) => repeat::run(&arguments),
        Some(Command::Replay(arguments)) => replay::run(&arguments),
        Some(Command::Depth(arguments)) => depth::run(&arguments),
        Some(Command::Missing(arguments)) => missing::run(&arguments),
        Some(Command::Finalize(arguments)) => finalize::run(&arguments),
        Some(Command::Gc(arguments)) => gc::run(&arguments),
        Some(Command::ImportObjects(arguments)) => import_objects::run(&arguments),
        Some(Command::MakeObjects(arguments)) => make_objects::run(&arguments),
        Some(Command::Manual(manual)) => manual.run(Cli::command(), &SETTINGS, ""),
    }
}

const SETTINGS: [Settings; 2] = [
    Settings {
        path: "configs/generate/paper.toml",
        toml: include_str!("../../configs/generate/paper.toml"),
        rows: rows_of::<generator::Config>,
    },
    Settings {
        path: "configs/grippers/parallel_jaw_80.toml",
        toml: include_str!("../../configs/grippers/parallel_jaw_80.toml"),
        rows: rows_of::<schema::Gripper>,
    },
];

const EXAMPLES: &str = "\
Examples:
  generator --shards 64 --out grasps                    the paper's 200,000 attempts
  generator --config my.toml --shards 4 --attempts 2400 --out small
  generator --shards 64 --shard-index 3 --out grasps    one shard, as a cluster job does
  shards verify grasps && shards report grasps
  generator --shards 5000 --task 3/100 --out s3://bucket/grasps
  generator missing grasps                              the shards that remain to be made
  generator finalize grasps                             completes it when all shards exist
  generator depth grasps --scene 7 --out scene-7 && planner plan --views scene-7/views.toml
  generator replay grasps --attempt 7/12 --out attempt.html    one attempt, for a browser
  generator import-objects meshes --scale 0.001 --out my-objects.toml
  generator make-objects --count 270 --seed 1 --out household.toml
  generator bench --markdown bench.md                   what an attempt costs on this machine

GRASPMILL_LOG=info shows which shards are skipped and committed.";

const ENVIRONMENT: &str = "\
Without --shard-index and --task, the index comes from SHARD_INDEX, SLURM_ARRAY_TASK_ID, JOB_COMPLETION_INDEX or \
AWS_BATCH_JOB_ARRAY_INDEX, if one is set; two that disagree are an error. (--task 0/1 makes all shards wherever it runs.) The number of \
shards is never taken from the environment, because it is part of the dataset's identity.";
