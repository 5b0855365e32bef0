//! The rules for rows. They are checked before rows are written and again after rows are read, so that neither a defect
//! of the generator nor one of the reader becomes data.

use schema::{
    AttemptRecord, Axis, Gripper, HitKind, ObjectRecord, ObjectShape, Outcome, Pose, SceneRecord, SceneRows, Shape,
    Solid, View,
};

use crate::DatasetInfo;

/// A quaternion's length may differ from 1 by this.
const QUATERNION_TOLERANCE: f32 = 1e-4;
/// Positions lie within this distance of the workspace's origin, in metres.
const POSITION_M_MAX: f32 = 10.0;
/// An opening may exceed its range by this, in metres, because contacts are slightly soft.
const WIDTH_TOLERANCE_M: f32 = 0.002;
/// Maximum number of camera poses of a scene.
pub(crate) const VIEWS_MAX: usize = 256;
/// Observed TSDF values are in this range: (±0.98 + 1) / 2 with a tolerance for rounding.
const TSDF: (f32, f32) = (0.0099, 0.9901);

/// What is wrong: the rule, the value and the limit.
type Checked = Result<(), String>;

/// An error unless a rule holds.
pub(crate) fn must(holds: bool, message: impl FnOnce() -> String) -> Checked {
    if holds { Ok(()) } else { Err(message()) }
}

fn within(name: &str, value: f32, low: f32, high: f32) -> Checked {
    must(value >= low && value <= high, || format!("{name} must be between {low} and {high}, got {value}"))
}

fn pose(name: &str, pose: &Pose) -> Checked {
    for (axis, value) in ["x_m", "y_m", "z_m"].into_iter().zip(pose.translation.to_array()) {
        within(&format!("{name} {axis}"), value, -POSITION_M_MAX, POSITION_M_MAX)?;
    }
    let length = pose.rotation.length();
    must((length - 1.0).abs() <= QUATERNION_TOLERANCE, || {
        format!("{name} quaternion must have length 1 within {QUATERNION_TOLERANCE}, got {length}")
    })
}

fn view(view: &View) -> Checked {
    within("view radius_m", view.radius_m, f32::MIN_POSITIVE, POSITION_M_MAX)?;
    within("view polar_rad", view.polar_rad, 0.0, core::f32::consts::PI)?;
    within("view azimuth_rad", view.azimuth_rad, -core::f32::consts::TAU, core::f32::consts::TAU)
}

/// Checks a scene's own row, without its grid.
pub(crate) fn scene_head(scene: &SceneRecord, info: &DatasetInfo) -> Checked {
    let expected = info.attempts_of_scene(scene.scene_id);
    must(scene.scene_id < info.scene_count, || {
        format!("scene_id must be below {}, got {}", info.scene_count, scene.scene_id)
    })?;
    must(scene.attempt_count == expected, || format!("attempt_count must be {expected}, got {}", scene.attempt_count))?;
    must((1..=scene.dropped_count).contains(&scene.object_count), || {
        format!("object_count must be between 1 and dropped_count {}, got {}", scene.dropped_count, scene.object_count)
    })?;
    within("settle_time_s", scene.settle_time_s, 0.0, 1e6)?;
    must((1..=VIEWS_MAX).contains(&scene.views.len()), || {
        format!("a scene must have between 1 and {VIEWS_MAX} views, got {}", scene.views.len())
    })?;
    must(scene.container.is_none() || info.form().has_containers, || {
        "a scene must have no container where the config has none".to_owned()
    })?;
    scene.container.map_or(Ok(()), |container| container.check(&info.grid))?;
    scene.views.iter().try_for_each(view)
}

/// Checks a scene's grid.
pub(crate) fn tsdf(values: &[f32], info: &DatasetInfo) -> Checked {
    must(values.len() == info.grid.len(), || {
        format!("tsdf must have {} values, got {}", info.grid.len(), values.len())
    })?;
    let (low, high) = TSDF;
    let bad = values.iter().position(|v| !(*v == 0.0 || (*v >= low && *v <= high)));
    must(bad.is_none(), || {
        let at = bad.unwrap_or_default();
        format!("tsdf must be 0 or between {low} and {high}, got {} at value {at}", values[at])
    })
}

