//! One round: a scene is looked at, planned on, grasped from and looked at again, until nothing is left or it is no use.
//!
//! What a robot cell would do, with three liberties. A grasp whose way is blocked leaves the scene as it was: the hand stops at the
//! first touch. What the hand holds is gone at once. And where a failed grasp changed nothing, and the next plan would be the same, the
//! next of its grasps is tried.

use std::time::Instant;

use generator::draw_drops;
use perception::{Tsdf, add_depth_noise, camera_at};
use planner::{Observation, PlanError, Planner, Wishes};
use schema::{Outcome, Pose, Purpose, Stream, Vec3, View, VoxelGrid};
use simulator::{AttemptWorld, Drop, Scene, SceneObject, SceneRays, settle, settle_again};

use crate::config::{Config, Objects};
use crate::packed::draw_packed;
use crate::record::{Ending, RoundRecord, TrialRecord};

/// A round's rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Round {
    /// The round.
    pub record: RoundRecord,
    /// Its grasps.
    pub trials: Vec<TrialRecord>,
}

/// Why a round cannot be played.
#[derive(Debug, thiserror::Error)]
pub enum RoundError {
    /// No try at the scene came to rest.
    #[error("round {round}: no scene in {tries} tries")]
    NoScene {
        /// The round.
        round: u64,
        /// Tries.
        tries: u32,
    },
    /// The planner refuses what the cameras see.
    #[error("round {round}: {source}")]
    Plan {
        /// The round.
        round: u64,
        /// Why.
        source: PlanError,
    },
}

/// Plays round number `round`: a pure function of its arguments, but for the times in its rows.
///
/// # Errors
/// [`RoundError`].
pub fn play(config: &Config, planner: &Planner, round: u64) -> Result<Round, RoundError> {
    let mut scene = first_scene(config, round)?;
    let object_count = scene.objects.len() as u32;
    let (mut removed_count, mut failures, mut trials) = (0, 0, Vec::new());
    // Grasps of the plan that were tried on this very scene.
    let mut tried = 0;
    let views = config.views();
    let ending = loop {
        if scene.objects.is_empty() {
            break Ending::Cleared;
        }
        if failures >= config.stop.failures_max {
            break Ending::Failures;
        }
        if trials.len() >= config.stop.attempts_max as usize {
            break Ending::AttemptsMax;
        }
        let Some((trial, left)) =
            try_once(config, planner, &views, &scene, Place { round, trial: trials.len() as u32, tried })?
        else {
            break Ending::NoGrasp;
        };
        let is_held = trial.outcome == Outcome::Held;
        (removed_count, failures) = if is_held { (removed_count + 1, 0) } else { (removed_count, failures + 1) };
        trials.push(trial);
        if !is_held && left == scene.objects {
            tried += 1;
            continue;
        }
        tried = 0;
        match settle_again(&config.scene.physics, &config.scene.settle, &config.scene.grid, &left) {
            Ok(settled) => scene = settled.scene,
            Err(_) => break Ending::Unsettled,
        }
    };
    let left_count = if ending == Ending::Cleared { 0 } else { scene.objects.len() as u32 };
    let record = RoundRecord {
        round,
        object_count,
        removed_count,
        lost_count: (object_count - removed_count).saturating_sub(left_count),
        attempt_count: trials.len() as u32,
        ending,
    };
    Ok(Round { record, trials })
}

/// Where in a round we are.
#[derive(Clone, Copy)]
struct Place {
    round: u64,
    trial: u32,
    tried: usize,
}

