//! Times plans of an experiment's first looks, one after the other.
//! `cargo bench -p experiments [-- --config FILE --plans N --threads N --seed N]`; the default are pile, giga-pile,
//! giga-packed and wide-table.

#![expect(clippy::print_stdout, reason = "what was measured is printed")]

use std::path::Path;
use std::time::Instant;

use experiments::config::Config;
use experiments::offer::Look;
use experiments::round::observe;
use experiments::start::start;
use planner::plan::Plan;
use program::thread_pool;
use schema::{Purpose, Stream};
use settings::Document;

const ROWS: [(&str, &str); 4] = [
    ("pile.toml", include_str!("../../configs/experiment/pile.toml")),
    ("giga-pile.toml", include_str!("../../configs/experiment/giga-pile.toml")),
    ("giga-packed.toml", include_str!("../../configs/experiment/giga-packed.toml")),
    ("wide-table.toml", include_str!("../../configs/experiment/wide-table.toml")),
];

/// Plans before the first that counts: the first ones also load code and tables.
const UNTIMED: u64 = 3;

/// Times in milliseconds: of whole plans, and of the stages that the planner timed, of which some run side by side.
#[derive(Default)]
struct Times {
    plans: Vec<f64>,
    stages: Vec<(&'static str, Vec<f64>)>,
}

impl Times {
    fn time(&mut self, is_counted: bool, plan: impl FnOnce() -> Plan) {
        let began = Instant::now();
        let plan = plan();
        let plan_ms = 1e3 * began.elapsed().as_secs_f64();
        if !is_counted {
            return;
        }
        self.plans.push(plan_ms);
        for (stage, ms) in plan.timings_ms {
            match self.stages.iter_mut().find(|(name, _)| *name == stage) {
                Some((_, times)) => times.push(ms),
                None => self.stages.push((stage, vec![ms])),
            }
        }
    }
}

fn main() {
    let number = |name: &str| option(name).map(|text| text.parse::<u32>().expect("a number"));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = number("--threads").map_or(cores, |threads| threads as usize);
    let plans = u64::from(number("--plans").unwrap_or(100));
    let set: Vec<_> = number("--seed").map(|seed| ("seeds".to_owned(), format!("[{seed}]"))).into_iter().collect();
    let rows: Vec<Config> = match option("--config") {
        Some(file) => vec![Config::read(Some(Path::new(&file)), &set).expect("a sound config")],
        None => {
            let built_in = |(name, text): (&str, &str)| {
                Config::resolve(Document::parse(text, Path::new(name)).expect("TOML"), &set).expect("a sound config")
            };
            ROWS.map(built_in).into()
        }
    };
    let pool = thread_pool(threads).expect("threads");
    for config in rows {
        let mut times = pool.install(|| time_plans(&config, plans));
        let stages: Vec<String> =
            times.stages.iter_mut().map(|(stage, ms)| format!("{stage} {:.1}", quantile(ms, 0.5))).collect();
        println!(
            "{}: {plans} plans on {threads} threads: median {:.1} ms, nine of ten {:.1} ms ({})",
            config.keys.protocol,
            quantile(&mut times.plans, 0.5),
            quantile(&mut times.plans, 0.9),
            stages.join(", "),
        );
    }
}

/// What follows a name on the command line.
fn option(name: &str) -> Option<String> {
    std::env::args().skip_while(|argument| argument != name).nth(1)
}

fn quantile(times: &mut [f64], share: f64) -> f64 {
    times.sort_by(f64::total_cmp);
    let rank = (share * times.len() as f64).ceil() as usize;
    times.get(rank.saturating_sub(1)).copied().unwrap_or(f64::NAN)
}

/// Times plans of the first looks of so many scenes of the experiment's first seed.
fn time_plans(config: &Config, plans: u64) -> Times {
    let planner = config.planner().expect("a planner");
    let seed = config.keys.seeds[0];
    let mut times = Times::default();
    for scene_id in 0..plans + UNTIMED {
        let began = start(config, seed, scene_id).expect("a scene");
        let mut noise = Stream::new(seed, scene_id, Purpose::DepthNoise, 0);
        let views = observe(config, &began.scene, &mut noise);
        let (observation, options, _) = Look { config, scene: &began.scene, views, failed: Vec::new() }.as_ours();
        times.time(scene_id >= UNTIMED, || planner.plan(&observation, &options).expect("a plan"));
    }
    times
}
