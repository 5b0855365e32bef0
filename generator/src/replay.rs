//! Executes one stored attempt again and records what happened, where, and what decided.

use std::fmt::Write as _;
use std::str::FromStr;

use program::{ExitCode, Failure};
use rayon::prelude::*;
use report::view::{Body, Class, EventKind, Line, View, flat, flat_points};
use schema::{AttemptRecord, Gripper, HandBox, Lattice, Outcome, Pose, SceneRows};
use shards::Dataset;
use simulator::{AttemptWorld, Execution, Obstruction, Physics, Scene};

use crate::dataset_info::{bodies_of, physics_of};
use crate::recorder::{Recorder, Shot, describe_end, describe_outcome};
use crate::repeat::is_as_stored;

/// Names of the boxes of the hand.
const HAND: [&str; 3] = ["left finger", "right finger", "palm"];

/// An attempt's id, written as SCENE/ATTEMPT.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AttemptId {
    /// The scene, from 0.
    pub scene_id: u64,
    /// The attempt in its scene, from 0.
    pub attempt_id: u32,
}

impl FromStr for AttemptId {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/');
        let parsed = parts.and_then(|(scene, attempt)| Some((scene.parse().ok()?, attempt.parse().ok()?)));
        let (scene_id, attempt_id) =
            parsed.ok_or_else(|| format!("must be SCENE/ATTEMPT, two numbers from 0 such as 17/3, got {text}"))?;
        Ok(Self { scene_id, attempt_id })
    }
}

/// A replayed attempt.
#[derive(Debug, Clone, PartialEq)]
pub struct Replay {
    /// The recording.
    pub view: View,
    /// The stored row.
    pub stored: AttemptRecord,
    /// How it ends now.
    pub now: Execution,
}

impl Replay {
    /// Whether it ends as stored: outcome, what was hit, and the opening to the bit.
    #[must_use]
    pub fn is_reproduced(&self) -> bool {
        is_as_stored(&self.stored, &self.now)
    }

    /// The events and whether the result equals the stored one, as a few lines of text.
    #[must_use]
    pub fn describe(&self) -> String {
        let mut text = String::new();
        for event in &self.view.events {
            let time_s = self.view.frames.get(event.frame).map_or(0.0, |frame| frame.time_s);
            // Writing into a String cannot fail.
            let _ = writeln!(text, "{time_s:6.2} s  {}", event.text);
        }
        let (stored, now) = (describe_stored(&self.stored), describe_end(&self.now));
        text += &match self.is_reproduced() {
            true => format!("as stored: {stored}\n"),
            false => {
                let bits = |width_m: Option<f32>| width_m.map_or("none".to_owned(), |w| format!("{w:?} m"));
                let (before, after) = (bits(self.stored.width_m), bits(self.now.width_m));
                format!("NOT as stored: stored {stored} ({before}), now {now} ({after})\n")
            }
        };
        text
    }
}

fn describe_stored(stored: &AttemptRecord) -> String {
    describe_outcome(stored.outcome, stored.hit.map(|kind| (kind, stored.hit_object_id)), stored.width_m)
}

/// Executes a stored attempt again from its rows with the dataset's own settings, and records it. The shortcuts of the
/// dataset apply here, too; the recording then says so.
///
/// # Errors
/// If the dataset cannot be read, has no such attempt, or was not made by this engine.
pub fn replay(dataset: &Dataset, id: AttemptId) -> Result<Replay, Failure> {
    replay_of(dataset, &dataset.read_scene(id.scene_id)?, id)
}

/// The replays of all attempts of a scene for its page in a folder ([`View::packed`]; `scene` is the page's view), and
/// how many of them end otherwise than stored.
///
/// # Errors
/// If the dataset was not made by this engine.
pub fn packed_replays(dataset: &Dataset, rows: &SceneRows, scene: &View) -> Result<(Vec<String>, usize), Failure> {
    let packed = |attempt: &AttemptRecord| {
        let id = AttemptId { scene_id: attempt.scene_id, attempt_id: attempt.attempt_id };
        let replay = replay_of(dataset, rows, id)?;
        let is_reproduced = replay.is_reproduced();
        Ok((replay.view.packed(scene), is_reproduced))
    };
    let replays = rows.attempts.par_iter().map(packed).collect::<Result<Vec<_>, Failure>>()?;
    let others = replays.iter().filter(|(_, is_reproduced)| !is_reproduced).count();
    Ok((replays.into_iter().map(|(packed, _)| packed).collect(), others))
}

