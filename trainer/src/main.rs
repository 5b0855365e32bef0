//! The `trainer` program: arguments in, library calls, text out.

mod console;
mod convert;
mod show;

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;

use anyhow::Context;
use clap::{Args, CommandFactory, Parser, Subcommand, ValueEnum};
use convert::{ExportArgs, ImportArgs};
use network::interchange::InterchangeError;
use program::Exit as _;
use program::manual::{Manual, Settings};
use shards::{Location, LocationParser};
use show::ReportArgs;
use trainer::bench::bench;
use trainer::config::Config;
use trainer::curves::{CurvesError, draw_curves};
use trainer::device::{DeviceError, DeviceName};
use trainer::evaluate::report::{ReportError, write_report};
use trainer::evaluate::{EvaluateError, TestSet, evaluate};
use trainer::fit::{Ending, FitError, Job, fit_job};
use trainer::page::PageError;
use trainer::run_folder::checkpoint_path;

/// Trains the volumetric grasp network on a Graspmill dataset.
#[derive(Parser)]
#[command(version, after_help = format!("{EXAMPLES}\n\n{}", program::ExitCode::HELP))]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Train, or go on training.
    #[command(after_help = format!("{}\n\n{}", Location::HELP, program::ExitCode::HELP))]
    Fit(FitArgs),
    /// What a checkpoint is worth on a dataset: accuracy, precision–recall, calibration, errors of the grasps.
    #[command(after_help = format!("{}\n\n{}", Location::HELP, program::ExitCode::HELP))]
    Evaluate(EvaluateArgs),
    /// Draw a run's curves again from its metrics.jsonl: loss.svg, loss.png, accuracy.svg, accuracy.png.
    #[command(after_help = program::ExitCode::HELP)]
    Curves(CurvesArgs),
    /// A run as a page, one file with everything in it: curves, recipe and, on a dataset, what the best checkpoint is worth and its worst
    /// mistakes, with pictures.
    #[command(after_help = format!("{}\n\n{}\n\n{}", show::EXAMPLES, Location::HELP, program::ExitCode::HELP))]
    Report(ReportArgs),
    /// What a training step costs on this machine.
    #[command(after_help = program::ExitCode::HELP)]
    Bench(BenchArgs),
    /// Make a checkpoint of weights that PyTorch or another program wrote.
    #[command(after_help = format!("{}\n\n{}", convert::IMPORT_EXAMPLES, program::ExitCode::HELP))]
    Import(ImportArgs),
    /// Write a checkpoint's weights for PyTorch or an ONNX runtime.
    #[command(after_help = format!("{}\n\n{}", convert::EXPORT_EXAMPLES, program::ExitCode::HELP))]
    Export(ExportArgs),
    /// Write shell completions, man pages, or this program's reference.
    #[command(subcommand)]
    Manual(Manual),
}

const EXAMPLES: &str = "\
Examples:
  trainer fit --data grasps --run runs/paper                                the paper's recipe; --resume goes on
  trainer fit --data grasps --config configs/train/quick.toml --run runs/quick
  trainer evaluate --data grasps --run runs/paper --split test-scenes --report runs/paper/report
  trainer report runs/paper --data grasps --html paper.html                 the run as a page
  trainer export runs/paper/best.safetensors --format onnx --out vgn.onnx";

#[derive(Args)]
struct BenchArgs {
    /// Samples of a batch.
    #[arg(long, default_value_t = 48, value_parser = clap::value_parser!(u16).range(1..=4096))]
    batch: u16,
    /// A dataset's folder or URL, to measure reading too.
    #[arg(long, value_parser = LocationParser)]
    data: Option<Location>,
    /// Threads; all cores by default.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// What computes: cpu, cuda, cuda:N, wgpu or wgpu:N, as far as the program was built for it.
    #[arg(long, default_value_t)]
    device: DeviceName,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
struct FitArgs {
    /// The dataset's folder or URL.
    #[arg(long, value_parser = LocationParser)]
    data: Location,
    /// The recipe [default: the built-in configs/train/paper.toml].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// The run's folder: checkpoints, metrics, curves (loss.svg, accuracy.svg, PNG too), events for TensorBoard
    /// (tensorboard/), and while training 256 kB a scene of decoded grids.
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
    /// What computes: cpu, cuda, cuda:N, wgpu or wgpu:N, as far as the program was built for it. Only the CPU gives the same
    /// bits in every run.
    #[arg(long, default_value_t)]
    device: DeviceName,
}

#[derive(Args)]
struct CurvesArgs {
    /// The run's folder.
    #[arg(long)]
    run: PathBuf,
}

#[derive(Args)]
struct EvaluateArgs {
    /// The run's folder.
    #[arg(long, required_unless_present = "model")]
    run: Option<PathBuf>,
    /// Which of its checkpoints.
    #[arg(long, value_enum, default_value_t = Which::Best)]
    checkpoint: Which,
    /// A checkpoint's file, in place of a run's.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["run", "checkpoint"])]
    model: Option<PathBuf>,
    /// The dataset's folder or URL.
    #[arg(long, value_parser = LocationParser)]
    data: Location,
    /// Which samples.
    #[arg(long, value_enum, default_value_t = SplitArg::TestAttempts)]
    split: SplitArg,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// A folder for evaluation.md, evaluation.json, and pictures of precision–recall and calibration (SVG and PNG).
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
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

impl From<SplitArg> for TestSet {
    fn from(split: SplitArg) -> Self {
        match split {
            SplitArg::TestAttempts => Self::TestAttempts,
            SplitArg::TestScenes => Self::TestScenes,
            SplitArg::All => Self::All,
        }
    }
}

/// A failure with the code to end with.
struct Failure(anyhow::Error, program::ExitCode);

macro_rules! fail_with_their_own_code {
    ($($error:ty),+) => {$(
        impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                let code = error.exit_code();
                Self(error.into(), code)
            }
        }
    )+};
}

