//! `graspmill dataset browse`: scenes of a dataset as a folder of pages.

use std::path::PathBuf;

use clap::Args;
use generator::packed_replays;
use inspect::{browse, spread};
use program::{ExitCode, Failure, print, print_error};
use shards::{Dataset, Location};

use crate::parse::LocationParser;

/// Attempts that are shown of a large dataset unless more scenes are asked for: their pages take about 100 MB.
const ATTEMPTS: u64 = 24_000;

/// Write scenes as pages that lead to each other: all scenes with filters, each in 3-D with its depth images and a
/// replay of every attempt, the report.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The dataset's folder or URL.
    #[arg(value_parser = LocationParser)]
    dataset: Location,
    /// The folder of the pages, new or of an earlier call; open its index.html in a browser.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// How many scenes, spread evenly over the dataset [default: all, of large datasets those of 24,000 attempts]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    scenes: Option<u64>,
    /// A scene's number, in place of a choice; may be repeated.
    #[arg(long, value_name = "N", conflicts_with = "scenes")]
    scene: Vec<u64>,
    /// Leave out the replays: most of the bytes and of the time.
    #[arg(long)]
    no_replays: bool,
}

/// Executes the scenes' attempts again. Where the dataset is of another engine, or attempts end otherwise than stored,
/// that is said, and the pages of the scenes are made nevertheless.
pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let dataset = Dataset::open(&arguments.dataset)?;
    let scenes = chosen(arguments, dataset.info().scene_count, dataset.info().attempt_count)?;
    let (mut trouble, mut others) = (None, 0);
    browse(&dataset, &scenes, &arguments.out, |rows, view| {
        if arguments.no_replays || trouble.is_some() {
            return Vec::new();
        }
        let made = packed_replays(&dataset, rows, view).map(|(replays, differ)| {
            others += differ;
            replays
        });
        made.unwrap_or_else(|failure| {
            trouble = Some(failure);
            Vec::new()
        })
    })?;
    print(format_args!("{}\n", arguments.out.join("index.html").display()))?;
    if others > 0 {
        print_error(&format!("{others} attempts end otherwise than stored"));
    }
    let Some(failure) = trouble else { return Ok(ExitCode::Ok) };
    print_error(&format!("not all attempts have replays: {failure}"));
    Ok(ExitCode::Partial)
}

/// The numbers of the scenes to show, ascending.
fn chosen(arguments: &Arguments, count: u64, attempts: u64) -> Result<Vec<u64>, Failure> {
    if arguments.scene.is_empty() {
        let few = (count.saturating_mul(ATTEMPTS) / attempts.max(1)).max(1);
        let wanted = arguments.scenes.unwrap_or(few).min(count);
        return Ok(spread(&(0..count).collect::<Vec<_>>(), wanted as usize)); // up to the count
    }
    let mut scenes = arguments.scene.clone();
    scenes.sort_unstable();
    scenes.dedup();
    match scenes.iter().find(|scene| **scene >= count) {
        Some(scene) => Err(Failure::new(ExitCode::Config, format!("scene must be below {count}, got {scene}"))),
        None => Ok(scenes),
    }
}