fn replay_of(dataset: &Dataset, rows: &SceneRows, id: AttemptId) -> Result<Replay, Failure> {
    let info = dataset.info();
    let physics = physics_of(&info.config)?;
    let no_such = || {
        let text = format!("attempt must be below {}, got {}", rows.attempts.len(), id.attempt_id);
        Failure::new(ExitCode::Config, text)
    };
    let stored = rows.attempts.get(id.attempt_id as usize).ok_or_else(no_such)?.clone();
    let scene =
        Scene::from_records(info.grid.table_z_m, rows.scene.fixtures(&info.grid), &rows.objects, &bodies_of(info)?);
    let gripper = info.hand_of(id.scene_id);
    let world = AttemptWorld::new(&physics, gripper, &info.procedure, &scene);
    let (grasp, target) = (stored.workspace_from_grasp, stored.object_id as usize);

    let at_rest = rows.objects.iter().map(|row| row.workspace_from_object).collect();
    let mut recorder = Recorder::new((gripper, &info.procedure, &physics), grasp, target, at_rest);
    let obstruction = world.obstruction(&grasp, target);
    recorder.approach(obstruction.map_or(info.procedure.pregrasp_distance_m, |o| o.travel_m));
    if let Some(obstruction) = &obstruction {
        recorder.happens(EventKind::Note, describe_obstruction(gripper, obstruction));
    }
    let now = world.execute_watched(&grasp, target, Some(&mut recorder));

    let Recorder { mut view, shots, .. } = recorder;
    view.title = format!("{}/{}: {}", id.scene_id, id.attempt_id, describe_end(&now));
    // Table and objects first, as in the scene's view: there they need not be told again.
    view.bodies.push(Body::table(info.grid.size_m, info.grid.table_z_m));
    view.bodies.extend(Body::of_container(&rows.scene, &info.grid));
    view.bodies.extend(objects(rows, &stored, &now, &shots));
    view.bodies.extend(hand(gripper, &shots));
    if let Some(obstruction) = &obstruction {
        view.bodies.extend(swept((gripper, info.procedure.pregrasp_distance_m), &grasp, obstruction));
        view.points.push(Line {
            class: Class::Contact,
            label: describe_obstruction(gripper, obstruction),
            points_m: flat_points([obstruction.point_m]),
            frames: None,
        });
    }
    view.lines.push(Line::workspace(Lattice::from(info.grid).corners_m()));
    add_facts(&mut view, dataset.id(), &stored, &now, &physics);
    Ok(Replay { view, stored, now })
}

pub(crate) fn describe_obstruction(gripper: &Gripper, obstruction: &Obstruction) -> String {
    let what = match obstruction.hit.object_id {
        Some(id) => format!("object {id}"),
        None => "the table".to_owned(),
    };
    let (part, clearance_mm) = (HAND[obstruction.part], gripper.clearance_m * 1000.0);
    let when = match obstruction.outcome {
        Outcome::PregraspCollision => "already before the approach".to_owned(),
        _ => format!("after {:.1} mm of the approach", obstruction.travel_m * 1000.0),
    };
    format!("the {part} is within {clearance_mm:.1} mm of {what} {when}")
}

/// The objects; an object that never moves has one pose.
fn objects(rows: &SceneRows, stored: &AttemptRecord, now: &Execution, shots: &[Shot]) -> Vec<Body> {
    let pieces_of = |(id, row): (usize, &schema::ObjectRecord)| {
        let class = match now.hit.and_then(|hit| hit.object_id) {
            _ if id == stored.object_id as usize => Class::Target,
            Some(hit) if hit == id => Class::Hit,
            _ => Class::Object,
        };
        let mut pieces = Body::of_object(class, row);
        for piece in &mut pieces {
            piece.poses = shots.iter().map(|shot| flat(&shot.objects[id])).collect();
            still(piece);
        }
        pieces
    };
    rows.objects.iter().enumerate().flat_map(pieces_of).collect()
}

pub(crate) fn hand(gripper: &Gripper, shots: &[Shot]) -> Vec<Body> {
    let boxed = |part: usize| {
        let poses: Vec<Pose> = shots.iter().map(|shot| shot.hand[part]).collect();
        let mut body = Body::of_box(Class::Hand, HAND[part], &gripper.open_hand()[part], &poses);
        still(&mut body);
        body
    };
    (0..HAND.len()).map(boxed).collect()
}

/// Reduces the poses of a body that never moves to one.
pub(crate) fn still(body: &mut Body) {
    if body.poses.iter().all(|pose| *pose == body.poses[0]) {
        body.poses.truncate(1);
    }
}

/// What the gate tested when it blocked the hand: the open hand or its sweep, with the clearance.
pub(crate) fn swept(
    (gripper, distance_m): (&Gripper, f32),
    workspace_from_grasp: &Pose,
    obstruction: &Obstruction,
) -> Vec<Body> {
    let looked_at = |hand_box: HandBox| match obstruction.outcome {
        Outcome::PregraspCollision => {
            HandBox { centre_m: hand_box.centre_m - schema::Vec3::Z * distance_m, ..hand_box }
        }
        _ => hand_box.swept_back(distance_m),
    };
    let boxes = gripper.open_hand().map(|b| looked_at(b).grown(gripper.clearance_m));
    let body = |(part, hand_box): (usize, &HandBox)| {
        let label = format!("{} on its way, with {:.1} mm around it", HAND[part], gripper.clearance_m * 1000.0);
        Body::of_box(Class::Swept, label, hand_box, &[*workspace_from_grasp])
    };
    boxes.iter().enumerate().map(body).collect()
}

fn add_facts(view: &mut View, dataset_id: &str, stored: &AttemptRecord, now: &Execution, physics: &Physics) {
    let degrees = |angle_rad: f32| format!("{:.2}°", angle_rad.to_degrees());
    let mm = |length_m: f32| format!("{:.2} mm", length_m * 1000.0);
    view.fact("dataset", dataset_id.get(..12).unwrap_or_default());
    view.fact("target", format!("object {}", stored.object_id));
    view.fact("rule", stored.rule.name());
    view.fact("closes along", stored.closing.map_or("–", schema::Axis::name));
    view.fact("tilt, turn", format!("{}, {}", degrees(stored.tilt_rad), degrees(stored.turn_rad)));
    view.fact("depth, slide", format!("{}, {}", mm(stored.depth_m), mm(stored.slide_m)));
    view.fact("stored", describe_stored(stored));
    view.fact("now", describe_end(now));
    view.fact("reproduced", if is_as_stored(stored, now) { "yes, to the bit" } else { "NO" });
    view.fact("steps simulated", format!("{}, {} a second", now.steps, physics.step_rate_hz));
    view.fact("shortcuts", if physics.shortcuts { "on, as in the dataset" } else { "off, as in the dataset" });
}
