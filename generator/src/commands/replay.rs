//! `generator replay`: executes stored attempts again and shows them.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use generator::{AttemptId, replay, replay_pages};
use program::{Context, ExitCode, Failure, print, print_error, write};
use shards::{Dataset, Location};

/// Execute a stored attempt again and show each step; exit 65 if the outcome differs
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder or URL of the dataset
    dataset: Location,

    /// Which attempt of which scene, both from 0
    #[arg(long, value_name = "SCENE/ATTEMPT", required_unless_present = "scene", conflicts_with = "scene")]
    attempt: Option<AttemptId>,

    /// A page for a browser, in one file, or JSON with --json; replaced if it exists
    #[arg(long, value_name = "FILE", requires = "attempt")]
    out: Option<PathBuf>,

    /// JSON instead of a page, printed if there is no --out; scripts/view_rrd.py makes a Rerun recording of it
    #[arg(long, requires = "attempt")]
    json: bool,

    /// All attempts of a scene, as pages for the folder that --into names; may be repeated
    #[arg(long, value_name = "N", requires = "into")]
    scene: Vec<u64>,

    /// A folder of `shards browse`, which calls this
    #[arg(long, value_name = "DIR", requires = "scene")]
    into: Option<PathBuf>,
}

/// The course of the attempt goes to standard output, unless the JSON goes there.
pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let dataset = Dataset::open(&arguments.dataset)?;
    let Some(attempt) = arguments.attempt else {
        return all(&dataset, &arguments.scene, arguments.into.as_deref().unwrap_or(Path::new(".")));
    };
    let replay = replay(&dataset, attempt)?;
    let shown = if arguments.json { replay.view.to_json() } else { replay.view.page() };
    match &arguments.out {
        Some(path) => {
            write(path, shown)?;
            print(replay.told())?;
        }
        None if arguments.json => {
            print(shown)?;
            if !replay.is_reproduced() {
                print_error(replay.told().trim_end());
            }
        }
        None => print(replay.told())?,
    }
    Ok(if replay.is_reproduced() { ExitCode::Ok } else { ExitCode::Data })
}

fn all(dataset: &Dataset, scenes: &[u64], folder: &Path) -> Result<ExitCode, Failure> {
    let (mut count, mut others) = (0_u64, 0_u64);
    for scene in scenes {
        for (name, page, is_reproduced) in replay_pages(dataset, *scene)? {
            let path = folder.join(name);
            // Not worth waiting for the disk: there are as many pages as attempts, and they can be made again.
            fs::write(&path, page).context(format_args!("failed to write {}", path.display()))?;
            count += 1;
            others += u64::from(!is_reproduced);
        }
    }
    print(format_args!("{count} attempts executed again, {others} of them end otherwise than stored\n"))?;
    Ok(if others == 0 { ExitCode::Ok } else { ExitCode::Data })
}
