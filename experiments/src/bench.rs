//! How long plans take: of the first looks at an experiment's scenes, one after the other.

use std::time::Instant;

use planner::Planner;
use program::{ExitCode, Failure, error_chain};
use schema::{Purpose, Stream};

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

/// Times plans of the first looks at so many scenes of the experiment's first seed.
///
/// # Errors
/// If there is no scene, or the planner refuses what it sees.
pub fn time_plans(config: &Config, planner: &Planner, plans: usize) -> Result<PlanTimes, Failure> {
    let seed = config.keys.seeds[0];
    let (mut plans_ms, mut stages) = (Vec::new(), Vec::<(&'static str, Vec<f32>)>::new());
    for number in 0..plans + UNTIMED {
        let scene_id = number as u64;
        let failed = |why: String| Failure::new(ExitCode::Config, format!("round {scene_id}: {why}"));
        let began = start(config, seed, scene_id).ok_or_else(|| failed("no scene".to_owned()))?;
        let views = observe(config, &began.scene, &mut Stream::new(seed, scene_id, Purpose::DepthNoise, 0));
        let look = Look { config, scene: &began.scene, views, failed: Vec::new() };
        let (observation, options, _) = look.as_ours();
        let began = Instant::now();
        let plan = planner.plan(&observation, &options).map_err(|error| failed(error_chain(&error)))?;
        let plan_ms = milliseconds(began);
        if number < UNTIMED {
            continue;
        }
        plans_ms.push(plan_ms);
        for (stage, ms) in plan.timings_ms {
            match stages.iter_mut().find(|(name, _)| *name == stage) {
                Some((_, times)) => times.push(ms as f32),
                None => stages.push((stage, vec![ms as f32])),
            }
        }
    }
    let stages_ms = stages.into_iter().map(|(stage, times)| (stage, Percentiles::of(times))).collect();
    Ok(PlanTimes { plan_ms: Percentiles::of(plans_ms), stages_ms })
}
