//! The program `graspmill`: the only crate that parses arguments, draws progress and prints tables. A command is a
//! struct of arguments and a function `run`; what it does is in the crates below.
//!
//! Without the cargo feature `full` it is the robot's program, which plans and serves.

mod aliases;
mod manual;
mod parse;
pub mod planning;

#[cfg(feature = "full")]
mod assignment;
#[cfg(feature = "full")]
mod dataset;
#[cfg(feature = "full")]
pub mod experiment;
#[cfg(feature = "full")]
mod generate;
#[cfg(feature = "full")]
mod objects;
#[cfg(feature = "full")]
mod pipeline;
#[cfg(feature = "full")]
mod progress;
#[cfg(feature = "full")]
mod table;
#[cfg(feature = "full")]
mod training;
#[cfg(feature = "full")]
mod weights;

use std::ffi::OsString;
use std::io::{self, Write as _};
use std::sync::{Mutex, PoisonError};

use clap::{Parser, Subcommand};
use program::{Context as _, ExitCode, Failure};

/// Makes robot-grasp datasets in physics simulation, trains networks on them, and plans grasps.
#[derive(Debug, Parser)]
#[command(name = "graspmill", version, after_help = format!("{EXAMPLES}\n\n{}", ExitCode::HELP))]
pub(crate) struct Graspmill {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    #[cfg(feature = "full")]
    Generate(generate::Arguments),
    #[cfg(feature = "full")]
    #[command(subcommand)]
    Dataset(dataset::Command),
    #[cfg(feature = "full")]
    #[command(subcommand)]
    Objects(objects::Command),
    Gripper(planning::gripper::Arguments),
    #[cfg(feature = "full")]
    Fit(training::fit::Arguments),
    #[cfg(feature = "full")]
    Evaluate(training::evaluate::Arguments),
    #[cfg(feature = "full")]
    #[command(subcommand)]
    Weights(weights::Command),
    #[cfg(feature = "full")]
    Pipeline(pipeline::Arguments),
    Plan(Box<planning::plan::Arguments>),
    Serve(planning::serve::Arguments),
    #[cfg(feature = "full")]
    #[command(subcommand)]
    Experiment(experiment::Command),
    #[command(subcommand)]
    Manual(manual::Manual),
}

const EXAMPLES: &str = "\
Examples:
  graspmill generate --shards 64 --out grasps
  graspmill dataset verify grasps && graspmill dataset report grasps
  graspmill fit --data grasps --run runs/paper
  graspmill pipeline my_gripper.toml --out my-gripper
  graspmill plan --demo --html demo.html
  graspmill experiment run configs/experiment/pile.toml --out runs/pile

Called by the name generator it is graspmill generate; by the name trainer, graspmill.

GRASPMILL_LOG=info shows more on standard error.";

/// All of `main`.
#[must_use]
pub fn main() -> std::process::ExitCode {
    run(std::env::args_os().collect()).into()
}

/// Runs the command that these words name; the first is how the program was called.
#[must_use]
pub fn run(words: Vec<OsString>) -> ExitCode {
    program::run(|| execute(aliases::expanded(words)))
}

/// Runs a command, which may be a step of another one.
fn execute(words: Vec<OsString>) -> Result<ExitCode, Failure> {
    match Graspmill::try_parse_from(&words) {
        Ok(Graspmill { command }) => {
            *COMMAND_LINE.lock().unwrap_or_else(PoisonError::into_inner) = program::command_line(words);
            command.run()
        }
        Err(answer) => answered(&answer),
    }
}

/// Prints a help, the version, or what is wrong with a command line.
fn answered(answer: &clap::Error) -> Result<ExitCode, Failure> {
    match answer.print().and_then(|()| io::stdout().flush()) {
        Err(error) if !answer.use_stderr() && error.kind() != io::ErrorKind::BrokenPipe => {
            Err(error).context("failed to print")
        }
        _ => Ok(if answer.use_stderr() { ExitCode::Usage } else { ExitCode::Ok }),
    }
}

/// The command that runs, as a person would type it.
static COMMAND_LINE: Mutex<String> = Mutex::new(String::new());

#[cfg(feature = "full")]
fn command_line() -> String {
    COMMAND_LINE.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

impl Command {
    fn run(&self) -> Result<ExitCode, Failure> {
        match self {
            #[cfg(feature = "full")]
            Self::Generate(arguments) => generate::run(arguments),
            #[cfg(feature = "full")]
            Self::Dataset(command) => command.run(),
            #[cfg(feature = "full")]
            Self::Objects(command) => command.run(),
            Self::Gripper(arguments) => planning::gripper::run(arguments),
            #[cfg(feature = "full")]
            Self::Fit(arguments) => training::fit::run(arguments),
            #[cfg(feature = "full")]
            Self::Evaluate(arguments) => training::evaluate::run(arguments),
            #[cfg(feature = "full")]
            Self::Weights(command) => command.run(),
            #[cfg(feature = "full")]
            Self::Pipeline(arguments) => pipeline::run(arguments),
            Self::Plan(arguments) => planning::plan::run(arguments),
            Self::Serve(arguments) => planning::serve::run(arguments),
            #[cfg(feature = "full")]
            Self::Experiment(command) => command.run(),
            Self::Manual(manual) => manual.run(),
        }
    }
}
