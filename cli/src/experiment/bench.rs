//! `graspmill experiment bench`: how long plans take on this machine.

use std::path::{Path, PathBuf};

use clap::Args;
use experiments::bench::{Looks, time_plans};
use experiments::config::Config;
use experiments::statistics::Percentiles;
use program::text::key_and_value;
use program::{ExitCode, Failure, print, thread_pool};
use settings::Document;

use super::run::{config, cores, overrides};

/// The experiments of a bench without a file.
const ROWS: [(&str, &str); 4] = [
    ("pile.toml", include_str!("../../../configs/experiment/pile.toml")),
    ("giga-pile.toml", include_str!("../../../configs/experiment/giga-pile.toml")),
    ("giga-packed.toml", include_str!("../../../configs/experiment/giga-packed.toml")),
    ("wide-table.toml", include_str!("../../../configs/experiment/wide-table.toml")),
];

/// Time plans of an experiment's first looks, one after the other
#[derive(Debug, Args)]
#[command(after_help = ExitCode::HELP)]
pub(crate) struct Arguments {
    /// Experiments, as in configs/experiment [default: pile, giga-pile, giga-packed and wide-table]
    configs: Vec<PathBuf>,

    /// A key of the experiments or, as plan.KEY, of the planner's settings, in place of the file's; may be repeated
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value)]
    set: Vec<(String, String)>,

    /// Plans that are timed, each of another scene
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    plans: u32,

    /// The only seed of the scenes [default: the config's first]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,

    /// Time the next plans of a camera that moves, which takes so many images of each scene
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1000))]
    images: Option<u32>,

    /// Threads of a plan [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let configs = configs(arguments)?;
    let threads = arguments.threads.map_or_else(cores, usize::from);
    let pool = thread_pool(threads)?;
    let looks = arguments.images.map_or(Looks::First, Looks::Next);
    for config in &configs {
        let planner = config.planner()?;
        let times = pool.install(|| time_plans(config, &planner, arguments.plans as usize, looks))?;
        let Some(Percentiles { p50, p90, .. }) = times.plan_ms else { continue };
        let stages = times.stages_ms.iter().filter_map(|(stage, ms)| Some(format!("{stage} {:.1}", ms.as_ref()?.p50)));
        print(format_args!(
            "{}: {} plans on {threads} threads: median {p50:.1} ms, nine of ten {p90:.1} ms ({})\n",
            config.keys.protocol,
            arguments.plans,
            stages.collect::<Vec<_>>().join(", "),
        ))?;
    }
    Ok(ExitCode::Ok)
}

fn configs(arguments: &Arguments) -> Result<Vec<Config>, Failure> {
    let Arguments { configs, set, seed, .. } = arguments;
    if !configs.is_empty() {
        return configs.iter().map(|file| config(file, set, None, *seed)).collect();
    }
    let set = overrides(set, None, *seed);
    let built_in = |(name, text): (&str, &str)| Ok(Config::resolve(Document::parse(text, Path::new(name))?, &set)?);
    ROWS.into_iter().map(built_in).collect()
}
