//! The program `shards`: looks at datasets, exports them, changes nothing in them.

mod export_command;

use std::io::{self, IsTerminal, Write};

use anyhow::{Context, Result};
use clap::{Parser, Subcommand};
use export_command::ExportArguments;
use shards::{Dataset, ExitCode, ExportError, Inspection, Location, LocationParser, ReadError, Verified, text};

const EXAMPLES: &str = "\
Examples:
  shards verify data/demo               read and check everything
  shards report data/demo               statistics with bars
  shards report data/demo --json        the same for programs
  shards inspect data/demo --scene 17   one scene: objects, attempts, cuts through its grid
  shards verify s3://bucket/demo        the same in an object store
  shards export data/demo --format vgn --out data/demo-vgn    what VGN's and GIGA's Python code trains on";

/// Verify, report on, inspect and export a dataset of grasp attempts. Nothing in it is ever changed.
#[derive(Debug, Parser)]
#[command(name = "shards", version, after_help = format!("{EXAMPLES}\n\n{}\n\n{}", Location::HELP, ExitCode::HELP))]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Check every checksum, row, key and count; exit 65 and name what is wrong.
    #[command(after_help = "\
To mend a damaged shard, delete the named file and run the generator again with the same config, seed and shards: it
makes that shard anew, byte for byte, and leaves the others alone.")]
    Verify {
        /// The dataset's folder or URL.
        #[arg(value_parser = LocationParser)]
        dataset: Location,
    },
    /// Count attempts: positives by shape, rule and objects in the scene; outcomes, widths, angles, sizes.
    Report {
        /// The dataset's folder or URL.
        #[arg(value_parser = LocationParser)]
        dataset: Location,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Show one scene: objects, cameras, attempts, two cuts through its voxel grid.
    Inspect {
        /// The dataset's folder or URL.
        #[arg(value_parser = LocationParser)]
        dataset: Location,
        /// The scene's number, from 0.
        #[arg(long)]
        scene: u64,
    },
    /// Write the dataset in a format of others: VGN's and GIGA's files, or WebDataset's tars.
    #[command(after_help = export_command::EXAMPLES)]
    Export(ExportArguments),
}

fn main() -> std::process::ExitCode {
    let cli = Cli::parse();
    let code = match run(&cli.command) {
        Ok(code) => code,
        Err(error) if is_broken_pipe(&error) => ExitCode::Ok, // whoever read our output had enough
        Err(error) => {
            let _ = writeln!(io::stderr(), "error: {}", text::told(error.as_ref())); // nowhere left to complain
            exit_code(&error)
        }
    };
    code.into()
}

fn run(command: &Command) -> Result<ExitCode> {
    match command {
        Command::Verify { dataset } => verify(dataset),
        Command::Report { dataset, json } => {
            let report = shards::report(&Dataset::open(dataset)?)?;
            if *json { print(report.to_json()) } else { print(report) }
        }
        Command::Inspect { dataset, scene } => {
            let dataset = Dataset::open(dataset)?;
            let rows = dataset.read_scene(*scene)?;
            print(Inspection { info: dataset.info(), rows: &rows })
        }
        Command::Export(arguments) => export_command::run(arguments),
    }
}

fn verify(dataset: &Location) -> Result<ExitCode> {
    let mut stderr = io::stderr();
    let shows_progress = stderr.is_terminal();
    let verified = shards::verify(dataset, |shard| {
        if shows_progress {
            let _ = write!(stderr, "\rshard {shard} read "); // a sign of life, worth no failure
        }
    })?;
    if shows_progress {
        let _ = write!(stderr, "\r\x1b[K");
    }
    let Verified { counts, bytes, problems, more, listed, .. } = &verified;
    let mut out = io::stdout().lock();
    for problem in problems {
        writeln!(out, "{problem}")?;
    }
    if *more > 0 {
        writeln!(out, "and {more} more")?;
    }
    let (attempts, objects, scenes) = (counts.labels.attempts, counts.objects, counts.scenes);
    writeln!(out, "{attempts} attempts, {objects} objects, {scenes} scenes, {bytes} bytes read and checked")?;
    if !listed {
        writeln!(out, "the store does not list what it holds: files beside the dataset's were not looked for")?;
    }
    if verified.is_ok() {
        writeln!(out, "ok")?;
        return Ok(ExitCode::Ok);
    }
    writeln!(out, "NOT ok: {} problems", problems.len() as u64 + more)?;
    Ok(verified.exit_code())
}

fn print(text: impl std::fmt::Display) -> Result<ExitCode> {
    write!(io::stdout().lock(), "{text}").context("failed to print")?;
    Ok(ExitCode::Ok)
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.root_cause().downcast_ref::<io::Error>().is_some_and(|e| e.kind() == io::ErrorKind::BrokenPipe)
}

fn exit_code(error: &anyhow::Error) -> ExitCode {
    let read = error.downcast_ref::<ReadError>().map(ReadError::exit_code);
    let export = || error.downcast_ref::<ExportError>().map(ExportError::exit_code);
    let io = || error.root_cause().downcast_ref::<io::Error>().map(|_| ExitCode::TryAgain);
    read.or_else(export).or_else(io).unwrap_or(ExitCode::Internal)
}
