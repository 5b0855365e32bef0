//! Measures the time of a plan on this machine, stage by stage.

use std::time::Instant;

use serde::Serialize;

use crate::input::InputError;
use crate::observation::{Observation, SeenView, Wishes};
use crate::planner::Planner;
use crate::volume::fuse_views;

/// Times of one stage, in milliseconds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageTime {
    /// Its name.
    pub stage: &'static str,
    /// Median.
    pub median_ms: f64,
    /// 90th percentile.
    pub p90_ms: f64,
}

/// The measurements.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchReport {
    /// Plans.
    pub plans: usize,
    /// Threads.
    pub threads: usize,
    /// Number of fused depth images.
    pub views: usize,
    /// Pixels of each: width and height.
    pub image_px: [usize; 2],
    /// Depth images in memory to TSDF.
    pub tsdf: StageTime,
    /// TSDF in memory to ranked grasps.
    pub plan: StageTime,
    /// The stages of the plan; the network and its detections run in parallel with the segmentation.
    pub stages: Vec<StageTime>,
}

/// Plans `plans` times from the TSDF of depth images, after some warm-up plans.
///
/// # Errors
/// [`InputError`] if the images are refused.
pub fn bench(planner: &Planner, views: &[SeenView], plans: usize) -> Result<BenchReport, InputError> {
    const WARM_UP: usize = 5;
    let (mut fusing, mut planning) = (Vec::new(), Vec::new());
    let mut by_stage: Vec<(&'static str, Vec<f64>)> = Vec::new();
    for number in 0..WARM_UP + plans {
        let began = Instant::now();
        let grid = fuse_views(views, &planner.grid)?;
        let fused_ms = began.elapsed().as_secs_f64() * 1e3;
        let volume = Observation::Tsdf(grid);
        let began = Instant::now();
        let plan = planner.plan(&volume, &Wishes::default())?;
        if number < WARM_UP {
            continue;
        }
        planning.push(began.elapsed().as_secs_f64() * 1e3);
        fusing.push(fused_ms);
        for (stage, ms) in plan.timings_ms {
            match by_stage.iter_mut().find(|(name, _)| *name == stage) {
                Some((_, times)) => times.push(ms),
                None => by_stage.push((stage, vec![ms])),
            }
        }
    }
    let image_px = views.first().map_or([0, 0], |view| [view.image.width_px, view.image.height_px]);
    Ok(BenchReport {
        plans,
        threads: rayon::current_num_threads(),
        views: views.len(),
        image_px,
        tsdf: stage_time("TSDF", fusing),
        plan: stage_time("plan", planning),
        stages: by_stage.into_iter().map(|(stage, times)| stage_time(stage, times)).collect(),
    })
}

fn stage_time(stage: &'static str, mut times_ms: Vec<f64>) -> StageTime {
    times_ms.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let last = times_ms.len().saturating_sub(1);
        times_ms.get((share * last as f64).round() as usize).copied().unwrap_or(0.0)
    };
    StageTime { stage, median_ms: at(0.5), p90_ms: at(0.9) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_sorted_times() {
        let time = stage_time("x", (1..=101).rev().map(f64::from).collect());
        assert_eq!((time.median_ms, time.p90_ms), (51.0, 91.0));
        assert_eq!(stage_time("x", Vec::new()).median_ms, 0.0);
    }
}
