//! The program `shards`: looks at datasets, exports them, changes nothing in them.

mod export_command;

use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result};
use clap::{CommandFactory, Parser, Subcommand};
use export_command::ExportArguments;
use program::manual::Manual;
use program::{Exit, ExitCode, publish, text};
use shards::report::html::HtmlError;
use shards::{Dataset, ExportError, Inspection, Location, LocationParser, ReadError, Table, Verified};

const EXAMPLES: &str = "\
Examples:
  shards verify data/demo               read and check everything
  shards report data/demo               statistics with bars
  shards report data/demo --json        the same for programs
  shards report data/demo --html r.html the same as a page, with pictures of scenes
  shards inspect data/demo --scene 17   one scene: objects, attempts, cuts through its grid
  shards view data/demo --scene 17 --out scene.html   the same in space, for a browser
  shards tsdf data/demo --scene 17 --out scene.npy    its voxel grid, for planner plan --tsdf
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
        #[arg(long, conflicts_with = "html")]
        json: bool,
        /// Write a page with figures and pictures of scenes, everything in one file.
        #[arg(long, value_name = "FILE")]
        html: Option<PathBuf>,
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
    /// Write one scene's TSDF as NumPy's array, [40, 40, 40] in VGN's values, for `planner plan --tsdf`.
    Tsdf {
        /// The dataset's folder or URL.
        #[arg(value_parser = LocationParser)]
        dataset: Location,
        /// The scene's number, from 0.
        #[arg(long)]
        scene: u64,
        /// The file; replaced if it is there.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
    /// Write the dataset in a format of others: VGN's and GIGA's files, or WebDataset's tars.
    #[command(after_help = export_command::EXAMPLES)]
    Export(ExportArguments),
    /// Show one scene in space: objects, surface, cameras and every attempt, as a page that needs nothing else.
    View {
        /// The dataset's folder or URL.
        #[arg(value_parser = LocationParser)]
        dataset: Location,
        /// The scene's number, from 0.
        #[arg(long)]
        scene: u64,
        /// The file; replaced if it is there. May be left out with --json, which then prints.
        #[arg(long, required_unless_present = "json", value_name = "FILE")]
        out: Option<PathBuf>,
        /// Write what the page shows as JSON instead; scripts/view_rrd.py makes a Rerun recording of it.
        #[arg(long)]
        json: bool,
    },
    /// Write shell completions, man pages, or this program's reference.
    #[command(subcommand)]
    Manual(Manual),
}

/// Voxels along a side, in the reference: the paper's.
const RESOLUTION: usize = 40;

fn main() -> std::process::ExitCode {
    let cli = Cli::parse();
    let code = match run(&cli.command) {
        Ok(code) => code,
        Err(error) if is_broken_pipe(&error) => ExitCode::Ok, // whoever read our output had enough
        Err(error) => {
            let _ = writeln!(io::stderr(), "error: {}", text::error_chain(error.as_ref())); // nowhere left to complain
            exit_code(&error)
        }
    };
    code.into()
}

fn run(command: &Command) -> Result<ExitCode> {
    match command {
        Command::Verify { dataset } => verify(dataset),
        Command::Manual(what) => manual(what),
        Command::Report { dataset, json, html } => {
            let dataset = Dataset::open(dataset)?;
            let report = shards::report(&dataset)?;
            match html {
                Some(path) => write_page(path, &shards::report::html::html(&report, &dataset, written_over(&dataset))?),
                None if *json => print(report.to_json()),
                None => print(report),
            }
        }
        Command::Inspect { dataset, scene } => {
            let dataset = Dataset::open(dataset)?;
            let rows = dataset.read_scene(*scene)?;
            print(Inspection { info: dataset.info(), rows: &rows })
        }
        Command::View { dataset, scene, out, json } => {
            let dataset = Dataset::open(dataset)?;
            let view = shards::scene_view(dataset.info(), dataset.id(), &dataset.read_scene(*scene)?);
            let Some(path) = out else { return print(view.to_json()) };
            shards::write_view(&view, *json, path).with_context(|| format!("failed to write {}", path.display()))?;
            Ok(ExitCode::Ok)
        }
        Command::Tsdf { dataset, scene, out } => {
            let bytes = shards::tsdf(&Dataset::open(dataset)?, *scene)?;
            publish(out, &bytes).with_context(|| format!("failed to write {}", out.display()))?;
            Ok(ExitCode::Ok)
        }
        Command::Export(arguments) => export_command::run(arguments),
    }
}

/// The reference ends with what all programs share: the tables on disk and the exit codes.
fn manual(manual: &Manual) -> Result<ExitCode> {
    let tables = Table::ALL.map(|table| format!("\n## Table `{}`\n\n{}", table.name(), table.markdown(RESOLUTION)));
    let chapters = format!("{}\n## Exit codes\n\n```text\n{}\n```\n", tables.concat(), ExitCode::HELP);
    manual.make(Cli::command(), &[], &chapters).context("failed to write the manual")?;
    Ok(ExitCode::Ok)
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

/// From the first to the last of a folder's markers, by their times: as long as making it took, if it was made in one go.
fn written_over(dataset: &Dataset) -> Option<Duration> {
    let Location::Path(folder) = dataset.location() else { return None };
    let meta = folder.join("meta");
    let modified = |name: &str| std::fs::metadata(meta.join(name)).and_then(|of| of.modified()).ok();
    modified("manifest.json")?.duration_since(modified("info.json")?).ok()
}

fn write_page(path: &Path, page: &str) -> Result<ExitCode> {
    publish(path, page.as_bytes()).with_context(|| format!("failed to write {}", path.display()))?;
    print(format!("{}\n", path.display()))
}

fn print(text: impl std::fmt::Display) -> Result<ExitCode> {
    write!(io::stdout().lock(), "{text}").context("failed to print")?;
    Ok(ExitCode::Ok)
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.root_cause().downcast_ref::<io::Error>().is_some_and(|e| e.kind() == io::ErrorKind::BrokenPipe)
}

fn exit_code(error: &anyhow::Error) -> ExitCode {
    let page = error.downcast_ref().map(HtmlError::exit_code);
    let read = error.downcast_ref::<ReadError>().map(ReadError::exit_code);
    let export = || error.downcast_ref::<ExportError>().map(ExportError::exit_code);
    let io = || error.root_cause().downcast_ref::<io::Error>().map(|_| ExitCode::TryAgain);
    page.or(read).or_else(export).or_else(io).unwrap_or(ExitCode::Internal)
}
