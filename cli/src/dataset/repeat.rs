//! `graspmill dataset repeat`: executes a dataset's attempts again.

use std::time::Instant;

use clap::Args;
use generator::repeat;
use program::{ExitCode, Failure, print, start_threads};
use schema::Engine;
use shards::{Dataset, Location};

use crate::parse::{LocationParser, one_of};

/// Execute a dataset's attempts again from its rows, and compare the outcomes
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder or URL of the dataset
    #[arg(value_parser = LocationParser)]
    dataset: Location,

    /// Only the first N scenes [default: all]
    #[arg(long, value_name = "N")]
    scenes: Option<u64>,

    /// Threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    threads: Option<u16>,

    /// Execute them by this engine instead of the dataset's: stepper or rapier. Openings then differ, so only outcomes
    /// are compared, and differences are no error
    #[arg(long, value_name = "ENGINE", value_parser = one_of!(Engine))]
    engine: Option<Engine>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    start_threads(arguments.threads)?;
    let dataset = Dataset::open(&arguments.dataset)?;
    let began = Instant::now();
    let repeated = repeat(&dataset, arguments.scenes.unwrap_or(u64::MAX), arguments.engine)?;
    let rate = repeated.attempts as f64 / began.elapsed().as_secs_f64();
    let mut text = format!(
        "{} attempts executed again at {rate:.0}/s: {} end otherwise than stored\n",
        repeated.attempts,
        repeated.different.len()
    );
    for one in repeated.different.iter().take(20) {
        let (stored, now) = (one.stored.name(), one.now.name());
        text += &format!("scene {}, attempt {}: stored {stored}, now {now}\n", one.scene_id, one.attempt_id);
    }
    print(text)?;
    Ok(if repeated.different.is_empty() || arguments.engine.is_some() { ExitCode::Ok } else { ExitCode::Data })
}
