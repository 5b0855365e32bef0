//! `shards export`: arguments, progress, and what is said at the end.

use std::io::{self, Write};

use anyhow::{Context, Result};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use program::{ExitCode, text};
use shards::{Dataset, ExportFormat, Location, LocationParser};

/// Shown by `--help`.
pub(crate) const EXAMPLES: &str = "\
Examples:
  shards export data/demo --format vgn --out data/demo-vgn
  shards export s3://bucket/demo --format webdataset --out data/demo-tars

An export that was stopped goes on when it is run again. docs/exporting.md says what the files hold and how they are read.";

/// What to export, as what, to where.
#[derive(Debug, Args)]
pub(crate) struct ExportArguments {
    /// The dataset's folder or URL.
    #[arg(value_parser = LocationParser)]
    dataset: Location,
    /// What reads it.
    #[arg(long, value_enum)]
    format: ExportFormat,
    /// A new or an empty folder, or one in which the same export was stopped: it goes on there.
    #[arg(long, value_parser = LocationParser)]
    out: Location,
}

/// Exports and says what came of it.
pub(crate) fn run(arguments: &ExportArguments) -> Result<ExitCode> {
    let dataset = Dataset::open(&arguments.dataset)?;
    let bar = progress_bar(dataset.info().scene_count);
    let exported = shards::export(&dataset, arguments.format, &arguments.out, |scenes| bar.inc(scenes));
    bar.finish_and_clear();
    let exported = exported?;
    let counts = &exported.counts;
    let grouped = text::grouped;
    let mut out = io::stdout().lock();
    writeln!(
        out,
        "{} grasps ({} positive) in {} scenes: {}",
        grouped(counts.grasps),
        grouped(counts.positives),
        grouped(counts.scenes),
        arguments.out
    )
    .context("failed to print")?;
    if counts.left_out > 0 {
        let (grasps, scenes) = (grouped(counts.left_out), grouped(counts.scenes_left_out));
        writeln!(out, "left out: {grasps} grasps outside the grid or near its faces, {scenes} scenes without others")
            .context("failed to print")?;
    }
    Ok(ExitCode::Ok)
}

fn progress_bar(scenes: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:32} {human_pos}/{human_len} scenes · {per_sec} · {eta} left");
    let bar = ProgressBar::new(scenes);
    // Without a terminal indicatif draws nothing.
    bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
