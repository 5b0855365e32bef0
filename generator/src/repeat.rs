//! Executes a dataset's attempts again and compares the results with the stored rows.

use program::{ExitCode, Failure};
use rayon::prelude::*;
use schema::{AttemptRecord, ObjectRecord, Outcome};
use shards::Dataset;
use simulator::{AttemptWorld, Body, Execution, Physics, Scene};

use crate::laws::{bodies_of, physics_of};

/// The result of the comparison.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Repeated {
    /// Attempts that were executed.
    pub attempts: u64,
    /// Attempts whose outcome, hit or opening differs from the stored one.
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

/// Executes the attempts of the first `scene_count` scenes again, using only their rows.
///
/// # Errors
/// If the dataset cannot be read or was not made by this engine.
pub fn repeat(dataset: &Dataset, scene_count: u64) -> Result<Repeated, Failure> {
    let physics = physics_of(&dataset.info().config)?;
    let bodies = bodies_of(dataset.info())?;
    let mut repeated = Repeated { attempts: 0, different: Vec::new() };
    for shard in 0..dataset.shard_count() {
        let ids = dataset.info().scenes_of(shard);
        let ids = ids.start..ids.end.min(scene_count);
        if ids.is_empty() {
            break;
        }
        let (objects, attempts) = (dataset.read_objects(shard)?, dataset.read_attempts(shard)?);
        // The tables were checked one by one; references between them are checked here.
        let lacks_target = |row: &AttemptRecord| {
            row.object_id as usize >= objects[range_of(&objects, row.scene_id, |object| object.scene_id)].len()
        };
        if let Some(row) = attempts.iter().find(|row| lacks_target(row)) {
            let AttemptRecord { scene_id, attempt_id, .. } = row;
            let has = "has a target that is not among the scene's objects";
            return Err(Failure::new(ExitCode::Data, format!("attempt {attempt_id} of scene {scene_id} {has}")));
        }
        let found: Vec<Repeated> = ids
            .into_par_iter()
            .map(|scene_id| {
                // Rows are sorted by scene.
                let objects = &objects[range_of(&objects, scene_id, |row| row.scene_id)];
                let attempts = &attempts[range_of(&attempts, scene_id, |row| row.scene_id)];
                repeat_scene(dataset, (&physics, &bodies), objects, attempts)
            })
            .collect();
        for one in found {
            repeated.attempts += one.attempts;
            repeated.different.extend(one.different);
        }
    }
    Ok(repeated)
}

fn range_of<T>(rows: &[T], scene_id: u64, of: impl Fn(&T) -> u64) -> std::ops::Range<usize> {
    rows.partition_point(|row| of(row) < scene_id)..rows.partition_point(|row| of(row) <= scene_id)
}

fn repeat_scene(
    dataset: &Dataset,
    (physics, bodies): (&Physics, &[Body]),
    objects: &[ObjectRecord],
    attempts: &[AttemptRecord],
) -> Repeated {
    let info = dataset.info();
    let scene = Scene::from_records(info.grid.table_z_m, objects, bodies);
    let world = AttemptWorld::new(physics, &info.gripper, &info.procedure, &scene);
    let again = |row: &AttemptRecord| {
        let now = world.execute(&row.workspace_from_grasp, row.object_id as usize);
        let is_same = is_as_stored(row, &now);
        let (scene_id, attempt_id) = (row.scene_id, row.attempt_id);
        (!is_same).then_some(Difference { scene_id, attempt_id, stored: row.outcome, now: now.outcome })
    };
    Repeated { attempts: attempts.len() as u64, different: attempts.iter().filter_map(again).collect() }
}

/// Whether an attempt ended as its row says, to the last bit of the opening.
pub(crate) fn is_as_stored(stored: &AttemptRecord, now: &Execution) -> bool {
    let hit_object_id = now.hit.and_then(|hit| hit.object_id).map(|id| id as u32);
    stored.outcome == now.outcome
        && stored.hit == now.hit.map(|hit| hit.kind)
        && stored.hit_object_id == hit_object_id
        && stored.width_m.map(f32::to_bits) == now.width_m.map(f32::to_bits)
}