/// Checks an object by itself.
pub(crate) fn object(object: &ObjectRecord) -> Checked {
    let name = format!("object {}", object.object_id);
    if let ObjectShape::Solid(solid) = object.shape {
        Solid::new(solid.kind, solid.extents_m).map_err(|e| format!("{name} {e}"))?;
    }
    within(&format!("{name} size"), object.shape.extents_m().max_element(), 0.0, POSITION_M_MAX)?;
    within(&format!("{name} mass_kg"), object.mass_kg, f32::MIN_POSITIVE, 1e4)?;
    within(&format!("{name} friction"), object.friction, 0.0, 100.0)?;
    pose(&name, &object.workspace_from_object)
}

/// Checks that an object is one of the dataset's models or, if the dataset has none, a primitive. Rows that are read
/// always are.
fn model(object: &ObjectRecord, info: &DatasetInfo) -> Checked {
    let fits = match &object.shape {
        ObjectShape::Solid(_) => info.models.is_empty(),
        ObjectShape::Model { number, model } => info.models.get(usize::from(*number)).is_some_and(|of| of == model),
    };
    must(fits, || format!("object {} must be one of the dataset's {} models", object.object_id, info.models.len()))
}

/// Checks an attempt by itself.
pub(crate) fn attempt(attempt: &AttemptRecord, gripper: &Gripper) -> Checked {
    let name = format!("attempt {}", attempt.attempt_id);
    let turn = core::f32::consts::TAU;
    within(&format!("{name} tilt_rad"), attempt.tilt_rad, -turn, turn)?;
    within(&format!("{name} turn_rad"), attempt.turn_rad, -turn, turn)?;
    within(&format!("{name} depth_m"), attempt.depth_m, -POSITION_M_MAX, POSITION_M_MAX)?;
    within(&format!("{name} slide_m"), attempt.slide_m, -POSITION_M_MAX, POSITION_M_MAX)?;
    let approach = attempt.rule.approach.axis();
    must(approach.is_none() || matches!(attempt.rule.shape, Shape::Primitive(_)), || {
        format!("{name} must not come along an axis, as its target is a model")
    })?;
    must(approach.is_some() == attempt.closing.is_some(), || {
        format!("{name} must have an axis of closing if it has one of approach, and else none")
    })?;
    must(attempt.closing.is_none() || approach != attempt.closing, || {
        format!("{name} must close across its approach, got {} for both", attempt.closing.map_or("none", Axis::name))
    })?;
    pose(&name, &attempt.workspace_from_grasp)?;
    width(&name, attempt, gripper)?;
    if let Some(robustness) = attempt.robustness {
        must(attempt.label() == 1, || format!("{name} robustness must be absent for {}", attempt.outcome.name()))?;
        within(&format!("{name} robustness"), robustness, 0.0, 1.0)?;
    }
    hit(&name, attempt)
}

fn width(name: &str, attempt: &AttemptRecord, gripper: &Gripper) -> Checked {
    let outcome = attempt.outcome;
    match (outcome, attempt.width_m) {
        (Outcome::PregraspCollision | Outcome::ApproachCollision, Some(width)) => {
            Err(format!("{name} width_m must be absent for {}, got {width}", outcome.name()))
        }
        (Outcome::Held | Outcome::Slipped | Outcome::Empty, None) => {
            Err(format!("{name} width_m must be there for {}", outcome.name()))
        }
        (_, Some(width)) => {
            within(&format!("{name} width_m"), width, -WIDTH_TOLERANCE_M, gripper.opening_m_max + WIDTH_TOLERANCE_M)
        }
        (_, None) => Ok(()),
    }
}

fn hit(name: &str, attempt: &AttemptRecord) -> Checked {
    let AttemptRecord { outcome, hit, hit_object_id, object_id, .. } = *attempt;
    let collides = matches!(outcome, Outcome::PregraspCollision | Outcome::ApproachCollision | Outcome::HitOther);
    must(hit.is_some() == collides, || {
        format!("{name} hit must be {} for {}", if collides { "there" } else { "absent" }, outcome.name())
    })?;
    must(!(outcome == Outcome::HitOther && hit == Some(HitKind::Target)), || {
        format!("{name} hit must not be target for hit_other")
    })?;
    let fits = match hit {
        None | Some(HitKind::Table | HitKind::Container) => hit_object_id.is_none(),
        Some(HitKind::Target) => hit_object_id == Some(object_id),
        Some(HitKind::Other) => hit_object_id.is_some_and(|id| id != object_id),
    };
    must(fits, || {
        let what = hit.map_or("nothing", HitKind::name);
        format!("{name} hit_object_id does not fit: hit {what}, target {object_id}, got {hit_object_id:?}")
    })
}

