//! `graspmill dataset browse`: scenes of a dataset, or objects with labelled grasps, as a folder of pages.

use std::path::{Path, PathBuf};

use clap::Args;
use indicatif::ProgressBar;
use inspect::{Replays, browse, browse_grasps, grasp_sets, spread};
use program::{ExitCode, Failure, print, print_error};
use shards::{Dataset, Location};

use crate::parse::LocationParser;
use crate::progress::style;

/// Attempts that are shown of a large dataset unless more scenes are asked for: their pages take about 100 MB.
const ATTEMPTS: u64 = 24_000;

/// Write scenes as pages that lead to each other: all scenes, each in 3-D with its depth images and a replay of every
/// attempt, the report. Of a folder of objects annotate: all objects, each with its grasps and replays.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The dataset's folder or URL, or the folder of objects annotate.
    #[arg(value_parser = LocationParser)]
    dataset: Location,
    /// The folder of the pages, new or of an earlier call; open its index.html in a browser.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// How many scenes, spread evenly over the dataset [default: all, of large datasets those of 24,000 attempts];
    /// or objects
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    scenes: Option<u64>,
    /// A scene's number, or an object's in the order of names from 0, in place of a choice; may be repeated.
    #[arg(long, value_name = "N", conflicts_with = "scenes")]
    scene: Vec<u64>,
    /// Leave out the replays: most of the bytes and of the time.
    #[arg(long)]
    no_replays: bool,
}

/// Why grasps of files and attempts end otherwise than stored.
const ROUNDED: &str = "files round poses, and these are on the verge";
const CHANGED: &str = "another version made the dataset, or it was changed; graspmill dataset repeat names them";

/// Executes the scenes' attempts again. Where the dataset is of another engine, or attempts end otherwise than stored,
/// that is said, and the pages of the scenes are made nevertheless.
pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    if let Location::Path(folder) = &arguments.dataset
        && folder.is_dir()
    {
        let names = grasp_sets(folder)?;
        if !names.is_empty() {
            let count = names.len() as u64;
            let numbers = chosen(arguments, count, 0)?;
            let names: Vec<String> = numbers.iter().map(|number| names[*number as usize].clone()).collect();
            return grasp_pages(folder, &names, &arguments.out, !arguments.no_replays);
        }
    }
    let dataset = Dataset::open(&arguments.dataset)?;
    let scenes = chosen(arguments, dataset.info().scene_count, dataset.info().attempt_count)?;
    let bar = ProgressBar::new(scenes.len() as u64).with_style(style("scenes"));
    let done = browse(&dataset, &scenes, &arguments.out, !arguments.no_replays, &|| bar.inc(1))?;
    bar.finish_and_clear();
    told(&done, &arguments.out, "attempts", CHANGED)
}

/// The pages of the sets of grasps of these names in a folder.
pub(crate) fn grasp_pages(folder: &Path, names: &[String], out: &Path, has_replays: bool) -> Result<ExitCode, Failure> {
    told(&browse_grasps(folder, names, out, has_replays)?, out, "grasps", ROUNDED)
}

fn told(done: &Replays, out: &Path, what: &str, why: &str) -> Result<ExitCode, Failure> {
    print(format_args!("{}\n", out.join("index.html").display()))?;
    if done.others > 0 {
        let (others, count) = (done.others, done.count);
        print_error(&format!("{others} of {count} replayed {what} end otherwise than stored: {why}"));
    }
    let Some(failure) = &done.trouble else { return Ok(ExitCode::Ok) };
    print_error(&format!("not all {what} have replays: {failure}"));
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
