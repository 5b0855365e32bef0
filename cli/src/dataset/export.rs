//! `graspmill dataset export`: arguments, progress, and the summary at the end.

use std::fmt::Write;

use clap::Args;
use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use inspect::{ExportFormat, SceneSelection};
use program::text::{grouped, per_second};
use program::{ExitCode, Failure, print};
use shards::{Dataset, Location};

use crate::parse::{LocationParser, one_of};

const EXAMPLES: &str = "\
Examples:
  graspmill dataset export grasps --format vgn --out grasps-vgn
  graspmill dataset export s3://bucket/grasps --format vgn --out grasps-vgn
  graspmill dataset export grasps --format parquet --out grasps-plain    for old polars and fastparquet
  graspmill dataset export grasps --format mjcf --scenes 0-9,17 --out grasps-mujoco    a folder a scene

An interrupted export continues when it is run again. docs/exporting.md describes the files and how to read them.";

/// Write the dataset as the files that VGN's and GIGA's code trains on, as Parquet for old readers, or its scenes for
/// simulators.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// The dataset's folder or URL.
    #[arg(value_parser = LocationParser)]
    dataset: Location,
    /// The format: what VGN and GIGA read; Parquet in the plain encoding; or scenes for MuJoCo (mjcf), for PyBullet and
    /// others (urdf), for Isaac Sim and others (usda).
    #[arg(long, value_parser = one_of!(ExportFormat))]
    format: ExportFormat,
    /// Only these scenes, such as 0-9,17; of mjcf, urdf and usda.
    #[arg(long, value_name = "N,FIRST-LAST")]
    scenes: Option<SceneSelection>,
    /// A new or an empty folder, or that of the same export, interrupted: it continues there.
    #[arg(long, value_parser = LocationParser)]
    out: Location,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let dataset = Dataset::open(&arguments.dataset)?;
    let scenes = arguments.scenes.as_ref();
    let bar = progress_bar(scenes.map_or(dataset.info().scene_count, SceneSelection::count));
    let exported = inspect::export(&dataset, arguments.format, scenes, &arguments.out, |scenes| bar.inc(scenes));
    bar.finish_and_clear();
    let counts = exported?.counts;
    let (grasps, positives, scenes) = (grouped(counts.grasps), grouped(counts.positives), grouped(counts.scenes));
    print(format_args!("{grasps} grasps ({positives} positive) in {scenes} scenes: {}\n", arguments.out))?;
    if counts.left_out > 0 {
        let (grasps, scenes) = (grouped(counts.left_out), grouped(counts.scenes_left_out));
        print(format_args!(
            "left out: {grasps} grasps outside the grid or near its faces, {scenes} scenes without others\n"
        ))?;
    }
    Ok(ExitCode::Ok)
}

fn progress_bar(scenes: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:32} {human_pos}/{human_len} scenes · {rate} · {eta} left");
    let rate = |state: &ProgressState, out: &mut dyn Write| {
        let _ = out.write_str(&per_second(state.per_sec()));
    };
    let style = style.map(|style| style.with_key("rate", rate));
    let bar = ProgressBar::new(scenes);
    // Without a terminal indicatif draws nothing.
    bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
