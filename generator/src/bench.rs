//! Measures the cost of generating, stage by stage, and the effect of the shortcuts.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use program::{Failure, peak_memory_bytes, thread_pool};
use rayon::prelude::*;
use schema::{Engine, Outcome, SceneRows};
use serde::Serialize;
use shards::{Draft, Finalized, Table};
use simulator::{AttemptWorld, Physics, Scene};

use crate::build::{Stage, make_scene, make_scene_timed};
use crate::config::Config;
use crate::run::generate;

/// All measurements.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchReport {
    /// This program's version.
    pub version: String,
    /// The processor's name.
    pub processor: String,
    /// Attempts of each run, and of the stages.
    pub attempts: u64,
    /// Complete runs from start to committed shards: with one thread, then with all.
    pub runs: Vec<RunCost>,
    /// Stages, on one thread.
    pub stages: Vec<StageCost>,
    /// Attempts by outcome, on one thread.
    pub outcomes: Vec<OutcomeCost>,
    /// Mean time of a simulated step, in seconds.
    pub step_s: f64,
    /// Bytes of the shards.
    pub bytes: u64,
    /// Peak memory of the process so far, in bytes, if the system reports it.
    pub memory_bytes: Option<u64>,
    /// The same attempts with slower settings.
    pub agreements: Vec<Agreement>,
}

/// A whole run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunCost {
    /// Threads that simulate; one more encodes.
    pub threads: usize,
    /// Wall time, in seconds.
    pub wall_s: f64,
    /// CPU time of all threads, in seconds, if the system reports it.
    pub cpu_s: Option<f64>,
}

/// A stage.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageCost {
    /// Its name.
    pub name: &'static str,
    /// How often it ran.
    pub count: u64,
    /// Total time, in seconds.
    pub total_s: f64,
}

/// Attempts with the same outcome.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OutcomeCost {
    /// The outcome.
    pub outcome: &'static str,
    /// Number of attempts.
    pub count: u64,
    /// Steps that were simulated.
    pub steps: u64,
    /// Total time, in seconds.
    pub total_s: f64,
}

/// The same attempts of the same scenes with other settings.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Agreement {
    /// The other settings.
    pub settings: String,
    /// Attempts.
    pub attempts: u64,
    /// Those that the gate lets pass.
    pub closing: u64,
    /// Number with the same label.
    pub same_label: u64,
    /// Number with the same outcome.
    pub same_outcome: u64,
    /// Positives with the config's settings, and with the others.
    pub positives: [u64; 2],
    /// Time of the attempts with the config's settings and with the others, in seconds on one thread.
    pub total_s: [f64; 2],
}

/// Measures `config` with its own number of attempts; datasets are written to folders below `scratch`.
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
    let mut widths = vec![1, threads];
    widths.dedup();
    let mut runs = Vec::new();
    let mut bytes = 0;
    for threads in widths {
        on_phase(&format!("whole runs: {threads} threads"));
        let (cost, made) = whole_run(config, threads, &scratch.join(format!("threads-{threads}")))?;
        runs.push(cost);
        bytes = made;
    }
    on_phase("stages");
    let (stages, outcomes) = stages(config, &scratch.join("stages"))?;
    let (steps, simulated_s) = outcomes.iter().fold((0, 0.0), |(steps, time_s), cost| match cost.steps {
        0 => (steps, time_s),
        more => (steps + more, time_s + cost.total_s),
    });
    let memory_bytes = peak_memory_bytes();
    let mut agreements = Vec::new();
    if repeated_attempts > 0 {
        let solver_iterations = config.physics.solver_iterations.max(Physics::FAITHFUL.solver_iterations);
        let faithful = Physics { solver_iterations, shortcuts: false, ..config.physics };
        let other = if config.physics.engine == Engine::Rapier { Engine::Stepper } else { Engine::Rapier };
        for (settings, physics) in [
            (format!("by engine {:?}", other.name()), Physics { engine: other, ..config.physics }),
            (format!("everything simulated, {solver_iterations} iterations"), faithful),
            (
                format!("everything simulated, {solver_iterations} iterations at {} Hz", 2.0 * faithful.step_rate_hz),
                Physics { step_rate_hz: 2.0 * faithful.step_rate_hz, ..faithful },
            ),
        ] {
            on_phase(&format!("attempts again: {settings}"));
            agreements.push(agreement(config, threads, repeated_attempts, settings, physics)?);
        }
    }
    Ok(BenchReport {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        processor: processor(),
        attempts: config.attempts,
        runs,
        stages,
        outcomes,
        step_s: simulated_s / steps.max(1) as f64,
        bytes,
        memory_bytes,
        agreements,
    })
}

