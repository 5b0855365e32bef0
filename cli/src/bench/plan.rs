//! `graspmill bench plan`: what a plan costs on this machine.

use std::path::PathBuf;

use clap::Args;
use planner::bench::bench;
use planner::input::{InputError, assemble, from_file};
use planner::{Observation, demo};
use program::{ExitCode, Failure, json, print};

use crate::planning::{NetworkArguments, console};

/// Measure the time of a plan on this machine
#[derive(Debug, Args)]
#[command(after_help = ExitCode::HELP)]
pub(crate) struct Arguments {
    /// How often to plan
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    plans: u32,

    /// Depth images and cameras [default: the demo]
    #[arg(long, value_name = "FILE")]
    views: Option<PathBuf>,

    /// Print JSON
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    network: NetworkArguments,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let planner = arguments.network.planner()?;
    let request = match &arguments.views {
        Some(path) => from_file(path, planner.grid, |_| ())?,
        None => assemble(&demo::request()?, None, planner.grid)?,
    };
    let Observation::Views(views) = &request.observation else {
        return Err(InputError::Value("the bench needs depth images: --views".to_owned()).into());
    };
    let report = bench(&planner, views, request.wishes.workspace_size_m, arguments.plans as usize)?;
    print(if arguments.json { json(&report)? } else { console::bench(&report) })?;
    Ok(ExitCode::Ok)
}
