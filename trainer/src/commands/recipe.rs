//! `trainer recipe`: from a hand to a judge's weights in one command.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clap::Args;
use network::checkpoint;
use program::{Context, ExitCode, Failure, print, start_beside, stop_on_signals, write};
use trainer::recipe::{MANY_HANDS, Recipe, Seen, Step, Things, card, is_known, must_answer_for};

/// From a hand to weights: execute attempts, a quarter of them the choices of a judge of many hands, go on training it
/// on the outcomes, and try it.
///
/// Where no such judge answers for the hand, or for many hands, there are two rounds: execute attempts, train a judge,
/// execute some of its own choices, train it on both. Every step is a command of one of the programs, which is printed
/// before it runs. Interrupt the recipe and start it again: it goes on where it stopped. The same arguments give the
/// same weights.
#[derive(Args)]
#[command(after_help = ExitCode::HELP)]
pub(crate) struct Arguments {
    /// The hand: a built-in name, the path of a file that ends in .toml (docs/own-gripper.md), or any_jaw for a judge
    /// that serves every hand within ranges.
    hand: String,
    /// The folder of datasets, weights, settings, evaluation, and README.md, the card of the weights.
    #[arg(long)]
    out: PathBuf,
    /// Attempts of all rounds together.
    #[arg(long, default_value_t = 1_500_000, value_parser = clap::value_parser!(u64).range(3_600..=1_000_000_000))]
    attempts: u64,
    /// From where the scenes are seen.
    #[arg(long, value_parser = seen, default_value = "anywhere")]
    views: Seen,
    /// Objects to which half of the attempts go: a catalogue's file (docs/own-objects.md), or household for the kinds
    /// of docs/household-objects.md, of which nine are kept for a test.
    #[arg(long, value_name = "FILE")]
    objects: Option<PathBuf>,
    /// Weights to begin with, of a judge that answers for the hand, or nothing [default: for a single hand the built-in
    /// judge of many hands if it answers for it, else nothing].
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    /// Seed of the first dataset.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(..1 << 60))]
    seed: u64,
    /// Print the steps and how long they will take, and end.
    #[arg(long)]
    dry_run: bool,
}

fn seen(text: &str) -> Result<Seen, String> {
    let names = || Seen::ALL.map(Seen::name).join(", ");
    Seen::from_name(text).ok_or_else(|| format!("must be one of {}, got {text}", names()))
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
    let recipe = Recipe {
        hand,
        out,
        from,
        seed: arguments.seed,
        attempts: arguments.attempts,
        seen: arguments.views,
        objects: match arguments.objects.as_deref() {
            None => None,
            Some(word) if word == Path::new("household") => Some(Things::Household),
            Some(file) => Some(Things::File(absolute(file)?)),
        },
    };
    let steps = recipe.steps()?;
    fs::create_dir_all(&recipe.out).context(format_args!("failed to make {}", recipe.out.display()))?;
    if arguments.from.is_none() && recipe.from.is_some() {
        write(&built_in, MANY_HANDS.0)?;
    }
    write_settings(&recipe)?;
    let left: Vec<&Step> = steps.iter().filter(|step| !step.done.exists()).collect();
    if arguments.dry_run || left.len() == steps.len() {
        let minutes = estimated(&recipe)?.as_secs() / 60 + 1;
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        print(format_args!("{} steps, about {} h {} min on {cores} cores\n", steps.len(), minutes / 60, minutes % 60))?;
    }
    if arguments.dry_run {
        for Step { what, program, arguments, .. } in &steps {
            print(format_args!("\n# {what}\n{program} {}\n", arguments.join(" ")))?;
        }
        return Ok(ExitCode::Ok);
    }
    // A signal reaches the step's program, too, which stops where it can go on; its exit code ends the recipe.
    let stop = stop_on_signals(|| ()).context("failed to listen for signals")?;
    for (number, step) in steps.iter().enumerate() {
        let Step { what, program, arguments, .. } = step;
        print(format_args!("\n[{} of {}] {what}\n{program} {}\n", number + 1, steps.len(), arguments.join(" ")))?;
        // The other programs know what is done.
        if arguments[0] == "evaluate" && step.done.exists() {
            continue;
        }
        let code = started(program, arguments)?;
        let code = if code == 0 && stop.load(Ordering::Relaxed) { ExitCode::TryAgain.code().into() } else { code };
        if code != 0 {
            print(format_args!("\nthe same command goes on with this step: {what}\n"))?;
            return Ok(ExitCode::from_code(code));
        }
    }
    let weights = recipe.out.join("judge.safetensors");
    fs::copy(recipe.weights(), &weights).context(format_args!("failed to write {}", weights.display()))?;
    let path = recipe.out.join("README.md");
    write(&path, card(&recipe, &steps)?)?;
    let (weights, path) = (weights.display(), path.display());
    print(format_args!("\nweights  {weights}\ncard     {path}\n"))?;
    Ok(ExitCode::Ok)
}

fn write_settings(recipe: &Recipe) -> Result<(), Failure> {
    recipe.settings()?.into_iter().try_for_each(|(name, text)| write(&recipe.out.join(name), text))
}

/// Runs a program; its exit code.
fn started(program: &str, arguments: &[String]) -> Result<i32, Failure> {
    let status = start_beside(program)?.args(arguments).status();
    let status = status.context(format_args!("failed to start {program}"))?;
    // A signal ended it.
    Ok(status.code().unwrap_or(i32::from(ExitCode::TryAgain.code())))
}

/// How long the recipe takes, from the same one with few attempts.
fn estimated(recipe: &Recipe) -> Result<Duration, Failure> {
    let folder = tempfile::tempdir().context("failed to make a folder for the estimate")?;
    let (pilot, steps) = recipe.pilot(folder.path())?;
    write_settings(&pilot)?;
    let mut spent = Vec::new();
    for step in &steps {
        let began = Instant::now();
        let output = start_beside(step.program)?.args(&step.arguments).output();
        let output = output.context(format_args!("failed to start {}", step.program))?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
            return Err(Failure::new(ExitCode::Config, said.trim_start_matches("error: ").to_owned()));
        }
        spent.push(began.elapsed());
    }
    Ok(recipe.time(&spent))
}