fn whole_run(config: &Config, threads: usize, dir: &Path) -> Result<(RunCost, u64), Failure> {
    let shards: Vec<u32> = (0..config.shards).collect();
    let pool = thread_pool(threads)?;
    let (began, cpu_began_s) = (Instant::now(), cpu_time_s());
    let report = pool.install(|| generate(config, dir, &shards, 1.0, &AtomicBool::new(false), &|_| {}))?;
    let wall_s = began.elapsed().as_secs_f64();
    let cpu_s = cpu_time_s().zip(cpu_began_s).map(|(now, before)| now - before);
    let bytes = match &report.dataset {
        Some(Finalized::Complete(manifest)) => Table::ALL.into_iter().map(|table| manifest.bytes(table)).sum(),
        Some(Finalized::Incomplete { .. }) | None => 0,
    };
    Ok((RunCost { threads, wall_s, cpu_s }, bytes))
}

/// The stages of every scene, sequentially on this thread.
fn stages(config: &Config, dir: &Path) -> Result<(Vec<StageCost>, Vec<OutcomeCost>), Failure> {
    let info = config.dataset_info();
    let draft = Draft::begin(dir, &info)?;
    let names = ["settle", "depth and TSDF, a view", "prepare a scene", "gate", "physics", "Parquet, a scene"];
    let mut stages = names.map(|name| StageCost { name, count: 0, total_s: 0.0 });
    let mut outcomes =
        Outcome::ALL.map(|outcome| OutcomeCost { outcome: outcome.name(), count: 0, steps: 0, total_s: 0.0 });
    for shard in 0..info.shard_count {
        let mut writer = draft.shard(shard)?;
        for scene_id in info.scenes_of(shard) {
            let mut add = |stage: Stage, time: Duration| {
                let (slot, count) = match stage {
                    Stage::Rejected { .. } => (0, 0),
                    Stage::Settle => (0, 1),
                    Stage::Observe { views } => (1, views as u64),
                    Stage::Prepare => (2, 1),
                    Stage::Attempt { outcome, steps } => {
                        if let Some(cost) = outcomes.iter_mut().find(|cost| cost.outcome == outcome.name()) {
                            cost.count += 1;
                            cost.steps += steps as u64;
                            cost.total_s += time.as_secs_f64();
                        }
                        (if steps == 0 { 3 } else { 4 }, 1)
                    }
                };
                stages[slot].count += count;
                stages[slot].total_s += time.as_secs_f64();
                ControlFlow::Continue(())
            };
            let rows = make_scene_timed(config, scene_id, info.attempts_of_scene(scene_id), &mut add)?;
            let began = Instant::now();
            writer.push(&rows)?;
            stages[5].count += 1;
            stages[5].total_s += began.elapsed().as_secs_f64();
        }
        let began = Instant::now();
        writer.commit()?;
        stages[5].total_s += began.elapsed().as_secs_f64();
    }
    Ok((stages.to_vec(), outcomes.to_vec()))
}

/// The attempts of the first scenes with the config's settings and with `physics`.
fn agreement(
    config: &Config,
    threads: usize,
    repeated_attempts: u64,
    settings: String,
    physics: Physics,
) -> Result<Agreement, Failure> {
    let info = config.dataset_info();
    let scenes = repeated_attempts.div_ceil(u64::from(info.attempts_per_scene)).min(info.scene_count);
    let compare = |scene_id: u64| {
        let rows = make_scene(config, scene_id, info.attempts_of_scene(scene_id))?;
        Ok::<_, Failure>((repeat(config, &config.physics, &rows), repeat(config, &physics, &rows)))
    };
    let mut found = Agreement {
        settings,
        attempts: 0,
        closing: 0,
        same_label: 0,
        same_outcome: 0,
        positives: [0; 2],
        total_s: [0.0; 2],
    };
    let pairs: Result<Vec<_>, _> = thread_pool(threads)?.install(|| (0..scenes).into_par_iter().map(compare).collect());
    for ((ours, our_time), (theirs, their_time)) in pairs? {
        found.attempts += ours.len() as u64;
        for (a, b) in ours.iter().zip(&theirs) {
            found.closing += u64::from(!matches!(a, Outcome::PregraspCollision | Outcome::ApproachCollision));
            found.same_label += u64::from(a.label() == b.label());
            found.same_outcome += u64::from(a == b);
            found.positives[0] += u64::from(a.label());
            found.positives[1] += u64::from(b.label());
        }
        found.total_s[0] += our_time.as_secs_f64();
        found.total_s[1] += their_time.as_secs_f64();
    }
    Ok(found)
}

fn repeat(config: &Config, physics: &Physics, rows: &SceneRows) -> (Vec<Outcome>, Duration) {
    let began = Instant::now();
    let scene = Scene::from_records(config.grid.table_z_m, &rows.objects, config.objects.catalogue.bodies());
    let world = AttemptWorld::new(physics, config.gripper.of_scene(rows.scene.scene_id), &config.procedure, &scene);
    let attempts = rows.attempts.iter();
    let outcomes = attempts.map(|a| world.execute(&a.workspace_from_grasp, a.object_id as usize).outcome).collect();
    (outcomes, began.elapsed())
}

/// CPU time of this process, user and system (Linux: `/proc/self/stat`, in hundredths of a second).
fn cpu_time_s() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The second field, the command's name, is in parentheses and may contain any character.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |field: usize| fields.get(field)?.parse::<f64>().ok();
    Some((ticks(11)? + ticks(12)?) / 100.0)
}

fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned())
}
