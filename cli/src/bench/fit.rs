//! `graspmill bench fit`: what a training step costs on this machine.

use clap::Args;
use program::{ExitCode, Failure, json, print, print_error, start_threads};
use shards::Location;
use trainer::bench::bench;
use trainer::device::DeviceName;

use crate::parse::LocationParser;

/// Measure what a training step costs on this machine.
#[derive(Debug, Args)]
#[command(after_help = ExitCode::HELP)]
pub(crate) struct Arguments {
    /// Samples of a batch.
    #[arg(long, default_value_t = 48, value_parser = clap::value_parser!(u16).range(1..=4096))]
    batch: u16,
    /// A dataset's folder or URL, to measure reading too.
    #[arg(long, value_parser = LocationParser)]
    data: Option<Location>,
    /// Read as if the dataset were there so many times, each with scenes of its own; for the judge it is read once.
    #[arg(long, default_value_t = 1, requires = "data", value_parser = clap::value_parser!(u16).range(1..=10_000))]
    times: u16,
    /// Threads; all cores by default.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// The device: cpu, wgpu or wgpu:N, if the program was built for it.
    #[arg(long, default_value_t)]
    device: DeviceName,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    start_threads(arguments.threads)?;
    let device = arguments.device.open()?;
    let phase = |name: &str| print_error(&format!("measuring {name}"));
    let report = bench(
        arguments.batch.into(),
        arguments.data.as_ref().map(|data| (data, arguments.times.into())),
        &device,
        &phase,
    )?;
    print(if arguments.json { json(&report)? } else { report.document().markdown() })?;
    Ok(ExitCode::Ok)
}
