//! How long plans take: of the first looks at an experiment's scenes, one after the other.

use std::time::Instant;

use planner::Planner;
use program::{ExitCode, Failure, error_chain};
use schema::{Purpose, Stream};

use crate::config::Config;
use crate::offer::Look;
use crate::round::observe;
use crate::start::start;

/// Plans before the first that counts: the first ones also load code and tables.
const UNTIMED: usize = 3;

/// The times of an experiment's plans.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanTimes {
    /// Of each plan, in milliseconds, in order.
    pub plans_ms: Vec<f64>,
    /// Medians of stages that the planner itself timed, in milliseconds; some run side by side.
    pub stages_ms: Vec<(&'static str, f64)>,
}

impl PlanTimes {
    /// The time that this share of the plans does not exceed.
    #[must_use]
    pub fn quantile_ms(&self, share: f64) -> f64 {
        quantile(self.plans_ms.clone(), share)
    }
}

/// Times plans of the first looks at so many scenes of the experiment's first seed.
///
/// # Errors
/// If there is no scene, or the planner refuses what it sees.
pub fn time_plans(config: &Config, planner: &Planner, plans: usize) -> Result<PlanTimes, Failure> {
    let seed = config.keys.seeds[0];
    let (mut plans_ms, mut stages) = (Vec::new(), Vec::<(&'static str, Vec<f64>)>::new());
    for number in 0..plans + UNTIMED {
        let scene_id = number as u64;
        let failed = |why: String| Failure::new(ExitCode::Config, format!("round {scene_id}: {why}"));
        let began = start(config, seed, scene_id).ok_or_else(|| failed("no scene".to_owned()))?;
        let views = observe(config, &began.scene, &mut Stream::new(seed, scene_id, Purpose::DepthNoise, 0));
        let look = Look { config, scene: &began.scene, views, failed: Vec::new() };
        let (observation, options, _) = look.as_ours();
        let began = Instant::now();
        let plan = planner.plan(&observation, &options).map_err(|error| failed(error_chain(&error)))?;
        let plan_ms = began.elapsed().as_secs_f64() * 1e3;
        if number < UNTIMED {
            continue;
        }
        plans_ms.push(plan_ms);
        for (stage, ms) in plan.timings_ms {
            match stages.iter_mut().find(|(name, _)| *name == stage) {
                Some((_, times)) => times.push(ms),
                None => stages.push((stage, vec![ms])),
            }
        }
    }
    let stages_ms = stages.into_iter().map(|(stage, times)| (stage, quantile(times, 0.5))).collect();
    Ok(PlanTimes { plans_ms, stages_ms })
}

/// The smallest of some times that this share of them does not exceed; 0 of none.
fn quantile(mut times: Vec<f64>, share: f64) -> f64 {
    times.sort_by(f64::total_cmp);
    let place = (share * times.len() as f64).ceil() as usize;
    times.get(place.saturating_sub(1)).copied().unwrap_or(0.0)
}
