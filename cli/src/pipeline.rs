//! `graspmill pipeline`: from a gripper to a judge's weights in one command.

mod steps;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use clap::Args;
use network::checkpoint;
use program::{Context, ExitCode, Failure, print, stop_on_signals, write};

use crate::execute;
use steps::{MANY_GRIPPERS, Objects, Pipeline, is_known, must_answer_for};

/// Make a judge for a gripper, from data to weights
///
/// Execute attempts, a quarter of them the choices of a judge of many grippers, go on training it on the outcomes, and
/// try it. Where no such judge answers for the gripper, or for many grippers, there are two rounds: execute attempts,
/// train a judge, execute some of its own choices, train it on both. Before a step runs, the command that does the same
/// is printed. Interrupt the pipeline and start it again: it goes on where it stopped. The same arguments give the same
/// weights.
#[derive(Debug, Args)]
#[command(after_help = ExitCode::HELP)]
pub(crate) struct Arguments {
    /// The gripper: a built-in name, the path of a file that ends in .toml (docs/own-gripper.md), or any_jaw for a
    /// judge that serves every gripper within ranges.
    gripper: String,
    /// The folder of datasets, weights, settings, evaluation and experiments.
    #[arg(long)]
    out: PathBuf,
    /// Attempts of all rounds together.
    #[arg(long, default_value_t = 1_500_000, value_parser = clap::value_parser!(u64).range(3_600..=1_000_000_000))]
    attempts: u64,
    /// Objects to which half of the attempts go: a catalogue's file (docs/own-objects.md), or household for the kinds
    /// of docs/household-objects.md, of which a third is kept for a test.
    #[arg(long, value_name = "FILE")]
    objects: Option<PathBuf>,
    /// Weights to begin with, of a judge that answers for the gripper, or nothing [default: for a single gripper the
    /// built-in judge of many grippers if it answers for it, else nothing].
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    /// Seed of the first dataset.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(..1 << 60))]
    seed: u64,
    /// Print the steps and the files that they read, and end: nothing is written.
    #[arg(long)]
    dry_run: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let absolute = |path: &Path| std::path::absolute(path).context(format_args!("no path: {}", path.display()));
    let is_file = arguments.gripper.ends_with(".toml");
    let gripper = if is_file {
        absolute(Path::new(&arguments.gripper))?.display().to_string()
    } else {
        arguments.gripper.clone()
    };
    let out = absolute(&arguments.out)?;
    let built_in = out.join("from.safetensors");
    let from = match arguments.from.as_deref() {
        Some(word) if word == Path::new("nothing") => None,
        Some(file) => {
            let file = absolute(file)?;
            must_answer_for(&checkpoint::read(&file)?, &gripper)?;
            Some(file)
        }
        None => is_known(&gripper)?.then(|| built_in.clone()),
    };
    let pipeline = Pipeline {
        gripper,
        out,
        from,
        seed: arguments.seed,
        attempts: arguments.attempts,
        objects: match arguments.objects.as_deref() {
            None => None,
            Some(word) if word == Path::new("household") => Some(Objects::Household),
            Some(file) => Some(Objects::File(absolute(file)?)),
        },
    };
    let steps = pipeline.steps()?;
    let settings = pipeline.settings()?.into_iter().map(|(name, text)| (pipeline.out.join(name), text.into_bytes()));
    let mut files: Vec<(PathBuf, Vec<u8>)> = settings.collect();
    if arguments.from.is_none() && pipeline.from.is_some() {
        files.push((built_in, MANY_GRIPPERS.0.to_vec()));
    }
    if arguments.dry_run {
        print(format_args!("{} steps. Before them these files are written:\n", steps.len()))?;
        files.iter().try_for_each(|(path, _)| print(format_args!("{}\n", path.display())))?;
        steps.iter().try_for_each(|step| print(format_args!("\n# {}\n{}\n", step.what, step.command())))?;
        return Ok(ExitCode::Ok);
    }
    fs::create_dir_all(&pipeline.out).context(format_args!("failed to make {}", pipeline.out.display()))?;
    files.iter().try_for_each(|(path, bytes)| write(path, bytes))?;
    let stop = stop_on_signals(|| ()).context("failed to listen for signals")?;
    for (number, step) in steps.iter().enumerate() {
        print(format_args!("\n[{} of {}] {}\n{}\n", number + 1, steps.len(), step.what, step.command()))?;
        // The other commands know what is done.
        if step.is("evaluate") && step.out.join("evaluation.json").exists() {
            continue;
        }
        let ended = execute(step.words.clone());
        let ended = if stop.load(Ordering::Relaxed) && ended.is_ok() { Ok(ExitCode::TryAgain) } else { ended };
        if !matches!(ended, Ok(ExitCode::Ok)) {
            print(format_args!("\nthe same command goes on with this step: {}\n", step.what))?;
            return ended;
        }
    }
    let weights = pipeline.out.join("judge.safetensors");
    fs::copy(pipeline.weights(), &weights).context(format_args!("failed to write {}", weights.display()))?;
    print(format_args!("\nweights  {}\n", weights.display()))?;
    Ok(ExitCode::Ok)
}
