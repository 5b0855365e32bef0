//! `graspmill fit`: trains a network, or continues training it.

use std::path::PathBuf;

use clap::Args;
use network::checkpoint;
use program::{Context, ExitCode, Failure, print, start_threads, stop_on_signals};
use shards::Location;
use trainer::config::Config;
use trainer::device::DeviceName;
use trainer::fit::{Ending, Job, fit};
use trainer::run_folder::BEST;

use super::console::Screen;
use crate::parse::LocationParser;

/// Train a network, or continue training it
#[derive(Debug, Args)]
#[command(after_help = format!("{}\n\n{}", Location::HELP, ExitCode::HELP))]
pub(crate) struct Arguments {
    /// The dataset's folder or URL; several are trained on together.
    #[arg(long, required = true, value_parser = LocationParser)]
    data: Vec<Location>,
    /// The recipe [default: the built-in configs/train/paper.toml].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// The run's folder: checkpoints and metrics (metrics.jsonl).
    #[arg(long)]
    run: PathBuf,
    /// Continue from the run's last checkpoint, or begin if there is none.
    #[arg(long)]
    resume: bool,
    /// Begin with the weights of a checkpoint instead of random ones; with --resume give the same file.
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    /// Epochs, in place of the recipe's.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    epochs: Option<u32>,
    /// Threads; all cores by default. Does not change the result.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// The device: cpu, wgpu or wgpu:N, if the program was built for it. Only the CPU gives the same bits
    /// in every run.
    #[arg(long, default_value_t)]
    device: DeviceName,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut config = Config::load(arguments.config.as_deref())?;
    config.training.epochs = arguments.epochs.unwrap_or(config.training.epochs);
    let (from, digest) = arguments.from.as_deref().map(checkpoint::read_digested).transpose()?.unzip();
    config.from = digest.or(config.from);
    start_threads(arguments.threads)?;
    let stop = stop_on_signals(|| ()).context("failed to listen for signals")?;
    let (data, run, device) = (arguments.data.as_slice(), arguments.run.as_path(), arguments.device.open()?);
    let job = Job { data, config: &config, run, from: from.as_ref(), resume: arguments.resume, device: &device };
    let screen = Screen::new(&config);
    let ending = fit(&job, &stop, &|event| screen.show(&event))?;
    screen.end();
    match ending {
        Ending::Done => {
            let (best, run) = (run.join(BEST), run.display());
            // Of several datasets nothing is held out that could be found again.
            let next = if let [one] = data { one.to_string() } else { "ANOTHER".to_owned() };
            print(format_args!(
                "\nbest weights  {}\n\
                 metrics       {run}/metrics.jsonl\n\
                 next          graspmill evaluate --run {run} --data {next}\n",
                best.display()
            ))?;
            Ok(ExitCode::Ok)
        }
        Ending::Stopped => {
            print("\nstopped by a signal; the same command with --resume continues exactly where it stopped\n")?;
            Ok(ExitCode::TryAgain)
        }
    }
}