fail_with_their_own_code!(FitError, EvaluateError, InterchangeError, DeviceError, CurvesError, ReportError, PageError);

impl From<anyhow::Error> for Failure {
    fn from(error: anyhow::Error) -> Self {
        Self(error, program::ExitCode::Internal)
    }
}

fn main() -> ExitCode {
    let command = Cli::parse().command;
    let level = tracing_subscriber::filter::LevelFilter::WARN.into();
    let filter = tracing_subscriber::EnvFilter::builder().with_default_directive(level).with_env_var("GRASPMILL_LOG");
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_env_filter(filter.from_env_lossy())
        .init();
    if let Err(error) = program::writes_fail_at_the_file_size_limit() {
        tracing::warn!(%error, "a write beyond the file-size limit will end this program");
    }
    let outcome = match command {
        Command::Fit(args) => run_fit(&args),
        Command::Evaluate(args) => run_evaluate(&args),
        Command::Curves(args) => run_curves(&args),
        Command::Report(args) => show::run_report(&args),
        Command::Bench(args) => run_bench(&args),
        Command::Import(args) => convert::run_import(&args).map_err(Failure::from),
        Command::Export(args) => convert::run_export(&args).map_err(Failure::from),
        Command::Manual(manual) => run_manual(&manual),
    };
    match outcome {
        Ok(code) => code.into(),
        Err(Failure(error, code)) => {
            console::failure(&error);
            code.into()
        }
    }
}

fn run_manual(manual: &Manual) -> Result<program::ExitCode, Failure> {
    let settings = [Settings { path: "configs/train/paper.toml", toml: trainer::config::PAPER }];
    manual.make(Cli::command(), &settings, "").context("failed to write the manual")?;
    Ok(program::ExitCode::Ok)
}

fn run_fit(args: &FitArgs) -> Result<program::ExitCode, Failure> {
    let config = Config::load(args.config.as_deref());
    let mut config = config.map_err(|error| Failure(error.into(), program::ExitCode::Config))?;
    config.training.epochs = args.epochs.unwrap_or(config.training.epochs);
    set_threads(args.threads)?;
    let stop = program::stop_on_signals(|| ()).context("failed to listen for signals")?;
    let (data, run, device) = (&args.data, args.run.as_path(), args.device.open()?);
    let job = Job { data, config: &config, run, resume: args.resume, device: &device };
    let screen = console::Screen::new(&config);
    let ending = fit_job(&job, &stop, &|event| screen.show(&event))?;
    screen.end();
    let run = args.run.display();
    Ok(match ending {
        Ending::Done => {
            console::print(&format!("\nbest weights  {}", checkpoint_path(&args.run, "best").display()));
            console::print(&format!("metrics       {run}/metrics.jsonl, loss.svg, accuracy.svg"));
            console::print(&format!("TensorBoard   tensorboard --logdir {run}/tensorboard"));
            console::print(&format!("next          trainer evaluate --run {run} --data {}", args.data));
            program::ExitCode::Ok
        }
        Ending::Stopped => {
            console::print("\nstopped by a signal; to go on exactly where it was, the same command with --resume");
            program::ExitCode::TryAgain
        }
    })
}

fn run_evaluate(args: &EvaluateArgs) -> Result<program::ExitCode, Failure> {
    set_threads(args.threads)?;
    let set = args.split.into();
    let name = match args.checkpoint {
        Which::Best => "best",
        Which::Last => "last",
    };
    let path = match (&args.model, &args.run) {
        (Some(model), _) => model.clone(),
        (None, run) => checkpoint_path(run.as_deref().unwrap_or(Path::new(".")), name), // clap asks for one of the two
    };
    let evaluation = evaluate(&path, &args.data, set, &std::env::temp_dir(), &AtomicBool::new(false), &|| {})?;
    if args.json {
        console::print(&serde_json::to_string_pretty(&evaluation).context("failed to write JSON")?);
    } else {
        console::print(console::evaluation(&evaluation).trim_end());
    }
    if let Some(folder) = &args.report {
        write_report(&evaluation, folder)?;
    }
    Ok(program::ExitCode::Ok)
}

fn run_curves(args: &CurvesArgs) -> Result<program::ExitCode, Failure> {
    for path in draw_curves(&args.run)? {
        console::print(&format!("{}", path.display()));
    }
    Ok(program::ExitCode::Ok)
}

fn run_bench(args: &BenchArgs) -> Result<program::ExitCode, Failure> {
    set_threads(args.threads)?;
    let scratch = std::env::temp_dir();
    let device = args.device.open()?;
    let report = bench(args.batch.into(), args.data.as_ref(), &scratch, &device, &console::phase)?;
    if args.json {
        console::print(&serde_json::to_string_pretty(&report).context("failed to write JSON")?);
    } else {
        console::print(console::bench(&report).trim_end());
    }
    Ok(program::ExitCode::Ok)
}

fn set_threads(threads: Option<u16>) -> anyhow::Result<()> {
    let Some(threads) = threads else { return Ok(()) };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into());
    pool.build_global().context("failed to start the threads")
}
