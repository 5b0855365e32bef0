//! Grasps of an object alone, executed again for its page. The hand stands still, where it is among the object's
//! grasps, and the object is seen from it.

use program::{ExitCode, Failure};
use rayon::prelude::*;
use report::view::{Body as Shown, Class, EventKind, Line, View, flat, flat_points};
use schema::{Model, ModelPart, ObjectGrasps, Outcome, Pose, Vec3, bounds_m};
use simulator::{Body, FloatingWorld, Load};

use super::bearing::{G_M_S2, HOLD, PHYSICS, PROCEDURE, loads};
use crate::recorder::{Recorder, describe_outcome};
use crate::replay::{describe_obstruction, hand, still, swept};

/// The replays of some grasps of a set for the page of their object ([`View::packed`]; `scene` is the page's view), and
/// how many of them end otherwise than stored. The object is the one of the set, whose numbers are rounded once more
/// than those of the object that was labelled, so that a grasp on the verge may end otherwise.
///
/// # Errors
/// If the set's parts are no object.
pub fn grasp_replays(set: &ObjectGrasps, numbers: &[u64], scene: &View) -> Result<(Vec<String>, usize), Failure> {
    let ObjectGrasps { gripper, mass_kg, friction, .. } = set;
    let part = |part: &schema::Polyhedron| ModelPart { corners_m: part.corners_m().to_vec() };
    let model = Model {
        name: set.name.clone(),
        mass_kg: *mass_kg,
        friction: *friction,
        extents_m: set.extents_m,
        volume_m3: set.parts.iter().map(schema::Polyhedron::volume_m3).sum(),
        parts: set.parts.iter().map(part).collect(),
    };
    let body = Body::of_model(&model).map_err(|error| Failure::new(ExitCode::Data, error.to_string()))?;
    let [low_m, high_m] = bounds_m(set.parts.iter().flat_map(|part| part.corners_m()));
    let world = FloatingWorld::new(&PHYSICS, gripper, &PROCEDURE, (&body, *mass_kg, *friction));
    let packed = |number: &u64| {
        let (view, outcome) = replay(&world, set, *number as usize, 0.5 * (low_m + high_m));
        (view.packed(scene), outcome == set.grasps[*number as usize].outcome)
    };
    let replays: Vec<(String, bool)> = numbers.par_iter().map(packed).collect();
    let others = replays.iter().filter(|(_, is_reproduced)| !is_reproduced).count();
    Ok((replays.into_iter().map(|(packed, _)| packed).collect(), others))
}

