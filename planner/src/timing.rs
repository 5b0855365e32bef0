//! The times of stages.

use std::time::Instant;

/// Stages and their times in milliseconds.
pub(crate) type Timings = Vec<(&'static str, f64)>;

/// Milliseconds since then.
pub(crate) fn ms_since(began: Instant) -> f64 {
    began.elapsed().as_secs_f64() * 1e3
}

/// Runs a stage and adds its time.
pub(crate) fn timed<T>(timings_ms: &mut Timings, stage: &'static str, run: impl FnOnce() -> T) -> T {
    let began = Instant::now();
    let result = run();
    timings_ms.push((stage, ms_since(began)));
    result
}
