//! Measures what generating costs: whole runs, stages, outcomes, and what the shortcuts change.
//! `cargo bench -p generator [-- --config FILE --attempts N --repeat N]`; the default is the paper's config, with
//! 12,000 attempts of which 3,000 are executed again without shortcuts.

#![expect(clippy::print_stdout, reason = "what was measured is printed")]

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use generator::{Config, Overrides, Stage, generate, make_scene, make_scene_watched};
use program::thread_pool;
use rayon::prelude::*;
use schema::{Outcome, SceneRows};
use shards::{Draft, Finalized, Table};
use simulator::{AttemptWorld, Execution, Physics, Scene};

/// A name, how often it happened, the steps that were simulated and the time in seconds.
type Cost = (&'static str, u64, usize, f64);

fn main() {
    let attempts: u64 = option("--attempts").map_or(12_000, |text| text.parse().expect("a number of attempts"));
    let repeated: u64 = option("--repeat").map_or(3_000, |text| text.parse().expect("a number of attempts"));
    let shards = Some(attempts.div_ceil(3_000).max(1));
    let overrides = Overrides { shards, attempts: Some(attempts), ..Overrides::default() };
    let config = Config::load(option("--config").map(PathBuf::from).as_deref(), overrides).expect("a sound config");
    let all = std::thread::available_parallelism().map_or(1, usize::from);

    println!("Attempts of whole runs, from nothing to committed shards");
    let bytes = [1, all].map(|threads| whole_run(&config, threads));
    println!("{:.0} bytes an attempt on disk, scenes included", bytes[0] as f64 / attempts as f64);

    println!("\nStages, one thread");
    stages(&config).into_iter().for_each(print);

    println!("\nAttempts by outcome, one thread");
    outcomes(&config).into_iter().for_each(print);

    thread_pool(all).expect("threads").install(|| without_shortcuts(&config, repeated));
}

/// What follows a name on the command line.
fn option(name: &str) -> Option<String> {
    std::env::args().skip_while(|argument| argument != name).nth(1)
}

fn print((name, count, steps, total_s): Cost) {
    let each = |total: f64| total / count.max(1) as f64;
    println!(
        "{name:<24} {count:>8} times {:>8.1} steps each {:>8.1} µs each {total_s:>8.2} s",
        each(steps as f64),
        each(1e6 * total_s)
    );
}

/// Makes the whole dataset in a temporary folder, and returns its bytes.
fn whole_run(config: &Config, threads: usize) -> u64 {
    let folder = tempfile::tempdir().expect("a folder");
    let shards: Vec<u32> = (0..config.shards).collect();
    let began = Instant::now();
    let run = || generate(config, folder.path(), &shards, 1.0, &AtomicBool::new(false), &|_| {});
    let made = thread_pool(threads).expect("threads").install(run).expect("a dataset");
    println!("{threads:>2} threads {:>10.0} attempts/s", config.attempts as f64 / began.elapsed().as_secs_f64());
    match made.dataset {
        Some(Finalized::Complete(manifest)) => Table::ALL.into_iter().map(|table| manifest.bytes(table)).sum(),
        _ => 0,
    }
}

/// The stages of every scene, sequentially on this thread.
fn stages(config: &Config) -> [Cost; 5] {
    let folder = tempfile::tempdir().expect("a folder");
    let info = config.dataset_info();
    let draft = Draft::begin(folder.path(), &info).expect("a draft");
    let mut costs =
        ["settle", "depth and TSDF", "prepare a scene", "attempt", "Parquet, a scene"].map(|name| (name, 0, 0, 0.0));
    for shard in 0..info.shard_count {
        let mut writer = draft.shard(shard).expect("a shard");
        for scene_id in info.scenes_of(shard) {
            let mut began = Instant::now();
            let mut ended = |stage: usize, count: u64| {
                costs[stage].1 += count;
                costs[stage].3 += std::mem::replace(&mut began, Instant::now()).elapsed().as_secs_f64();
            };
            let mut on_stage = |stage: Stage| {
                match stage {
                    Stage::Rejected => ended(0, 0),
                    Stage::Settled => ended(0, 1),
                    Stage::Observed => ended(1, 1),
                    Stage::Prepared => ended(2, 1),
                    Stage::Attempted => ended(3, 1),
                }
                ControlFlow::Continue(())
            };
            let attempts = info.attempts_of_scene(scene_id);
            let rows = make_scene_watched(config, scene_id, attempts, &mut on_stage).expect("a scene");
            writer.push(&rows).expect("sound rows");
            ended(4, 1);
        }
        let began = Instant::now();
        writer.commit().expect("a shard");
        costs[4].3 += began.elapsed().as_secs_f64();
    }
    costs
}

/// All attempts, executed again on this thread.
fn outcomes(config: &Config) -> Vec<Cost> {
    let info = config.dataset_info();
    let mut costs: Vec<Cost> = Outcome::ALL.into_iter().map(|outcome| (outcome.name(), 0, 0, 0.0)).collect();
    for scene_id in 0..info.scene_count {
        let rows = make_scene(config, scene_id, info.attempts_of_scene(scene_id)).expect("a scene");
        for (execution, time_s) in execute(config, &config.physics, &rows) {
            if let Some(cost) = costs.iter_mut().find(|cost| cost.0 == execution.outcome.name()) {
                *cost = (cost.0, cost.1 + 1, cost.2 + execution.steps, cost.3 + time_s);
            }
        }
    }
    costs
}

/// The attempts of the first scenes with the config's settings and with everything simulated, by more iterations.
fn without_shortcuts(config: &Config, attempts: u64) {
    let info = config.dataset_info();
    let solver_iterations = config.physics.solver_iterations.max(Physics::FAITHFUL.solver_iterations);
    let full = Physics { solver_iterations, shortcuts: false, ..config.physics };
    let scenes = attempts.div_ceil(u64::from(info.attempts_per_scene)).min(info.scene_count);
    let both = |scene_id: u64| {
        let rows = make_scene(config, scene_id, info.attempts_of_scene(scene_id)).expect("a scene");
        let [ours, full] = [&config.physics, &full].map(|physics| execute(config, physics, &rows));
        ours.into_iter().zip(full).collect::<Vec<_>>()
    };
    let pairs: Vec<_> = (0..scenes).into_par_iter().flat_map_iter(both).collect();
    let share = |is_same: fn(Outcome, Outcome) -> bool| {
        let same = pairs.iter().filter(|((ours, _), (full, _))| is_same(ours.outcome, full.outcome)).count();
        100.0 * same as f64 / pairs.len().max(1) as f64
    };
    let [ours_s, full_s] = pairs.iter().fold([0.0, 0.0], |[a, b], ((_, ours), (_, full))| [a + ours, b + full]);
    println!(
        "\nOf {} attempts with everything simulated {:.2} % end with the same label, {:.2} % with the same outcome, in \
         {:.1} times the time",
        pairs.len(),
        share(|ours, full| ours.label() == full.label()),
        share(|ours, full| ours == full),
        full_s / ours_s
    );
}

fn execute(config: &Config, physics: &Physics, rows: &SceneRows) -> Vec<(Execution, f64)> {
    let fixtures = rows.scene.fixtures(&config.grid);
    let bodies = config.objects.catalogue.bodies();
    let scene = Scene::from_records(config.grid.table_z_m, fixtures, &rows.objects, bodies);
    let world = AttemptWorld::new(physics, config.gripper.of_scene(rows.scene.scene_id), &config.procedure, &scene);
    let timed = |attempt: &schema::AttemptRecord| {
        let began = Instant::now();
        let execution = world.execute(&attempt.workspace_from_grasp, attempt.object_id as usize);
        (execution, began.elapsed().as_secs_f64())
    };
    rows.attempts.iter().map(timed).collect()
}
