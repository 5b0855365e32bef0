//! One round: observe the scene, plan, execute the best grasp, and repeat until the table is empty or a limit is
//! reached.
//!
//! This is what a robot cell would do, with three simplifications. A grasp whose way is blocked leaves the scene
//! unchanged, because the gripper stops at the first touch. A held object is removed immediately. If a failed grasp
//! changed nothing, so that the next plan would be equal, the next grasp of the same plan is tried.

use std::time::Instant;

use perception::add_depth_noise;
use planner::View;
use program::{ExitCode, Failure, error_chain};
use schema::{Camera, Outcome, Pose, Purpose, Stream};
use simulator::{
    AttemptWorld, Execution, Scene, SceneObject, SceneRays, SettleParams, Settled, Unsettled, settle_again,
};

use crate::config::{Choice, Config, Touching};
use crate::offer::{Look, NoPlan, Offer, Plans, sound};
use crate::record::{Attempt, AttemptObject, Ending, Round};
use crate::start::{Start, UNVIABLE_MAX, start};

/// Objects slower than this may be trembling.
const TREMBLING_M_S: f32 = 0.05;
const TREMBLING_RAD_S: f32 = 1.0;

/// Runs round number `round` of all seeds' rounds: a pure function of its arguments, except for the times in its rows.
///
/// # Errors
/// If there is no scene, or the planner refuses the observation.
pub fn play(config: &Config, planner: &dyn Plans, round: u64) -> Result<Round, Failure> {
    let (seed, scene_id) = (config.keys.seeds[(round / config.keys.rounds) as usize], round % config.keys.rounds);
    let failed = |why: String| Failure::new(ExitCode::Config, format!("round {round}: {why}"));
    let began = start(config, seed, scene_id);
    let none = format!(
        "no scene: {} were rejected, or {UNVIABLE_MAX} had an object that the gripper cannot span",
        config.scene.settle.tries_max
    );
    let Start { mut scene, container, group, unviable_count } = began.ok_or_else(|| failed(none))?;
    let mut played = Round {
        round,
        seed,
        scene_id,
        group,
        unviable_count,
        object_count: scene.objects.len() as u32,
        removed_count: 0,
        lost_count: 0,
        ending: Ending::Cleared,
        no_answer: None,
        container,
        attempts: Vec::new(),
        left: Vec::new(),
    };
    // The number of changes of the scene, and the grasps of its plan that were tried. An unchanged scene gives the same
    // observation.
    let (mut look, mut tried) = (0, 0);
    let (mut failures, mut failed_grasps) = (0, Vec::new());
    played.ending = loop {
        if scene.objects.is_empty() {
            break Ending::Cleared;
        }
        if failures >= config.keys.stop.failures_max {
            break Ending::Failures;
        }
        if played.attempts.len() >= config.keys.stop.attempts_max as usize {
            break Ending::AttemptsMax;
        }
        let mut noise = Stream::new(seed, scene_id, Purpose::DepthNoise, look);
        let (attempt, left) = match try_once(config, planner, &scene, &failed_grasps, &mut noise, tried) {
            Ok(Some(tried)) => tried,
            Ok(None) => break Ending::NoGrasp,
            Err(NoPlan::Refused(error)) => return Err(failed(error_chain(&error))),
            Err(NoPlan::NoAnswer(why)) => {
                played.no_answer = Some(why);
                break Ending::NoAnswer;
            }
        };
        let is_held = attempt.outcome == Outcome::Held;
        played.removed_count += u32::from(is_held);
        failures = if is_held { 0 } else { failures + 1 };
        if is_held {
            failed_grasps.clear();
        } else if config.keys.stop.avoid_failed {
            failed_grasps.push(attempt.workspace_from_grasp);
        }
        played.attempts.push(attempt);
        if !is_held && left == scene.objects {
            tried += usize::from(!config.keys.stop.avoid_failed);
            continue;
        }
        (look, tried) = (look + 1, 0);
        match rest_again(&config.scene, &scene, &left) {
            Ok(settled) => scene = settled.scene,
            Err(_) => break Ending::Unsettled,
        }
    };
    played.left = scene.objects.iter().map(AttemptObject::from).collect();
    played.lost_count = (played.object_count - played.removed_count).saturating_sub(played.left.len() as u32);
    Ok(played)
}

