//! `shards browse`: scenes of a dataset as a folder of pages.

use std::path::{Path, PathBuf};
use std::process::Stdio;

use clap::Args;
use program::{Context, ExitCode, Failure, print, print_error, start_beside};
use shards::report::spread;
use shards::{Dataset, Location, begin_browsing, browse};

/// Write scenes as pages that lead to each other: all scenes with filters, each in 3-D with its depth images, a replay
/// of every attempt, the report.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The dataset's folder or URL.
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
    /// Leave out the replays, which `generator` makes: most of the files and of the time.
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

/// Has the program beside this one execute the scenes' attempts again. Without it, or if the dataset is not of its
/// engine, the pages have no replays, which is said.
fn replay(dataset: &Dataset, scenes: &[u64], folder: &Path) -> Result<(), Failure> {
    let mut command = match start_beside("generator") {
        Ok(command) => command,
        Err(failure) => {
            print_error(&format!("no replays: {failure}"));
            return Ok(());
        }
    };
    command.arg("replay").arg(dataset.location().to_string()).arg("--into").arg(folder);
    command.args(scenes.iter().flat_map(|scene| ["--scene".to_owned(), scene.to_string()]));
    let output = command.stdin(Stdio::null()).output().context("failed to start generator")?;
    let code = output.status.code();
    if code == Some(i32::from(ExitCode::Data.code())) && output.stderr.is_empty() {
        // It counts attempts that do not end as stored; their pages say so, too.
        print_error(String::from_utf8_lossy(&output.stdout).trim_end());
    } else if code != Some(0) {
        let said = String::from_utf8_lossy(&output.stderr);
        print_error(&format!("not all attempts have replays: {}", said.trim().trim_start_matches("error: ")));
    }
    Ok(())
}
