//! The `trainer` program: arguments in, library calls, text out.
#![expect(clippy::print_stdout, reason = "a program's results go to standard output")]

mod console;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;
use clap::builder::{OsStringValueParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};
use shards::Location;
use trainer::bench::bench;
use trainer::config::Config;
use trainer::evaluate::{EvaluateError, TestSet, evaluate};
use trainer::fit::{Ending, FitError, fit};
use trainer::run_folder::checkpoint_path;

/// The system's allocator gives every megabyte that a step frees back to the kernel and takes it again: 150 ms a step of
/// eight scenes; 75 ms with this one.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Trains the volumetric grasp network on a Graspmill dataset.
#[derive(Parser)]
#[command(version, after_help = shards::ExitCode::HELP)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Train, or go on training.
    #[command(after_help = format!("{}\n\n{}", Location::HELP, shards::ExitCode::HELP))]
    Fit(FitArgs),
    /// Accuracy, precision and recall of a checkpoint.
    #[command(after_help = format!("{}\n\n{}", Location::HELP, shards::ExitCode::HELP))]
    Evaluate(EvaluateArgs),
    /// What a training step costs on this machine.
    #[command(after_help = shards::ExitCode::HELP)]
    Bench(BenchArgs),
}

#[derive(Args)]
struct BenchArgs {
    /// Samples of a batch.
    #[arg(long, default_value_t = 48, value_parser = clap::value_parser!(u16).range(1..=4096))]
    batch: u16,
    /// A dataset's folder or URL, to measure reading too.
    #[arg(long, value_parser = OsStringValueParser::new().try_map(Location::parse))]
    data: Option<Location>,
    /// Threads; all cores by default.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
struct FitArgs {
    /// The dataset's folder or URL.
    #[arg(long, value_parser = OsStringValueParser::new().try_map(Location::parse))]
    data: Location,
    /// The recipe.
    #[arg(long, default_value = "configs/train/paper.toml")]
    config: PathBuf,
    /// The run's folder: checkpoints, metrics, and while training 256 kB a scene of decoded grids.
    #[arg(long)]
    run: PathBuf,
    /// Go on from the run's last checkpoint, or begin if there is none.
    #[arg(long)]
    resume: bool,
    /// Epochs, in place of the recipe's.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    epochs: Option<u32>,
    /// Threads; all cores by default. Does not change the result.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

#[derive(Args)]
struct EvaluateArgs {
    /// The run's folder.
    #[arg(long)]
    run: PathBuf,
    /// Which of its checkpoints.
    #[arg(long, value_enum, default_value_t = Which::Best)]
    checkpoint: Which,
    /// The dataset's folder or URL.
    #[arg(long, value_parser = OsStringValueParser::new().try_map(Location::parse))]
    data: Location,
    /// Which samples.
    #[arg(long, value_enum, default_value_t = SplitArg::TestAttempts)]
    split: SplitArg,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Threads; all cores by default.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Which {
    /// Of the epoch with the best test accuracy.
    Best,
    /// The latest.
    Last,
}

#[derive(Clone, Copy, ValueEnum)]
enum SplitArg {
    /// Held-out attempts of scenes that trained.
    TestAttempts,
    /// Held-out scenes.
    TestScenes,
    /// Every sample.
    All,
}

/// A failure with the code to end with.
struct Failure(anyhow::Error, shards::ExitCode);

impl From<FitError> for Failure {
    fn from(error: FitError) -> Self {
        let code = error.exit_code();
        Self(error.into(), code)
    }
}

impl From<EvaluateError> for Failure {
    fn from(error: EvaluateError) -> Self {
        let code = error.exit_code();
        Self(error.into(), code)
    }
}

impl From<anyhow::Error> for Failure {
    fn from(error: anyhow::Error) -> Self {
        Self(error, shards::ExitCode::Internal)
    }
}

fn main() -> ExitCode {
    let outcome = match Cli::parse().command {
        Command::Fit(args) => run_fit(&args),
        Command::Evaluate(args) => run_evaluate(&args),
        Command::Bench(args) => run_bench(&args),
    };
    match outcome {
        Ok(code) => code.into(),
        Err(Failure(error, code)) => {
            console::failure(&error);
            code.into()
        }
    }
}

fn run_fit(args: &FitArgs) -> Result<shards::ExitCode, Failure> {
    let mut config = Config::read(&args.config).map_err(|error| Failure(error.into(), shards::ExitCode::Config))?;
    config.epochs = args.epochs.unwrap_or(config.epochs);
    set_threads(args.threads)?;
    let stop = stop_on_signals()?;
    let screen = console::Screen::new(&config);
    let ending = fit(&args.data, &config, &args.run, args.resume, &stop, &|event| screen.show(&event))?;
    screen.end();
    let run = args.run.display();
    Ok(match ending {
        Ending::Done => {
            println!("\nbest weights  {}", checkpoint_path(&args.run, "best").display());
            println!("metrics       {run}/metrics.jsonl");
            println!("next          trainer evaluate --run {run} --data {}", args.data);
            shards::ExitCode::Ok
        }
        Ending::Stopped => {
            println!("\nstopped by a signal; to go on exactly where it was, the same command with --resume");
            shards::ExitCode::TryAgain
        }
    })
}

fn run_evaluate(args: &EvaluateArgs) -> Result<shards::ExitCode, Failure> {
    set_threads(args.threads)?;
    let set = match args.split {
        SplitArg::TestAttempts => TestSet::TestAttempts,
        SplitArg::TestScenes => TestSet::TestScenes,
        SplitArg::All => TestSet::All,
    };
    let name = match args.checkpoint {
        Which::Best => "best",
        Which::Last => "last",
    };
    let path = checkpoint_path(&args.run, name);
    let evaluation = evaluate(&path, &args.data, set, &std::env::temp_dir(), &AtomicBool::new(false), &|| {})?;
    if args.json {
        println!("{}", serde_json::to_string_pretty(&evaluation).context("failed to write JSON")?);
    } else {
        print!("{}", console::evaluation(&evaluation));
    }
    Ok(shards::ExitCode::Ok)
}

fn run_bench(args: &BenchArgs) -> Result<shards::ExitCode, Failure> {
    set_threads(args.threads)?;
    let scratch = std::env::temp_dir();
    let report = bench(args.batch.into(), args.data.as_ref(), &scratch, &console::phase)?;
    if args.json {
        println!("{}", serde_json::to_string_pretty(&report).context("failed to write JSON")?);
    } else {
        print!("{}", console::bench(&report));
    }
    Ok(shards::ExitCode::Ok)
}

fn set_threads(threads: Option<u16>) -> anyhow::Result<()> {
    let Some(threads) = threads else { return Ok(()) };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into());
    pool.build_global().context("failed to start the threads")
}

/// The first signal asks for a checkpoint; the second ends the program at once.
fn stop_on_signals() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    let handler = move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(shards::ExitCode::TryAgain.code().into());
        }
    };
    ctrlc::set_handler(handler).context("failed to listen for signals")?;
    Ok(stop)
}
