//! The commands of `trainer`, one file each.

mod bench;
mod console;
mod evaluate;
mod export;
mod fit;
mod import;
mod recipe;
mod report;

use clap::{CommandFactory, Parser, Subcommand};
use program::manual::{Manual, Settings};
use program::{ExitCode, Failure};

/// Trains the volumetric grasp network on a Graspmill dataset.
#[derive(Parser)]
#[command(version, after_help = format!("{EXAMPLES}\n\n{}", ExitCode::HELP))]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Fit(fit::Arguments),
    Recipe(recipe::Arguments),
    Evaluate(evaluate::Arguments),
    Report(report::Arguments),
    Bench(bench::Arguments),
    Import(import::Arguments),
    Export(export::Arguments),
    /// Write shell completions, man pages, or this program's reference.
    #[command(subcommand)]
    Manual(Manual),
}

/// Runs the command.
///
/// # Errors
/// As its message says; the exit code is documented in the help.
pub fn run(cli: Cli) -> Result<ExitCode, Failure> {
    match cli.command {
        Command::Fit(arguments) => fit::run(&arguments),
        Command::Recipe(arguments) => recipe::run(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
        Command::Import(arguments) => import::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Manual(manual) => manual.run(Cli::command(), &[SETTINGS], ""),
    }
}

const SETTINGS: Settings = Settings {
    path: "configs/train/paper.toml",
    toml: trainer::config::PAPER,
    rows: settings::rows_of::<trainer::config::Config>,
};

const EXAMPLES: &str = "\
Examples:
  trainer fit --data grasps --run runs/paper                                the paper's recipe; --resume continues
  trainer fit --data grasps --config configs/train/quick.toml --run runs/quick
  trainer evaluate --data grasps --run runs/paper --split test-scenes --report runs/paper/report
  trainer recipe my_hand.toml --out my-hand                                 from a hand to a judge's weights
  trainer report runs/paper --data grasps --html paper.html                 the run as a page
  trainer export runs/paper/best.safetensors --format onnx --out vgn.onnx";
