//! Grasps that failed, as rows of a dataset, which can be executed again and shown.

use schema::{
    Approach, AttemptRecord, ObjectRecord, ObjectShape, Outcome, Rule, SceneRecord, SceneRows, Shape, ShapeKind, Solid,
    Vec3,
};
use shards::DatasetInfo;

use crate::config::{Config, Touching, info_of};
use crate::record::{AttemptObject, Round};

/// At most so many grasps that failed, spread over all, each with its name and the scene that it found, and the
/// settings by which they are executed. None where the gripper halts at what it touches: rows do not tell where.
#[must_use]
pub fn failures(config: &Config, rounds: &[Round], most: usize) -> (DatasetInfo, Vec<(String, SceneRows)>) {
    let info = info_of(&config.scene, &config.objects);
    let failed = |round: &Round, number: usize| round.attempts[number].outcome != Outcome::Held;
    let all = rounds.iter().flat_map(|round| (0..round.attempts.len()).map(move |number| (round, number)));
    let all: Vec<(&Round, usize)> = all.filter(|(round, number)| failed(round, *number)).collect();
    let most = if config.keys.touching == Touching::Halts { 0 } else { most };
    let named = |(round, number): &(&Round, usize)| {
        let name = format!("{}-{number}-{}", round.round, round.attempts[*number].outcome.name());
        Some((name, rows_of(&info, round, *number)?))
    };
    let every = all.len().div_ceil(most.max(1)).max(1);
    let some = all.iter().step_by(every).take(most).filter_map(named).collect();
    (info, some)
}

/// An attempt's rows; none if an object of it is not known.
fn rows_of(info: &DatasetInfo, round: &Round, number: usize) -> Option<SceneRows> {
    let (attempt, scene_id) = (round.attempts.get(number)?, round.scene_id);
    let object = |(id, object): (usize, &AttemptObject)| {
        let shape = match info.models.iter().position(|model| model.name == object.body) {
            Some(number) => ObjectShape::Model { number: number as u16, model: info.models[number].clone() },
            None => Solid::new(ShapeKind::from_name(&object.body)?, Vec3::from_array(object.size_m)).ok()?.into(),
        };
        let AttemptObject { mass_kg, friction, workspace_from_object, .. } = *object;
        Some(ObjectRecord { scene_id, object_id: id as u32, shape, mass_kg, friction, workspace_from_object })
    };
    let scene = SceneRecord { scene_id, attempt_count: 1, container: round.container, ..SceneRecord::default() };
    let attempt_row = AttemptRecord {
        scene_id,
        attempt_id: number as u32,
        object_id: attempt.target_id,
        rule: Rule { shape: Shape::Model(0), approach: Approach::Proposal },
        closing: None,
        tilt_rad: 0.0,
        turn_rad: 0.0,
        depth_m: 0.0,
        slide_m: 0.0,
        workspace_from_grasp: attempt.workspace_from_grasp,
        outcome: attempt.outcome,
        hit: attempt.hit,
        hit_object_id: None,
        width_m: None,
        robustness: None,
    };
    let objects = attempt.objects.iter().enumerate().map(object).collect::<Option<Vec<_>>>()?;
    Some(SceneRows { scene, objects, attempts: vec![attempt_row] })
}
