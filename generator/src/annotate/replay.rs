//! Grasps of an object alone, executed again to be shown. The gripper stands still, where it is among the object's
//! grasps, and the object is seen from it.

use program::{ExitCode, Failure};
use rayon::prelude::*;
use schema::{EventKind, Model, ModelPart, ObjectGrasps, Outcome, Pose, Vec3, bounds_m};
use simulator::{Body, FloatingWorld, Load};

use super::bearing::{G_M_S2, PHYSICS, PROCEDURE, hold, loads};
use crate::recorder::{Recorder, Recording, describe_outcome};

/// A grasp of an object alone, executed again.
#[derive(Debug, Clone, PartialEq)]
pub struct GraspReplay {
    /// Its number in its set.
    pub number: u64,
    /// What happened, in the frame in which grasps are given.
    pub recording: Recording,
    /// How it ends now.
    pub outcome: Outcome,
    /// The same as text.
    pub ending: String,
}

/// What `show` makes of the replays of some grasps of a set. The object is the one of the set, whose numbers are
/// rounded once more than those of the object that was labelled, so that a grasp on the verge may end otherwise.
///
/// # Errors
/// If the set's parts are no object.
pub fn grasp_replays<T: Send>(
    set: &ObjectGrasps,
    numbers: &[u64],
    show: impl Fn(GraspReplay) -> T + Sync,
) -> Result<Vec<T>, Failure> {
    let ObjectGrasps { gripper, mass_kg, friction, .. } = set;
    let part = |part: &schema::Polyhedron| ModelPart { corners_m: part.corners_m().to_vec() };
    let model = Model {
        name: set.name.clone(),
        mass_kg: *mass_kg,
        friction: *friction,
        extents_m: set.extents_m,
        volume_m3: set.parts.iter().map(schema::Polyhedron::volume_m3).sum(),
        parts: set.parts.iter().map(part).collect(),
        mesh: None,
    };
    let body = Body::of_model(&model).map_err(|error| Failure::new(ExitCode::Data, error.to_string()))?;
    let [low_m, high_m] = bounds_m(set.parts.iter().flat_map(|part| part.corners_m()));
    let world = FloatingWorld::new(&PHYSICS, gripper, &PROCEDURE, &body, *mass_kg, *friction);
    let replay = |number: &u64| show(replay(&world, set, *number, 0.5 * (low_m + high_m)));
    Ok(numbers.par_iter().map(replay).collect())
}

/// A grasp's replay; `origin_m` is that of the body's frame.
fn replay(world: &FloatingWorld<'_>, set: &ObjectGrasps, number: u64, origin_m: Vec3) -> GraspReplay {
    let (gripper, given) = (&set.gripper, set.grasps[number as usize].object_from_grasp);
    let asked = Pose::from_parts(given.translation - origin_m, given.rotation);
    // An object that was pushed aside is shown where it was gripped.
    let aside = set.grasps[number as usize].pushed_m.and_then(|most_m| world.pushed_aside(&asked, most_m));
    let grasp = aside.map_or(asked, |(aside, _)| aside);
    let mut recorder = Recorder::new(gripper, &PROCEDURE, &PHYSICS, grasp, vec![Pose::IDENTITY]);
    recorder.approach(world.obstruction(&grasp).as_ref());
    let (outcome, width_m) = match world.close_watched(&grasp, Some(&mut recorder)) {
        Err(execution) => (execution.outcome, execution.width_m),
        Ok(grip) => {
            let loads = loads(set.test, gripper);
            let is_held = loads.iter().enumerate().all(|(at, load)| {
                let steps = recorder.bears(describe_load(load, [at + 1, loads.len()]));
                grip.bear_watched(load, &hold(set.test), 1.0, Some((&mut recorder, steps))).is_held
            });
            (if is_held { Outcome::Held } else { Outcome::Slipped }, Some(grip.width_m()))
        }
    };
    let ending = describe_outcome(outcome, None, width_m);
    recorder.happens(if outcome == Outcome::Held { EventKind::Held } else { EventKind::Failed }, ending.clone());

    let mut recording = recorder.recording;
    let [there, back] = [origin_m, -origin_m].map(Pose::from_translation);
    for frame in &mut recording.frames {
        frame.objects.iter_mut().for_each(|pose| *pose = there * *pose * back);
        frame.gripper.iter_mut().for_each(|pose| *pose = there * *pose);
    }
    GraspReplay { number, recording, outcome, ending }
}

fn describe_load(load: &Load, [number, all]: [usize; 2]) -> String {
    let what = match load {
        Load::Pull { acceleration_m_s2, .. } => {
            // A zero more makes 0 of -0.
            let [x, y, z] = (*acceleration_m_s2 * (1.0 / G_M_S2) + Vec3::ZERO).to_array();
            format!("pulled by {x:.1}, {y:.1}, {z:.1} g along x, y, z of the gripper")
        }
        Load::Shake(shake) => format!(
            "shaken by {:.0} mm, then turned by {:.1} rad, to and fro",
            shake.way_m.length() * 1000.0,
            shake.turn_rad.length()
        ),
    };
    if all == 1 { what } else { format!("{number} of {all}: {what}") }
}

#[cfg(test)]
mod tests {
    use schema::{ShapeKind, Solid};

    use super::*;
    use crate::catalogue::CatalogueObject;
    use crate::{AnnotateParams, Annotated, annotate};

    #[test]
    fn grasps_end_as_they_did_and_the_gripper_stands_still_while_it_closes() {
        let cuboid = Solid::new(ShapeKind::Cuboid, Vec3::new(0.03, 0.05, 0.08)).unwrap();
        let object = CatalogueObject { body: cuboid.into(), mass_kg: 0.2, friction: 0.6, origin_m: Vec3::ZERO };
        let origin_m = Vec3::new(0.5, -1.0, 2.0);
        let file = "a test".to_owned();
        let annotated = Annotated { object, file, file_sha256: None, scale_m: 1.0, origin_m, warnings: Vec::new() };
        for test in schema::GripTest::ALL {
            let params = AnnotateParams { grasps: 60, drops: 0, repeats: 0, test, ..AnnotateParams::default() };
            let set = annotate(&annotated, &params, &mut |_| true).unwrap();
            let numbers: Vec<u64> = (0..60).collect();
            let ends = grasp_replays(&set, &numbers, |replay| (replay.number, replay.outcome)).unwrap();
            let others =
                ends.iter().filter(|(number, outcome)| *outcome != set.grasps[*number as usize].outcome).count();
            assert!(ends.len() == 60 && others <= 1, "{others} end otherwise: {test:?}");
        }
        let held = AnnotateParams { grasps: 1, drops: 0, repeats: 0, is_held_only: true, ..AnnotateParams::default() };
        let set = annotate(&annotated, &held, &mut |_| true).unwrap();
        let body = Body::from(cuboid);
        let world = FloatingWorld::new(&PHYSICS, &set.gripper, &PROCEDURE, &body, 0.2, 0.6);
        let GraspReplay { recording, outcome, .. } = replay(&world, &set, 0, origin_m);
        assert_eq!(outcome, Outcome::Held);
        let closes = recording.events.iter().find(|event| event.text == "close").unwrap().frame;
        let frames = &recording.frames;
        assert!(frames[closes..].iter().all(|frame| frame.gripper[2] == frames[closes].gripper[2]), "the palm");
        assert!(
            frames[closes..].iter().any(|frame| frame.objects != frames[0].objects),
            "the object gives way a little"
        );
    }
}
