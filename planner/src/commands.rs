//! The commands of `planner`, one file each, and the arguments that they share.

mod bench;
mod console;
mod gripper;
mod plan;
mod serve;

use std::path::PathBuf;

use crate::{Config, Planner};
use clap::{Args, CommandFactory, Parser, Subcommand};
use program::manual::{Manual, Settings};
use program::{ExitCode, Failure, start_threads};

/// Plans grasps from what a robot sees.
#[derive(Debug, Parser)]
#[command(version, after_help = format!("{EXAMPLES}\n\n{}", ExitCode::HELP))]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Plan(Box<plan::Arguments>),
    Serve(serve::Arguments),
    Bench(bench::Arguments),
    Gripper(gripper::Arguments),
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
        Command::Plan(arguments) => plan::run(&arguments),
        Command::Serve(arguments) => serve::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
        Command::Gripper(arguments) => gripper::run(&arguments),
        Command::Manual(manual) => manual.run(Cli::command(), &SETTINGS, ""),
    }
}

const SETTINGS: [Settings; 2] = [
    Settings {
        path: "configs/plan/paper.toml",
        toml: crate::BuiltIn::Paper.text(),
        rows: settings::rows_of::<crate::Config>,
    },
    Settings { path: "configs/plan/judge.toml", toml: crate::BuiltIn::Judge.text(), rows: Vec::new },
];

/// The network and the settings.
#[derive(Debug, Args)]
struct NetworkArguments {
    /// Checkpoint of the network [default: the built-in one of the settings]
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,

    /// Settings: judge, paper or vgn, which come with the program, or a file [default: judge]
    #[arg(long, value_name = "NAME|FILE")]
    config: Option<PathBuf>,

    /// The hand, in place of the settings': a built-in name, or the path of a file that ends in .toml
    #[arg(long, value_name = "NAME|FILE")]
    gripper: Option<String>,

    /// Threads; never changes the plan [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

impl NetworkArguments {
    /// Starts the threads and makes the planner.
    fn planner(&self) -> Result<Planner, Failure> {
        start_threads(self.threads)?;
        let mut config = Config::load(self.config.as_deref())?;
        if let Some(hand) = &self.gripper {
            config.gripper = gripper::named(hand)?;
        }
        Ok(match &self.model {
            Some(model) => Planner::new(model, config)?,
            None => Planner::built_in(config)?,
        })
    }
}

const EXAMPLES: &str = "\
Examples:
  planner plan --demo --picture demo.png
  planner plan --views views.toml --check-collisions --out plan.json
  planner plan --cloud table.pcd --eye 0.15,-0.4,0.5 --explain
  shards tsdf grasps --scene 7 --out scene.npy && planner plan --tsdf scene.npy --config paper
  planner plan --demo --out plan.json --ply cloud.ply && python scripts/plan_rrd.py plan.json --cloud cloud.ply --out plan.rrd
  planner gripper franka_hand --picture hand.svg
  planner serve --port 8040
  planner bench

If no grasp is found, the plan says why, and the exit code is still 0. Programs read the plan with --json or from the file of --out.";
