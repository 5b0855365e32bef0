//! Commands that plan grasps, and the arguments that they share.

pub(crate) mod console;
pub(crate) mod gripper;
pub(crate) mod plan;
pub(crate) mod serve;
pub mod show;

use std::path::PathBuf;

use clap::Args;
use planner::{Config, Planner};
use program::{Failure, start_threads};

/// The network and the settings.
#[derive(Debug, Args)]
pub(crate) struct NetworkArguments {
    /// Checkpoint of the network [default: the built-in one of the settings]
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,

    /// Settings: judge, paper or vgn, which come with the program, or a file [default: judge]
    #[arg(long, value_name = "NAME|FILE")]
    config: Option<PathBuf>,

    /// The gripper, in place of the settings': a built-in name, or the path of a file that ends in .toml
    #[arg(long, value_name = "NAME|FILE")]
    gripper: Option<String>,

    /// Threads; never changes the plan [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

impl NetworkArguments {
    /// Starts the threads and makes the planner.
    pub(crate) fn planner(&self) -> Result<Planner, Failure> {
        start_threads(self.threads)?;
        let mut config = Config::load(self.config.as_deref())?;
        if let Some(named) = &self.gripper {
            config.gripper = gripper::named(named)?;
        }
        Ok(match &self.model {
            Some(model) => Planner::new(model, config)?,
            None => Planner::built_in(config)?,
        })
    }
}