/// One look, one plan, one grasp; what is left of the scene, not at rest yet. `None` without a grasp.
fn try_once(
    config: &Config,
    planner: &Planner,
    views: &[View],
    scene: &Scene,
    Place { round, trial, tried }: Place,
) -> Result<Option<(TrialRecord, Vec<SceneObject>)>, RoundError> {
    let began = Instant::now();
    let volume = observe(config, views, scene, round, trial);
    let observe_ms = milliseconds(began);
    let began = Instant::now();
    let plan = planner
        .plan(&Observation::Tsdf(volume), &Wishes::default())
        .map_err(|source| RoundError::Plan { round, source })?;
    let plan_ms = milliseconds(began);
    let Some(best) = plan.grasps.get(tried) else { return Ok(None) };
    let pose = best.grasp.workspace_from_grasp;
    let target = nearest(scene, pose.translation);
    let world = AttemptWorld::new(&config.scene.physics, &config.scene.gripper, &config.scene.procedure, scene);
    let (execution, poses) = world.execute_leaving(&pose, target);
    let record = TrialRecord {
        round,
        trial,
        object_count: scene.objects.len() as u32,
        planned_count: plan.grasps.len() as u32,
        workspace_from_grasp: pose,
        width_m: best.grasp.width_m,
        quality: best.quality,
        rho_m: best.rho_m,
        shape: scene.objects[target].solid.kind,
        outcome: execution.outcome,
        observe_ms,
        plan_ms,
    };
    let gone = (execution.outcome == Outcome::Held).then_some(target);
    Ok(Some((record, moved(scene, &poses, gone))))
}

fn milliseconds(since: Instant) -> f32 {
    (since.elapsed().as_secs_f64() * 1e3) as f32
}

/// The objects where the attempt left them, without the one that is gone.
fn moved(scene: &Scene, poses: &[Pose], gone: Option<usize>) -> Vec<SceneObject> {
    let objects = scene.objects.iter().zip(poses).enumerate().filter(|(id, _)| Some(*id) != gone);
    objects.map(|(_, (object, pose))| SceneObject { workspace_from_object: *pose, ..object.clone() }).collect()
}

/// The object that a grasp is meant for: the one whose surface is nearest to its origin.
fn nearest(scene: &Scene, point_m: Vec3) -> usize {
    let distance_m = |object: &SceneObject| {
        let local = object.workspace_from_object.inverse() * point_m;
        // How far outside the farthest of the solid's planes; negative inside.
        object.solid.planes().iter().map(|p| p.normal.dot(local) - p.offset_m).fold(f32::NEG_INFINITY, f32::max)
    };
    let distances = scene.objects.iter().map(distance_m).enumerate();
    distances.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(id, _)| id)
}

/// What the cameras see, fused.
fn observe(config: &Config, views: &[View], scene: &Scene, round: u64, trial: u32) -> VoxelGrid {
    let (grid, rays) = (config.scene.grid, SceneRays::new(scene));
    let mut noise = Stream::new(config.seed, round, Purpose::DepthNoise, trial);
    let mut tsdf = Tsdf::new(grid, config.scene.truncation_voxels);
    for view in views {
        let camera = camera_at(view, &grid, config.scene.intrinsics);
        if config.noise == perception::DepthNoise::None {
            let seen = rays.seen_from(&camera);
            tsdf.integrate(&camera, |pixel| seen.depth_at(pixel));
        } else {
            let mut image = rays.render(&camera);
            add_depth_noise(&mut image, &config.noise, &mut noise);
            tsdf.integrate(&camera, |pixel| image.at(pixel));
        }
    }
    tsdf.to_voxels()
}

/// The scene of a round, at rest.
fn first_scene(config: &Config, round: u64) -> Result<Scene, RoundError> {
    let generator::Config { physics, settle: law, grid, tries_max, .. } = &config.scene;
    for tries in 0..*tries_max {
        let settled = match &config.objects {
            Objects::Pile { count } => {
                let mut objects = config.scene.objects.clone();
                objects.counts = vec![(*count, 1.0)];
                let drops: Vec<Drop> = draw_drops(&objects, grid, config.seed, round, tries);
                settle(physics, law, grid, &drops)
            }
            Objects::Packed(packed) => {
                let mut stream = Stream::new(config.seed, round, Purpose::Drops, tries);
                let objects = draw_packed(packed, grid, &mut stream);
                settle_again(physics, law, grid, &objects)
            }
        };
        if let Ok(settled) = settled
            && !settled.scene.objects.is_empty()
        {
            return Ok(settled.scene);
        }
    }
    Err(RoundError::NoScene { round, tries: *tries_max })
}
