//! Executes one stored attempt again and records what happened, where, and what decided.

use std::fmt::Write as _;
use std::str::FromStr;

use program::{ExitCode, Failure};
use rayon::prelude::*;
use schema::{AttemptRecord, Pose, SceneRows};
use shards::DatasetInfo;
use simulator::{AttemptWorld, Execution, Scene};

use crate::dataset_info::{bodies_of, physics_of};
use crate::recorder::{Recorder, Recording, describe_end, describe_outcome};
use crate::repeat::is_as_stored;

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
    /// What happened.
    pub recording: Recording,
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
        for event in &self.recording.events {
            let time_s = self.recording.frames.get(event.frame).map_or(0.0, |frame| frame.time_s);
            // Writing into a String cannot fail.
            let _ = writeln!(text, "{time_s:6.2} s  {}", event.text);
        }
        let (stored, now) = (self.stored_ending(), describe_end(&self.now));
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

    /// The stored end as text.
    #[must_use]
    pub fn stored_ending(&self) -> String {
        let stored = &self.stored;
        describe_outcome(stored.outcome, stored.hit.map(|kind| (kind, stored.hit_object_id)), stored.width_m)
    }
}

/// Executes an attempt of a stored scene again from its rows with the dataset's own settings, and records it. The
/// shortcuts of the dataset apply here, too; the recording then says so.
///
/// # Errors
/// If the scene has no such attempt, or the dataset was not made by this engine.
pub fn replay(info: &DatasetInfo, rows: &SceneRows, attempt_id: u32) -> Result<Replay, Failure> {
    let no_such = || {
        let text = format!("attempt must be below {}, got {attempt_id}", rows.attempts.len());
        Failure::new(ExitCode::Config, text)
    };
    let stored = rows.attempts.get(attempt_id as usize).ok_or_else(no_such)?;
    Ok(replays(info, rows, std::slice::from_ref(stored), |replay| replay)?.remove(0))
}

/// What `show` makes of the replay of each of some attempts of a scene.
///
/// # Errors
/// If the dataset was not made by this engine.
pub fn replays<T: Send>(
    info: &DatasetInfo,
    rows: &SceneRows,
    attempts: &[AttemptRecord],
    show: impl Fn(Replay) -> T + Sync,
) -> Result<Vec<T>, Failure> {
    let physics = physics_of(&info.config)?;
    let fixtures = rows.scene.fixtures(&info.grid);
    let scene = Scene::from_records(info.grid.table_z_m, fixtures, &rows.objects, &bodies_of(info)?);
    let gripper = info.gripper_of(rows.scene.scene_id);
    let world = AttemptWorld::new(&physics, gripper, &info.procedure, &scene);
    let at_rest: Vec<Pose> = rows.objects.iter().map(|row| row.workspace_from_object).collect();
    let replay = |stored: &AttemptRecord| {
        let (grasp, target) = (stored.workspace_from_grasp, stored.object_id as usize);
        let mut recorder = Recorder::new(gripper, &info.procedure, &physics, grasp, at_rest.clone());
        recorder.approach(world.obstruction(&grasp, target).as_ref());
        let now = world.execute_watched(&grasp, target, Some(&mut recorder));
        show(Replay { recording: recorder.recording, stored: stored.clone(), now })
    };
    Ok(attempts.par_iter().map(replay).collect())
}