/// The scene after an attempt, at rest. Hulls of many faces, such as a duck's, can tremble on the table indefinitely,
/// by some centimetres per second without moving away. If the settling criterion is not reached, slow objects count as
/// resting.
fn rest_again(config: &generator::Config, before: &Scene, left: &[SceneObject]) -> Result<Settled, Unsettled> {
    let generator::Config { physics, settle, grid, .. } = config;
    settle_again(physics, settle, grid, &before.fixtures, left).or_else(|_| {
        let params = SettleParams {
            linear_speed_m_s_max: TREMBLING_M_S.max(settle.linear_speed_m_s_max),
            angular_speed_rad_s_max: TREMBLING_RAD_S.max(settle.angular_speed_rad_s_max),
            ..*settle
        };
        settle_again(physics, &params, grid, &before.fixtures, left)
    })
}

/// One observation, one plan, one grasp: the first but `tried`; returns the resulting scene, not at rest yet. `None`
/// without a grasp.
fn try_once(
    config: &Config,
    planner: &dyn Plans,
    scene: &Scene,
    failed: &[Pose],
    noise: &mut Stream,
    tried: usize,
) -> Result<Option<(Attempt, Vec<SceneObject>)>, NoPlan> {
    let began = Instant::now();
    let views = observe(config, scene, noise);
    let observe_ms = milliseconds(began);
    let began = Instant::now();
    let offers = sound(planner.plan(Look { config, scene, views, failed: failed.to_vec() })?)?;
    let plan_ms = milliseconds(began);
    let world = AttemptWorld::new(&config.scene.physics, &config.plan.gripper, &config.scene.procedure, scene);
    let mut ends = offers.iter().skip(tried).map(|best| {
        let pose = best.workspace_from_grasp;
        (best, pose, execute(config.keys.touching, &world, scene, &pose))
    });
    let chosen = match config.keys.choice {
        Choice::First => ends.next(),
        Choice::Holds => ends.find(|(.., (_, (execution, _)))| execution.outcome == Outcome::Held),
    };
    let Some((Offer { width_m, quality, rho_m, .. }, pose, (target, (execution, poses)))) = chosen else {
        return Ok(None);
    };
    let attempt = Attempt {
        object_count: scene.objects.len() as u32,
        planned_count: offers.len() as u32,
        workspace_from_grasp: pose,
        width_m: *width_m,
        quality: *quality,
        rho_m: *rho_m,
        target_id: target as u32,
        objects: scene.objects.iter().map(AttemptObject::from).collect(),
        outcome: execution.outcome,
        hit: execution.hit.map(|hit| hit.kind),
        observe_ms,
        plan_ms,
    };
    let gone = (execution.outcome == Outcome::Held).then_some(target);
    Ok(Some((attempt, moved(scene, &poses, gone))))
}

/// Tries a grasp of the object that is nearest to it, and gives what it leaves behind.
fn execute(
    touching: Touching,
    world: &AttemptWorld<'_>,
    scene: &Scene,
    workspace_from_grasp: &Pose,
) -> (usize, (Execution, Vec<Pose>)) {
    let target = scene.nearest(workspace_from_grasp.translation).unwrap_or(0);
    let halted = match touching {
        Touching::Fails => None,
        Touching::Halts => world.halted(workspace_from_grasp),
    };
    let Some(halted) = halted else { return (target, world.execute_leaving(workspace_from_grasp, target)) };
    let target = scene.nearest(halted.translation).unwrap_or(0);
    let (mut execution, poses) = world.close_and_lift(&halted, target);
    if execution.outcome == Outcome::HitOther {
        execution = Execution { outcome: Outcome::Held, hit: None, ..execution };
    }
    (target, (execution, poses))
}

fn milliseconds(since: Instant) -> f32 {
    (since.elapsed().as_secs_f64() * 1e3) as f32
}

/// The objects after the attempt, without the removed one.
fn moved(scene: &Scene, poses: &[Pose], gone: Option<usize>) -> Vec<SceneObject> {
    let objects = scene.objects.iter().zip(poses).enumerate().filter(|(id, _)| Some(*id) != gone);
    objects.map(|(_, (object, pose))| SceneObject { workspace_from_object: *pose, ..object.clone() }).collect()
}

/// What the experiment's cameras see of a scene, with its noise.
#[must_use]
pub fn observe(config: &Config, scene: &Scene, noise: &mut Stream) -> Vec<View> {
    let rays = SceneRays::new(scene);
    let seen = |camera: Camera| {
        let mut image = rays.render(&camera);
        add_depth_noise(&mut image, &config.noise, noise);
        View::new(image, camera)
    };
    config.cameras().into_iter().map(seen).collect()
}