/// A grasp's replay in the frame in which grasps are given, where `origin_m` is that of the body's frame; and how it
/// ends.
fn replay(world: &FloatingWorld<'_>, set: &ObjectGrasps, number: usize, origin_m: Vec3) -> (View, Outcome) {
    let (gripper, given) = (&set.gripper, set.grasps[number].object_from_grasp);
    let grasp = Pose::from_parts(given.translation - origin_m, given.rotation);
    let mut recorder = Recorder::new((gripper, &PROCEDURE, &PHYSICS), grasp, 0, vec![Pose::IDENTITY]);
    let obstruction = world.obstruction(&grasp);
    recorder.approach(obstruction.map_or(PROCEDURE.pregrasp_distance_m, |obstruction| obstruction.travel_m));
    if let Some(obstruction) = &obstruction {
        recorder.happens(EventKind::Note, describe_obstruction(gripper, obstruction));
    }
    let (outcome, width_m) = match world.close_watched(&grasp, Some(&mut recorder)) {
        Err(execution) => (execution.outcome, execution.width_m),
        Ok(grip) => {
            let loads = loads(set.test, gripper);
            let is_held = loads.iter().enumerate().all(|(at, load)| {
                let steps = recorder.bears(describe_load(load, [at + 1, loads.len()]));
                grip.bear_watched(load, &HOLD, 1.0, Some((&mut recorder, steps))).is_held
            });
            (if is_held { Outcome::Held } else { Outcome::Slipped }, Some(grip.width_m()))
        }
    };
    let ending = describe_outcome(outcome, None, width_m);
    recorder.happens(if outcome == Outcome::Held { EventKind::Held } else { EventKind::Failed }, ending.clone());

    let Recorder { mut view, mut shots, .. } = recorder;
    view.title = format!("{}/{number}: {ending}", set.name);
    let [there, back] = [origin_m, -origin_m].map(Pose::from_translation);
    for shot in &mut shots {
        shot.objects.iter_mut().for_each(|pose| *pose = there * *pose * back);
        shot.hand.iter_mut().for_each(|pose| *pose = there * *pose);
    }
    for point_m in view.points.iter_mut().flat_map(|points| &mut points.points_m) {
        *point_m = (Vec3::from_array(*point_m) + origin_m).to_array();
    }
    // As in the object's view: there the parts need not be told again.
    let poses: Vec<Pose> = shots.iter().map(|shot| shot.objects[0]).collect();
    view.bodies.extend(set.parts.iter().map(|part| {
        let mut body = Shown::of_part(Class::Target, set.name.clone(), part, &[]);
        body.poses = poses.iter().map(flat).collect();
        still(&mut body);
        body
    }));
    view.bodies.extend(hand(gripper, &shots));
    if let Some(obstruction) = &obstruction {
        view.bodies.extend(swept((gripper, PROCEDURE.pregrasp_distance_m), &given, obstruction));
        view.points.push(Line {
            class: Class::Contact,
            label: describe_obstruction(gripper, obstruction),
            points_m: flat_points([obstruction.point_m + origin_m]),
            frames: None,
        });
    }
    view.fact("stored", set.grasps[number].outcome.name());
    view.fact("now", ending);
    view.fact("test", set.test.name());
    view.fact("seen from", "the hand, which stands still");
    (view, outcome)
}

fn describe_load(load: &Load, [number, all]: [usize; 2]) -> String {
    let what = match load {
        Load::Pull { acceleration_m_s2, .. } => {
            let [x, y, z] = (*acceleration_m_s2 * (1.0 / G_M_S2)).to_array();
            format!("pulled by {x:.1}, {y:.1}, {z:.1} g along x, y, z of the hand")
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
    fn grasps_end_as_they_did_and_the_hand_stands_still_while_it_closes() {
        let cuboid = Solid::new(ShapeKind::Cuboid, Vec3::new(0.03, 0.05, 0.08)).unwrap();
        let object = CatalogueObject { body: cuboid.into(), mass_kg: 0.2, friction: 0.6, origin_m: Vec3::ZERO };
        let origin_m = Vec3::new(0.5, -1.0, 2.0);
        let annotated = Annotated { object, file: "a test".to_owned(), scale_m: 1.0, origin_m };
        for test in schema::GripTest::ALL {
            let params = AnnotateParams { grasps: 60, drops: 0, test, ..AnnotateParams::default() };
            let set = annotate(&annotated, &params, &mut |_| true).unwrap();
            let numbers: Vec<u64> = (0..60).collect();
            let (replays, others) = grasp_replays(&set, &numbers, &View::new("a page")).unwrap();
            assert!(replays.len() == 60 && others <= 1, "{others} end otherwise: {test:?}");
        }
        let held = AnnotateParams { grasps: 1, drops: 0, is_held_only: true, ..AnnotateParams::default() };
        let set = annotate(&annotated, &held, &mut |_| true).unwrap();
        let body = Body::from(cuboid);
        let world = FloatingWorld::new(&PHYSICS, &set.gripper, &PROCEDURE, (&body, 0.2, 0.6));
        let (view, outcome) = replay(&world, &set, 0, origin_m);
        assert_eq!(outcome, Outcome::Held);
        let closes = view.events.iter().find(|event| event.text == "close").unwrap().frame;
        let [part, .., palm] = &view.bodies[..] else { panic!("{}", view.bodies.len()) };
        assert!(palm.poses[closes..].iter().all(|pose| *pose == palm.poses[closes]), "the palm");
        assert!(part.poses[closes..].iter().any(|pose| *pose != part.poses[0]), "the object gives way a little");
    }
}
