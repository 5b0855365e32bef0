//! Replays to look at: attempts of a scene, and grasps of an object alone, executed again.

use generator::recorder::{self, BOX_NAMES, Recording, describe_end};
use generator::{AttemptId, GraspReplay, Replay};
use program::Failure;
use report::view::{Body, Class, Frame, Line, View, flat};
use schema::{Axis, Gripper, Lattice, ObjectGrasps, Pose, SceneRows};
use shards::{Dataset, DatasetInfo};

/// A stored attempt, executed again, and how it is shown.
///
/// # Errors
/// If the dataset cannot be read, has no such attempt, or was not made by this engine.
pub fn replayed(dataset: &Dataset, id: AttemptId) -> Result<(Replay, View), Failure> {
    let rows = dataset.read_scene(id.scene_id)?;
    let replay = generator::replay(dataset.info(), &rows, id.attempt_id)?;
    let view = attempt_view(dataset.info(), dataset.id(), &rows, &replay);
    Ok((replay, view))
}

/// The replays of all attempts of a scene for its page in a folder ([`View::packed`]; `scene` is the page's view), each
/// with whether it ends as stored.
pub(crate) fn of_scene(dataset: &Dataset, rows: &SceneRows, scene: &View) -> Result<Vec<(String, bool)>, Failure> {
    let (info, id) = (dataset.info(), dataset.id());
    let packed = |replay: Replay| (attempt_view(info, id, rows, &replay).packed(scene), replay.is_reproduced());
    generator::replays(info, rows, &rows.attempts, packed)
}

/// As [`of_scene`], of some grasps of a set for the page of their object.
pub(crate) fn of_object(set: &ObjectGrasps, numbers: &[u64], object: &View) -> Result<Vec<(String, bool)>, Failure> {
    generator::grasp_replays(set, numbers, |replay| {
        let is_reproduced = replay.outcome == set.grasps[replay.number as usize].outcome;
        (grasp_view(set, replay, object).packed(object), is_reproduced)
    })
}

/// The page of the attempt of these rows, of which only grasp, outcome and what kind of thing was hit are known.
///
/// # Errors
/// If the settings are not those of this engine.
pub fn failure_page(info: &DatasetInfo, rows: &SceneRows) -> Result<String, Failure> {
    let shown = |mut replay: Replay| {
        replay.stored.width_m = replay.now.width_m;
        replay.stored.hit_object_id = replay.now.hit.and_then(|hit| hit.object_id).map(|id| id as u32);
        let mut view = attempt_view(info, "", rows, &replay);
        view.facts.retain(|fact| ["target", "stored", "now"].contains(&fact.key.as_str()));
        view.page()
    };
    Ok(generator::replays(info, rows, &rows.attempts, shown)?.concat())
}

fn attempt_view(info: &DatasetInfo, dataset_id: &str, rows: &SceneRows, replay: &Replay) -> View {
    let Replay { recording, stored, now } = replay;
    let ending = describe_end(now);
    let mut view = View::new(format!("{}/{}: {ending}", stored.scene_id, stored.attempt_id));
    // Table and objects first, as in the scene's view: there they need not be told again.
    view.bodies.push(Body::table(info.grid.size_m, info.grid.table_z_m));
    view.bodies.extend(Body::of_container(&rows.scene, &info.grid));
    for (id, row) in rows.objects.iter().enumerate() {
        let class = match now.hit.and_then(|hit| hit.object_id) {
            _ if id == stored.object_id as usize => Class::Target,
            Some(hit) if hit == id => Class::Hit,
            _ => Class::Object,
        };
        let poses = poses(recording, |frame| frame.objects[id]);
        view.bodies.push(Body { poses, ..Body::of_object(class, row) });
    }
    add(&mut view, recording, info.gripper_of(stored.scene_id));
    view.lines.push(Line::workspace(Lattice::from(info.grid).corners_m()));

    let degrees = |angle_rad: f32| format!("{:.2}°", angle_rad.to_degrees());
    let mm = |length_m: f32| format!("{:.2} mm", length_m * 1000.0);
    view.fact("dataset", dataset_id.get(..12).unwrap_or_default());
    view.fact("target", format!("object {}", stored.object_id));
    view.fact("rule", stored.rule.name());
    view.fact("closes along", stored.closing.map_or("–", Axis::name));
    view.fact("tilt, turn", format!("{}, {}", degrees(stored.tilt_rad), degrees(stored.turn_rad)));
    view.fact("depth, slide", format!("{}, {}", mm(stored.depth_m), mm(stored.slide_m)));
    view.fact("stored", replay.stored_ending());
    view.fact("now", ending);
    view.fact("reproduced", if replay.is_reproduced() { "yes, to the bit" } else { "NO" });
    view
}

fn grasp_view(set: &ObjectGrasps, replay: GraspReplay, object: &View) -> View {
    let GraspReplay { number, recording, ending, .. } = replay;
    let grasp = &set.grasps[number as usize];
    let mut view = View::new(format!("{}/{number}: {ending}", set.name));
    // As in the object's view: there its form need not be told again.
    let poses = poses(&recording, |frame| frame.objects[0]);
    view.bodies.extend(object.bodies.first().map(|body| Body { class: Class::Target, poses, ..body.clone() }));
    add(&mut view, &recording, &set.gripper);
    view.fact("stored", grasp.outcome.name());
    view.fact("now", ending);
    view.fact("test", set.test.name());
    view.fact("seen from", "the gripper, which stands still");
    view
}

/// A body's pose in every frame, or the only one.
fn poses(recording: &Recording, pose: impl Fn(&recorder::Frame) -> Pose) -> Vec<[f32; 7]> {
    let mut poses: Vec<[f32; 7]> = recording.frames.iter().map(|frame| flat(&pose(frame))).collect();
    if poses.iter().all(|pose| *pose == poses[0]) {
        poses.truncate(1);
    }
    poses
}

/// Adds frames and events, and the gripper.
fn add(view: &mut View, recording: &Recording, gripper: &Gripper) {
    view.frames = recording.frames.iter().map(|frame| Frame { time_s: frame.time_s }).collect();
    view.events.clone_from(&recording.events);
    for (number, (part, gripper_box)) in gripper.parts([0.0; 2]).iter().enumerate() {
        let poses = poses(recording, |frame| frame.gripper[*part]);
        let name = BOX_NAMES[if gripper.jaws.is_empty() { number } else { *part }];
        view.bodies.push(Body { poses, ..Body::of_box(Class::Gripper, name, gripper_box, &[]) });
    }
}

/// How the replays of pages went.
#[derive(Debug, Default)]
pub struct Replays {
    /// Why there are no more of them, if something failed.
    pub trouble: Option<Failure>,
    /// How many there are.
    pub count: usize,
    /// How many of them end otherwise than stored.
    pub others: usize,
}

impl Replays {
    /// Some more replays; none from the first failure on.
    pub(crate) fn kept(&mut self, make: impl FnOnce() -> Result<Vec<(String, bool)>, Failure>) -> Vec<String> {
        if self.trouble.is_some() {
            return Vec::new();
        }
        match make() {
            Ok(replays) => {
                self.count += replays.len();
                self.others += replays.iter().filter(|(_, is_reproduced)| !is_reproduced).count();
                replays.into_iter().map(|(packed, _)| packed).collect()
            }
            Err(failure) => {
                self.trouble = Some(failure);
                Vec::new()
            }
        }
    }
}
