//! `graspmill pipeline`: from a gripper to a judge's weights in one command.

mod action;
mod card;
mod steps;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;
use generator::{Overrides, REJECTED_SHARE_MAX};
use network::checkpoint;
use program::{Context, ExitCode, Failure, print, read, start_threads, stop_on_signals, unread, write};
use shards::Location;
use trainer::device::Device;
use trainer::evaluate::TestSet;
use trainer::fit::Job;
use trainer::run_folder::SavedAs;

use crate::parse::one_of;
use crate::{experiment, generate, training};
use action::{Action, Step};
use card::card;
use steps::{MANY_HANDS, Objects, Pipeline, Views, is_known, must_answer_for};

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
    hand: String,
    /// The folder of datasets, weights, settings, evaluation, and README.md, the card of the weights.
    #[arg(long)]
    out: PathBuf,
    /// Attempts of all rounds together.
    #[arg(long, default_value_t = 1_500_000, value_parser = clap::value_parser!(u64).range(3_600..=1_000_000_000))]
    attempts: u64,
    /// From where the scenes are seen.
    #[arg(long, value_parser = one_of!(Views), default_value = Views::Anywhere.name())]
    views: Views,
    /// Objects to which half of the attempts go: a catalogue's file (docs/own-objects.md), or household for the kinds
    /// of docs/household-objects.md, of which a third is kept for a test.
    #[arg(long, value_name = "FILE")]
    objects: Option<PathBuf>,
    /// Weights to begin with, of a judge that answers for the hand, or nothing [default: for a single hand the built-in
    /// judge of many hands if it answers for it, else nothing].
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    /// Seed of the first dataset.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(..1 << 60))]
    seed: u64,
    /// Print the steps, and end.
    #[arg(long)]
    dry_run: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let absolute = |path: &Path| std::path::absolute(path).context(format_args!("no path: {}", path.display()));
    let is_file = arguments.hand.ends_with(".toml");
    let hand =
        if is_file { absolute(Path::new(&arguments.hand))?.display().to_string() } else { arguments.hand.clone() };
    let out = absolute(&arguments.out)?;
    let built_in = out.join("from.safetensors");
    let from = match arguments.from.as_deref() {
        Some(word) if word == Path::new("nothing") => None,
        Some(file) => {
            let file = absolute(file)?;
            must_answer_for(&checkpoint::read(&file)?, &hand)?;
            Some(file)
        }
        None => is_known(&hand)?.then(|| built_in.clone()),
    };
    let pipeline = Pipeline {
        hand,
        out,
        from,
        seed: arguments.seed,
        attempts: arguments.attempts,
        views: arguments.views,
        objects: match arguments.objects.as_deref() {
            None => None,
            Some(word) if word == Path::new("household") => Some(Objects::Household),
            Some(file) => Some(Objects::File(absolute(file)?)),
        },
    };
    let steps = pipeline.steps()?;
    fs::create_dir_all(&pipeline.out).context(format_args!("failed to make {}", pipeline.out.display()))?;
    if arguments.from.is_none() && pipeline.from.is_some() {
        write(&built_in, MANY_HANDS.0)?;
    }
    write_settings(&pipeline)?;
    start_threads(None)?;
    let stop = stop_on_signals(|| ()).context("failed to listen for signals")?;
    if arguments.dry_run {
        print(format_args!("{} steps\n", steps.len()))?;
        for Step { what, action } in &steps {
            print(format_args!("\n# {what}\n{}\n", action.command()))?;
        }
        return Ok(ExitCode::Ok);
    }
    for (number, Step { what, action }) in steps.iter().enumerate() {
        print(format_args!("\n[{} of {}] {what}\n{}\n", number + 1, steps.len(), action.command()))?;
        // The other actions know what is done.
        if matches!(action, Action::Evaluate { .. }) && action.done().exists() {
            continue;
        }
        let ended = execute(action, &stop);
        let ended = if stop.load(Ordering::Relaxed) && ended.is_ok() { Ok(ExitCode::TryAgain) } else { ended };
        if !matches!(ended, Ok(ExitCode::Ok)) {
            print(format_args!("\nthe same command goes on with this step: {what}\n"))?;
            return ended;
        }
    }
    finish(&pipeline, &steps)
}

/// Largest weights, in bytes.
const WEIGHTS_BYTES_MAX: u64 = 64 << 20;

/// Writes the weights and their card.
fn finish(pipeline: &Pipeline, steps: &[Step]) -> Result<ExitCode, Failure> {
    let weights = pipeline.out.join("judge.safetensors");
    let best = pipeline.weights();
    write(&weights, read(&best, WEIGHTS_BYTES_MAX).map_err(|error| unread(&best, &error))?)?;
    let path = pipeline.out.join("README.md");
    write(&path, card(pipeline, steps)?)?;
    let (weights, path) = (weights.display(), path.display());
    print(format_args!("\nweights  {weights}\ncard     {path}\n"))?;
    Ok(ExitCode::Ok)
}

fn write_settings(pipeline: &Pipeline) -> Result<(), Failure> {
    pipeline.settings()?.into_iter().try_for_each(|(name, text)| write(&pipeline.out.join(name), text))
}

/// Takes a step, with its progress and its results on the terminal.
fn execute(action: &Action, stop: &AtomicBool) -> Result<ExitCode, Failure> {
    match action {
        Action::Generate { config, attempts, shards, seed, policy, out } => {
            let set = Action::generator_settings(policy.as_deref());
            let overrides = Overrides {
                seed: Some(*seed),
                shards: Some(*shards),
                attempts: Some(*attempts),
                policy: policy.as_deref(),
                set: &set,
            };
            let config = generator::Config::load(Some(config), overrides)?;
            let all: Vec<u32> = (0..config.shards).collect();
            generate::execute(&config, &Location::from(out.as_path()), &all, REJECTED_SHARE_MAX, stop)
        }
        Action::Fit { config, epochs, run, data, from } => {
            let (config, from) = training::fit::config(Some(config), Some(*epochs), from.as_deref())?;
            let data: Vec<Location> = data.iter().map(|data| Location::from(data.as_path())).collect();
            let (config, from, device) = (&config, from.as_ref(), &Device::Host);
            training::fit::execute(&Job { data: &data, config, run, from, resume: true, device }, stop)
        }
        Action::Evaluate { run, data, report } => {
            let (data, report) = (Location::from(data.as_path()), Some(report.as_path()));
            training::evaluate::execute(&SavedAs::Best.path(run), &data, TestSet::All, None, false, report)
        }
        Action::Experiment { config, out, seed, rounds, set } => {
            let config = experiment::run::config(config, set, Some(u64::from(*rounds)), Some(*seed))?;
            experiment::run::execute(&config, out, experiment::run::cores(), stop, action.command())
        }
    }
}