/// Checks all rows of a scene, each by itself and with one another.
pub(crate) fn scene_rows(rows: &SceneRows, info: &DatasetInfo) -> Checked {
    scene_head(&rows.scene, info)?;
    tsdf(&rows.scene.tsdf, info)?;
    links(&rows.scene, &rows.objects, &rows.attempts)?;
    rows.objects.iter().try_for_each(|o| object(o).and_then(|()| model(o, info)))?;
    rows.attempts.iter().try_for_each(|a| attempt(a, info.gripper_of(rows.scene.scene_id)))
}

/// Checks the keys among the rows of one scene: ids count up from 0, and attempts refer to objects of their shape.
pub(crate) fn links(scene: &SceneRecord, objects: &[ObjectRecord], attempts: &[AttemptRecord]) -> Checked {
    count("object_count", scene.object_count, objects.len())?;
    count("attempt_count", scene.attempt_count, attempts.len())?;
    for (expected, object) in (0..).zip(objects) {
        ids("object", [scene.scene_id, expected], [object.scene_id, object.object_id.into()])?;
    }
    for (expected, attempt) in (0..).zip(attempts) {
        ids("attempt", [scene.scene_id, expected], [attempt.scene_id, attempt.attempt_id.into()])?;
        let target = objects.get(attempt.object_id as usize).ok_or_else(|| {
            format!("attempt {expected} has no target: object {} of {}", attempt.object_id, objects.len())
        })?;
        must(target.shape.shape() == attempt.rule.shape, || {
            let (rule, shape) = (attempt.rule.name(), target.shape.name());
            format!("attempt {expected} has rule {rule} for a {shape}")
        })?;
        must(attempt.hit != Some(HitKind::Container) || scene.container.is_some(), || {
            format!("attempt {expected} hit a container that is not there")
        })?;
        must(attempt.hit_object_id.is_none_or(|id| (id as usize) < objects.len()), || {
            format!(
                "attempt {expected} hit an object that is not there: {:?} of {}",
                attempt.hit_object_id,
                objects.len()
            )
        })?;
    }
    Ok(())
}

fn count(name: &str, said: u32, found: usize) -> Checked {
    must(said as usize == found, || format!("{name} must be the number of rows, {found}, got {said}"))
}

fn ids(table: &str, expected: [u64; 2], got: [u64; 2]) -> Checked {
    let ([scene, number], [other_scene, other]) = (expected, got);
    must(expected == got, || {
        format!("{table} ids must count up: expected scene {scene} number {number}, got {other_scene} {other}")
    })
}

/// Whether a stored volume equals that of the shape within 0.1 %.
pub(crate) fn is_volume(stored_m3: f32, object: &ObjectRecord) -> bool {
    let exact = object.shape.volume_m3();
    (stored_m3 - exact).abs() <= 1e-3 * exact
}

#[cfg(test)]
mod tests {
    use schema::Outcome;

    use super::*;
    use crate::synthetic::{self, info};

    #[test]
    fn made_up_scenes_keep_every_rule_and_hold_some_grasps() {
        let mut info = info(3, 2, 600, 20);
        info.grid.resolution = 12;
        let mut held = 0;
        for scene in 0..info.scene_count {
            let rows = synthetic::scene_rows(scene, info.seed, &info);
            scene_rows(&rows, &info).unwrap_or_else(|e| panic!("scene {scene}: {e}"));
            held += rows.attempts.iter().filter(|a| a.outcome == Outcome::Held).count();
            let seen = rows.scene.tsdf.iter().filter(|v| **v > 0.0).count();
            assert!(seen * 10 > info.grid.len(), "scene {scene}: {seen} voxels seen");
        }
        assert!((60..400).contains(&held), "{held} of 600 held");
    }

    #[test]
    fn the_same_made_up_scene_twice_is_the_same() {
        let mut info = info(3, 1, 40, 20);
        info.grid.resolution = 8;
        let rows = |seed| synthetic::scene_rows(1, seed, &info);
        assert_eq!(rows(3), rows(3));
        assert_ne!(rows(3).attempts, rows(4).attempts);
    }
}
