//! Executes a dataset's attempts again and compares the results with the stored rows.

use program::{ExitCode, Failure};
use rayon::prelude::*;
use schema::{AttemptRecord, Engine, Outcome, SceneRows};
use shards::Dataset;
use simulator::{AttemptWorld, Execution, Physics, Scene};

use crate::dataset_info::{bodies_of, physics_of, robustness_of};
use crate::robustness::Repeats;

/// Scenes whose rows are in memory together.
const SCENES_AT_ONCE: usize = 16;

/// The result of the comparison.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Repeated {
    /// Attempts that were executed.
    pub attempts: u64,
    /// Attempts whose outcome, hit, opening or robustness differs from the stored one.
    pub different: Vec<Difference>,
}

/// An attempt that ends differently from its row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Difference {
    /// The scene.
    pub scene_id: u64,
    /// The attempt.
    pub attempt_id: u32,
    /// The stored outcome.
    pub stored: Outcome,
    /// The outcome now.
    pub now: Outcome,
}

/// Executes the attempts of the first `scene_count` scenes again, and their repeats, using only their rows; by another
/// engine if one is given, of which only the outcomes are compared.
///
/// # Errors
/// If the dataset cannot be read or was made by an engine that this program does not have.
pub fn repeat(dataset: &Dataset, scene_count: u64, engine: Option<Engine>) -> Result<Repeated, Failure> {
    let info = dataset.info();
    let stored = physics_of(&info.config)?;
    let physics = Physics { engine: engine.unwrap_or(stored.engine), ..stored };
    if physics.engine == Engine::Rapier && info.grippers().iter().any(|gripper| !gripper.jaws.is_empty()) {
        let why = "engine rapier knows fingers that slide alike, and the dataset's gripper has other jaws";
        return Err(Failure::new(ExitCode::Config, why.to_owned()));
    }
    let is_own_engine = physics == stored;
    let bodies = bodies_of(info)?;
    // Repeats of another engine end otherwise.
    let robustness = if is_own_engine { robustness_of(info)? } else { None };
    let repeat_scene = |rows: &SceneRows| -> Vec<Difference> {
        let scene = Scene::from_records(info.grid.table_z_m, rows.scene.fixtures(&info.grid), &rows.objects, &bodies);
        let (scene_id, procedure) = (rows.scene.scene_id, &info.procedure);
        let gripper = info.gripper_of(scene_id);
        let world = AttemptWorld::new(&physics, gripper, procedure, &scene);
        let repeats = Repeats::of_scene(robustness.as_ref(), info.seed, scene_id, &physics, gripper, procedure, &scene);
        let again = |row: &AttemptRecord| {
            let now = world.execute(&row.workspace_from_grasp, row.object_id as usize);
            let ends_so = if is_own_engine { is_as_stored(row, &now) } else { row.outcome == now.outcome };
            let is_as_robust = repeats.as_ref().is_none_or(|repeats| repeats.robustness(row) == row.robustness);
            let attempt_id = row.attempt_id;
            let difference = Difference { scene_id, attempt_id, stored: row.outcome, now: now.outcome };
            (!(ends_so && is_as_robust)).then_some(difference)
        };
        rows.attempts.iter().filter_map(again).collect()
    };
    let mut repeated = Repeated { attempts: 0, different: Vec::new() };
    for shard in 0..dataset.shard_count() {
        let ids = info.scenes_of(shard);
        let ids = ids.start..ids.end.min(scene_count);
        if ids.is_empty() {
            break;
        }
        let mut scenes = dataset.rows(shard, false)?.take((ids.end - ids.start) as usize); // at most a shard's
        loop {
            let some: Vec<SceneRows> = scenes.by_ref().take(SCENES_AT_ONCE).collect::<Result<_, _>>()?;
            if some.is_empty() {
                break;
            }
            repeated.attempts += some.iter().map(|rows| rows.attempts.len() as u64).sum::<u64>();
            repeated.different.par_extend(some.par_iter().flat_map_iter(&repeat_scene));
        }
    }
    Ok(repeated)
}

/// Whether an attempt ended as its row says, to the last bit of the opening.
pub(crate) fn is_as_stored(stored: &AttemptRecord, now: &Execution) -> bool {
    let hit_object_id = now.hit.and_then(|hit| hit.object_id).map(|id| id as u32);
    stored.outcome == now.outcome
        && stored.hit == now.hit.map(|hit| hit.kind)
        && stored.hit_object_id == hit_object_id
        && stored.width_m.map(f32::to_bits) == now.width_m.map(f32::to_bits)
}
