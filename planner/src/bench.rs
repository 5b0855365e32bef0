//! Measures the time of a plan on this machine, stage by stage.

use serde::Serialize;

use crate::input::InputError;
use crate::observation::{Observation, SeenView, Wishes};
use crate::planner::Planner;
use crate::timing::{Timings, timed};
use crate::volume::{corrected, fuse_views};

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
    /// Depth images in memory to the network's TSDF.
    pub tsdf: StageTime,
    /// Depth images in memory to ranked grasps.
    pub plan: StageTime,
    /// The stages of the plan; the network and its detections run in parallel with the segmentation.
    pub stages: Vec<StageTime>,
}

/// Plans `plans` times, at least once, from depth images, after some warm-up plans; the workspace's side is the
/// network's, unless it is given.
///
/// # Errors
/// [`InputError`] if the images are refused.
pub fn bench(
    planner: &Planner,
    views: &[SeenView],
    workspace_size_m: Option<f32>,
    plans: usize,
) -> Result<BenchReport, InputError> {
    const WARM_UP: usize = 5;
    let wishes = Wishes { workspace_size_m, ..Wishes::default() };
    let (grid, seen) = (wishes.workspace(&planner.grid), Observation::Views(views.to_vec()));
    // Each plan has the same stages.
    let plan = |_| -> Result<Timings, InputError> {
        let mut times_ms = Timings::new();
        // As a plan does it, among other things.
        timed(&mut times_ms, "TSDF", || {
            let views = corrected(views, &grid, planner.config.cloud, &mut Vec::new())?;
            fuse_views(&views, &grid)
        })?;
        let plan = timed(&mut times_ms, "plan", || planner.plan(&seen, &wishes))?;
        times_ms.extend(plan.timings_ms);
        Ok(times_ms)
    };
    let all: Vec<Timings> = (0..WARM_UP + plans.max(1)).map(plan).collect::<Result<_, _>>()?;
    let measured = &all[WARM_UP..];
    let time = |at: usize| stage_time(measured[0][at].0, measured.iter().map(|times_ms| times_ms[at].1).collect());
    Ok(BenchReport {
        plans,
        threads: rayon::current_num_threads(),
        views: views.len(),
        image_px: views.first().map_or([0, 0], |view| [view.image.width_px, view.image.height_px]),
        tsdf: time(0),
        plan: time(1),
        stages: (2..measured[0].len()).map(time).collect(),
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
