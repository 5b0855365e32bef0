//! Measures what generating costs: whole runs, stages, outcomes, and what its shortcuts change.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use program::{Failure, thread_pool};
use rayon::prelude::*;
use schema::{Outcome, SceneRows};
use serde::Serialize;
use shards::{Draft, Finalized, Table};
use simulator::{AttemptWorld, Physics, Scene};

use crate::build::{Stage, make_scene, make_scene_timed};
use crate::config::Config;
use crate::run::generate;

/// All measurements.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchReport {
    /// Attempts of complete runs from start to committed shards, in wall time: with one thread, then with all.
    pub runs: Vec<Cost>,
    /// Bytes of the shards.
    pub bytes: u64,
    /// Stages, on one thread.
    pub stages: Vec<Cost>,
    /// Attempts by outcome, on one thread.
    pub outcomes: Vec<Cost>,
    /// Some of the attempts, executed again without shortcuts.
    pub without_shortcuts: Comparison,
}

/// What something costs that happens often.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cost {
    /// Its name.
    pub name: String,
    /// How often it happened.
    pub count: u64,
    /// Steps that were simulated.
    pub steps: u64,
    /// Total time, in seconds.
    pub total_s: f64,
}

/// The same attempts with the config's settings and with everything simulated.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Comparison {
    /// Attempts.
    pub attempts: u64,
    /// Number with the same label.
    pub same_label: u64,
    /// Number with the same outcome.
    pub same_outcome: u64,
    /// Time with the config's settings and with the others, in seconds on one thread.
    pub total_s: [f64; 2],
}

const STAGES: [&str; 6] =
    ["settle", "depth and TSDF, a view", "prepare a scene", "gate", "physics", "Parquet, a scene"];
/// The stage that is not a [`Stage`] of a scene.
const PARQUET: usize = 5;

impl Cost {
    fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), count: 0, steps: 0, total_s: 0.0 }
    }

    fn add(&mut self, count: u64, steps: usize, time: Duration) {
        self.count += count;
        self.steps += steps as u64;
        self.total_s += time.as_secs_f64();
    }
}

/// Measures `config` with its own number of attempts, and executes `repeated_attempts` of them again. Datasets are
/// written to folders below `scratch`.
///
/// # Errors
/// As [`generate`].
pub fn bench(
    config: &Config,
    threads: usize,
    repeated_attempts: u64,
    scratch: &Path,
    on_phase: &dyn Fn(&str),
) -> Result<BenchReport, Failure> {
    let mut runs = Vec::new();
    let mut bytes = 0;
    let mut widths = vec![1, threads];
    widths.dedup();
    for threads in widths {
        on_phase(&format!("whole runs: {threads} threads"));
        let (folder, shards) = (scratch.join(format!("threads-{threads}")), (0..config.shards).collect::<Vec<_>>());
        let (pool, began) = (thread_pool(threads)?, Instant::now());
        let made =
            pool.install(|| generate(config, folder.as_path(), &shards, 1.0, &AtomicBool::new(false), &|_| {}))?;
        let mut cost = Cost::new(format!("threads: {threads}"));
        cost.add(config.attempts, 0, began.elapsed());
        runs.push(cost);
        if let Some(Finalized::Complete(manifest)) = &made.dataset {
            bytes = Table::ALL.into_iter().map(|table| manifest.bytes(table)).sum();
        }
    }
    on_phase("stages");
    let (stages, outcomes) = stages(config, &scratch.join("stages"))?;
    on_phase("attempts without shortcuts");
    let without_shortcuts = thread_pool(threads)?.install(|| compare(config, repeated_attempts))?;
    Ok(BenchReport { runs, bytes, stages, outcomes, without_shortcuts })
}

/// The stages of every scene and its attempts by outcome, sequentially on this thread.
fn stages(config: &Config, dir: &Path) -> Result<(Vec<Cost>, Vec<Cost>), Failure> {
    let info = config.dataset_info();
    let draft = Draft::begin(dir, &info)?;
    let mut stages = STAGES.map(Cost::new);
    let mut outcomes = Outcome::ALL.map(|outcome| Cost::new(outcome.name()));
    for shard in 0..info.shard_count {
        let mut writer = draft.shard(shard)?;
        for scene_id in info.scenes_of(shard) {
            let mut add = |stage: Stage, time: Duration| {
                let (place, count, steps) = match stage {
                    Stage::Rejected { .. } => (0, 0, 0),
                    Stage::Settle => (0, 1, 0),
                    Stage::Observe { views } => (1, views as u64, 0),
                    Stage::Prepare => (2, 1, 0),
                    Stage::Attempt { outcome, steps } => {
                        let of_outcome = outcomes.iter_mut().find(|cost| cost.name == outcome.name());
                        of_outcome.into_iter().for_each(|cost| cost.add(1, steps, time));
                        (if steps == 0 { 3 } else { 4 }, 1, steps)
                    }
                };
                stages[place].add(count, steps, time);
                ControlFlow::Continue(())
            };
            let rows = make_scene_timed(config, scene_id, info.attempts_of_scene(scene_id), &mut add)?;
            let began = Instant::now();
            writer.push(&rows)?;
            stages[PARQUET].add(1, 0, began.elapsed());
        }
        let began = Instant::now();
        writer.commit()?;
        stages[PARQUET].add(0, 0, began.elapsed());
    }
    Ok((stages.to_vec(), outcomes.to_vec()))
}

/// The attempts of the first scenes with the config's settings and with everything simulated, by more iterations.
fn compare(config: &Config, attempts: u64) -> Result<Comparison, Failure> {
    let info = config.dataset_info();
    let solver_iterations = config.physics.solver_iterations.max(Physics::FAITHFUL.solver_iterations);
    let full = Physics { solver_iterations, shortcuts: false, ..config.physics };
    let both = |scene_id: u64| {
        let rows = make_scene(config, scene_id, info.attempts_of_scene(scene_id))?;
        Ok::<_, Failure>([&config.physics, &full].map(|physics| execute(config, physics, &rows)))
    };
    let scenes = attempts.div_ceil(u64::from(info.attempts_per_scene)).min(info.scene_count);
    let pairs = (0..scenes).into_par_iter().map(both).collect::<Result<Vec<_>, _>>()?;
    let mut found = Comparison::default();
    for [(ours, our_time), (theirs, their_time)] in pairs {
        let pairs = || ours.iter().zip(&theirs);
        found.attempts += ours.len() as u64;
        found.same_label += pairs().filter(|(a, b)| a.label() == b.label()).count() as u64;
        found.same_outcome += pairs().filter(|(a, b)| a == b).count() as u64;
        found.total_s[0] += our_time.as_secs_f64();
        found.total_s[1] += their_time.as_secs_f64();
    }
    Ok(found)
}

fn execute(config: &Config, physics: &Physics, rows: &SceneRows) -> (Vec<Outcome>, Duration) {
    let began = Instant::now();
    let scene = Scene::from_records(
        config.grid.table_z_m,
        rows.scene.fixtures(&config.grid),
        &rows.objects,
        config.objects.catalogue.bodies(),
    );
    let world = AttemptWorld::new(physics, config.gripper.of_scene(rows.scene.scene_id), &config.procedure, &scene);
    let attempts = rows.attempts.iter();
    let outcomes = attempts.map(|a| world.execute(&a.workspace_from_grasp, a.object_id as usize).outcome).collect();
    (outcomes, began.elapsed())
}
