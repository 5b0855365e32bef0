//! `graspmill dataset browse`: scenes of a dataset as a folder of pages.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use generator::replay_pages;
use inspect::{begin_browsing, browse, spread};
use program::{Context, ExitCode, Failure, print, print_error};
use shards::{Dataset, Location};

use crate::parse::LocationParser;

/// Write scenes as pages that lead to each other: all scenes with filters, each in 3-D with its depth images, a replay
/// of every attempt, the report.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The dataset's folder or URL.
    #[arg(value_parser = LocationParser)]
    dataset: Location,
    /// The folder of the pages, new or of an earlier call; open its index.html in a browser.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// How many scenes, spread evenly over the dataset.
    #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    scenes: u32,
    /// A scene's number, in place of a choice; may be repeated.
    #[arg(long, value_name = "N", conflicts_with = "scenes")]
    scene: Vec<u64>,
    /// Leave out the replays: most of the files and of the time.
    #[arg(long)]
    no_replays: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let dataset = Dataset::open(&arguments.dataset)?;
    let count = dataset.info().scene_count;
    let scenes = if arguments.scene.is_empty() {
        spread(&(0..count).collect::<Vec<_>>(), arguments.scenes as usize)
    } else {
        let mut scenes = arguments.scene.clone();
        scenes.sort_unstable();
        scenes.dedup();
        if let Some(scene) = scenes.iter().find(|scene| **scene >= count) {
            return Err(Failure::new(ExitCode::Config, format!("scene must be below {count}, got {scene}")));
        }
        scenes
    };
    begin_browsing(&arguments.out)?;
    if !arguments.no_replays {
        replay(&dataset, &scenes, &arguments.out)?;
    }
    browse(&dataset, &scenes, &arguments.out)?;
    print(format_args!("{}\n", arguments.out.join("index.html").display()))?;
    Ok(ExitCode::Ok)
}

/// Executes the scenes' attempts again, as pages for the folder. Where the dataset is of another engine, or attempts
/// end otherwise than stored, that is printed, and the pages of the scenes are made nevertheless.
fn replay(dataset: &Dataset, scenes: &[u64], folder: &Path) -> Result<(), Failure> {
    let (mut count, mut others) = (0_u64, 0_u64);
    for scene in scenes {
        let pages = match replay_pages(dataset, *scene) {
            Ok(pages) => pages,
            Err(failure) => {
                print_error(&format!("not all attempts have replays: {failure}"));
                return Ok(());
            }
        };
        for (name, page, is_reproduced) in pages {
            let path = folder.join(name);
            // Not worth waiting for the disk: there are as many pages as attempts, and they can be made again.
            fs::write(&path, page).context(format_args!("failed to write {}", path.display()))?;
            count += 1;
            others += u64::from(!is_reproduced);
        }
    }
    if others > 0 {
        print_error(&format!("{count} attempts executed again, {others} of them end otherwise than stored"));
    }
    Ok(())
}
