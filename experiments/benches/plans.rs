//! Times plans of an experiment's first looks, one after the other, and of the next images of a camera that moves.
//! `cargo bench -p experiments [-- --config FILE --plans N --threads N --seed N --images N]`; the default are pile,
//! giga-pile, giga-packed, wide-table, and giga-pile by a camera that moves, with the noise of a D435.

#![expect(clippy::print_stdout, reason = "what was measured is printed")]

use std::path::Path;
use std::time::Instant;

use experiments::config::Config;
use experiments::offer::Look;
use experiments::round::observe;
use experiments::start::start;
use planner::plan::Plan;
use planner::{KeptScene, Observation};
use program::thread_pool;
use schema::{Camera, Purpose, Stream, Vec3, axis_angle, pose_from_parts};
use settings::Document;

const ROWS: [(&str, &str); 4] = [
    ("pile.toml", include_str!("../../configs/experiment/pile.toml")),
    ("giga-pile.toml", include_str!("../../configs/experiment/giga-pile.toml")),
    ("giga-packed.toml", include_str!("../../configs/experiment/giga-packed.toml")),
    ("wide-table.toml", include_str!("../../configs/experiment/wide-table.toml")),
];

/// Images of the camera that moves, in a bench without a file.
const IMAGES: u32 = 6;
/// Plans before the first that counts: the first ones also load code and tables.
const UNTIMED: u64 = 3;
/// A camera that moves turns about the middle of the workspace by this from image to image.
const TURN_RAD: f32 = 0.07;

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
    let images = number("--images").unwrap_or(1);
    let set: Vec<_> = number("--seed").map(|seed| ("seeds".to_owned(), format!("[{seed}]"))).into_iter().collect();
    let mut rows: Vec<(Config, u32)> = Vec::new();
    if let Some(file) = option("--config") {
        rows.push((Config::read(Some(Path::new(&file)), &set).expect("a sound config"), images));
    } else {
        let built_in = |(name, text): (&str, &str), set: &[(String, String)]| {
            Config::resolve(Document::parse(text, Path::new(name)).expect("TOML"), set).expect("a sound config")
        };
        rows.extend(ROWS.map(|row| (built_in(row, &set), images)));
        let noise = [("noise.kind".to_owned(), "\"d435\"".to_owned())];
        rows.push((built_in(ROWS[1], &[&noise, set.as_slice()].concat()), IMAGES));
    }
    let pool = thread_pool(threads).expect("threads");
    for (config, images) in rows {
        let mut times = pool.install(|| time_plans(&config, plans, images));
        let stages: Vec<String> =
            times.stages.iter_mut().map(|(stage, ms)| format!("{stage} {:.1}", quantile(ms, 0.5))).collect();
        println!(
            "{}{}: {plans} plans on {threads} threads: median {:.1} ms, nine of ten {:.1} ms ({})",
            config.keys.protocol,
            if images > 1 { ", next image" } else { "" },
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

/// Times plans of so many scenes of the experiment's first seed: of the first look, or, of several images, of each
/// after the first.
fn time_plans(config: &Config, plans: u64, images: u32) -> Times {
    let planner = config.planner().expect("a planner");
    let seed = config.keys.seeds[0];
    let mut times = Times::default();
    for scene_id in 0..plans + UNTIMED {
        let began = start(config, seed, scene_id).expect("a scene");
        let mut noise = Stream::new(seed, scene_id, Purpose::DepthNoise, 0);
        let mut seen = |cameras: &[Camera]| {
            let views = observe(config, cameras, &began.scene, &mut noise);
            Look { config, scene: &began.scene, views, failed: Vec::new() }.as_ours()
        };
        let is_counted = scene_id >= UNTIMED;
        if images == 1 {
            let (observation, options, _) = seen(&config.cameras());
            times.time(is_counted, || planner.plan(&observation, &options).expect("a plan"));
            continue;
        }
        let mut kept = KeptScene::default();
        for image in 0..images {
            let (Observation::Views(views), options, _) = seen(&turned(config, image)) else { continue };
            times.time(is_counted && image > 0, || {
                views.into_iter().for_each(|view| kept.observe(view).expect("a sound view"));
                planner.plan_kept(&mut kept, &options, &|poses| vec![true; poses.len()]).expect("a plan")
            });
        }
    }
    times
}

/// The experiment's cameras, on their way about the workspace.
fn turned(config: &Config, image: u32) -> Vec<Camera> {
    let half_m = 0.5 * config.scene.grid.size_m;
    let (middle_m, turn) = (Vec3::new(half_m, half_m, 0.0), axis_angle(Vec3::Z, TURN_RAD * image as f32));
    let about = pose_from_parts(turn, middle_m - turn * middle_m);
    let moved = |camera: Camera| {
        let workspace_from_camera = about * camera.workspace_from_camera;
        Camera { workspace_from_camera, ..camera }
    };
    config.cameras().into_iter().map(moved).collect()
}
