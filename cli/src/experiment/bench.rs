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

/// Images of the camera that moves, in a bench without a file.
const IMAGES: u32 = 6;

/// Time plans of an experiment's first looks, one after the other
#[derive(Debug, Args)]
#[command(after_help = ExitCode::HELP)]
pub(crate) struct Arguments {
    /// Experiments, as in configs/experiment [default: pile, giga-pile, giga-packed, wide-table, and giga-pile by a
    /// camera that moves, with the noise of a D435]
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

    /// Time the plans of a camera that moves, from its second image on, of so many images of each scene
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1000))]
    images: Option<u32>,

    /// Threads of a plan [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let threads = arguments.threads.map_or_else(cores, usize::from);
    let pool = thread_pool(threads)?;
    for (config, looks) in rows(arguments)? {
        let planner = config.planner()?;
        let times = pool.install(|| time_plans(&config, &planner, arguments.plans as usize, looks))?;
        let Some(Percentiles { p50, p90, .. }) = times.plan_ms else { continue };
        let stages = times.stages_ms.iter().filter_map(|(stage, ms)| Some(format!("{stage} {:.1}", ms.as_ref()?.p50)));
        print(format_args!(
            "{}{}: {} plans on {threads} threads: median {p50:.1} ms, nine of ten {p90:.1} ms ({})\n",
            config.keys.protocol,
            if looks == Looks::First { "" } else { ", next image" },
            arguments.plans,
            stages.collect::<Vec<_>>().join(", "),
        ))?;
    }
    Ok(ExitCode::Ok)
}

/// The experiments, and which looks are timed.
fn rows(arguments: &Arguments) -> Result<Vec<(Config, Looks)>, Failure> {
    let Arguments { configs, set, seed, images, .. } = arguments;
    let looks = images.map_or(Looks::First, Looks::Next);
    if !configs.is_empty() {
        return configs.iter().map(|file| Ok((config(file, set, None, *seed)?, looks))).collect();
    }
    let own = overrides(set, None, *seed);
    let built_in =
        |name: &str, text: &str, set: &[(String, String)], looks: Looks| -> Result<(Config, Looks), Failure> {
            Ok((Config::resolve(Document::parse(text, Path::new(name))?, set)?, looks))
        };
    let mut rows =
        ROWS.iter().map(|(name, text)| built_in(name, text, &own, looks)).collect::<Result<Vec<_>, Failure>>()?;
    // What a camera at a wrist sees.
    if images.is_none() {
        let noise = [("noise.kind".to_owned(), "\"d435\"".to_owned())];
        rows.push(built_in(ROWS[1].0, ROWS[1].1, &[&noise, own.as_slice()].concat(), Looks::Next(IMAGES))?);
    }
    Ok(rows)
}
