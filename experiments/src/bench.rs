//! How long plans take: of the first looks at an experiment's scenes, one after the other, or of the next images of a
//! camera that moves.

use std::time::Instant;

use planner::input::InputError;
use planner::plan::Plan;
use planner::{KeptScene, Observation, Planner};
use program::{ExitCode, Failure, error_chain};
use schema::{Camera, Purpose, Stream, Vec3, axis_angle, pose_from_parts};

use crate::config::Config;
use crate::offer::Look;
use crate::round::{milliseconds, observe};
use crate::start::start;
use crate::statistics::Percentiles;

/// Plans before the first that counts: the first ones also load code and tables.
const UNTIMED: usize = 3;

/// The times of an experiment's plans, in milliseconds.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanTimes {
    /// Of whole plans; `None` without any.
    pub plan_ms: Option<Percentiles>,
    /// Of the stages that the planner itself timed; some run side by side.
    pub stages_ms: Vec<(&'static str, Option<Percentiles>)>,
}

/// Which plans are timed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Looks {
    /// Those of each scene's first look.
    First,
    /// Those of the next images of a camera that goes about the scene, of so many images.
    Next(u32),
}

/// A camera that moves turns about the middle of the workspace by this from image to image.
const TURN_RAD: f32 = 0.07;

/// What was measured.
#[derive(Default)]
struct Times {
    plans_ms: Vec<f32>,
    stages: Vec<(&'static str, Vec<f32>)>,
}

impl Times {
    /// Times a plan, which counts if `is_counted`.
    fn time(&mut self, is_counted: bool, plan: impl FnOnce() -> Result<Plan, InputError>) -> Result<(), InputError> {
        let began = Instant::now();
        let plan = plan()?;
        let plan_ms = milliseconds(began);
        if is_counted {
            self.plans_ms.push(plan_ms);
            for (stage, ms) in plan.timings_ms {
                match self.stages.iter_mut().find(|(name, _)| *name == stage) {
                    Some((_, times)) => times.push(ms as f32),
                    None => self.stages.push((stage, vec![ms as f32])),
                }
            }
        }
        Ok(())
    }
}

/// Times plans of looks at so many scenes of the experiment's first seed.
///
/// # Errors
/// If there is no scene, or the planner refuses what it sees.
pub fn time_plans(config: &Config, planner: &Planner, plans: usize, looks: Looks) -> Result<PlanTimes, Failure> {
    let seed = config.keys.seeds[0];
    let mut times = Times::default();
    for number in 0..plans + UNTIMED {
        let scene_id = number as u64;
        let failed = |why: String| Failure::new(ExitCode::Config, format!("round {scene_id}: {why}"));
        let began = start(config, seed, scene_id).ok_or_else(|| failed("no scene".to_owned()))?;
        let mut noise = Stream::new(seed, scene_id, Purpose::DepthNoise, 0);
        let mut seen = |cameras: &[Camera]| {
            let views = observe(config, cameras, &began.scene, &mut noise);
            Look { config, scene: &began.scene, views, failed: Vec::new() }.as_ours()
        };
        let is_counted = number >= UNTIMED;
        let timed = match looks {
            Looks::First => {
                let (observation, options, _) = seen(&config.cameras());
                times.time(is_counted, || planner.plan(&observation, &options))
            }
            Looks::Next(images) => {
                let mut kept = KeptScene::default();
                (0..images).try_for_each(|image| {
                    let (Observation::Views(views), options, _) = seen(&turned(config, image)) else { return Ok(()) };
                    times.time(is_counted && image > 0, || {
                        views.into_iter().try_for_each(|view| kept.observe(view))?;
                        planner.plan_kept(&mut kept, &options, &|poses| vec![true; poses.len()])
                    })
                })
            }
        };
        timed.map_err(|error| failed(error_chain(&error)))?;
    }
    let Times { plans_ms, stages } = times;
    let stages_ms = stages.into_iter().map(|(stage, times)| (stage, Percentiles::of(times))).collect();
    Ok(PlanTimes { plan_ms: Percentiles::of(plans_ms), stages_ms })
}

/// The experiment's cameras, on their way about the workspace.
fn turned(config: &Config, image: u32) -> Vec<Camera> {
    let half_m = 0.5 * config.scene.grid.size_m;
    let (middle_m, turn) = (Vec3::new(half_m, half_m, 0.0), axis_angle(Vec3::Z, TURN_RAD * image as f32));
    let about = pose_from_parts(turn, middle_m - turn * middle_m);
    let moved = |camera: Camera| {
        let workspace_from_camera = about * camera.workspace_from_camera;
        Camera { workspace_from_camera, ..camera }
    };
    config.cameras().into_iter().map(moved).collect()
}
