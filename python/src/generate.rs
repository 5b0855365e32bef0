//! `graspmill.generate`: the generator, with progress and Ctrl-C.

use std::panic::resume_unwind;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use ::generator::{Config, Event, Overrides, attempts_of};
use program::{ExitCode, Failure};
use pyo3::prelude::*;
use shards::{Finalized, Location};

use crate::fault::{caught, raised, wrong};
use crate::pool::on_threads;

/// How often progress is told and a signal looked for.
const LOOK: Duration = Duration::from_millis(100);

/// Generates all shards of a dataset. `progress` is called on this thread with the attempts that are there, all
/// attempts of the dataset, and the positive ones of this run. Returns the numbers of attempts and positives that this
/// run made.
#[pyfunction]
#[pyo3(signature = (out, config, shards, attempts, seed, policy, set, rejected_max, threads, progress))]
#[expect(clippy::too_many_arguments, reason = "its caller in Python has them as keywords")]
pub(crate) fn generate(
    py: Python<'_>,
    out: &str,
    config: Option<PathBuf>,
    shards: Option<u64>,
    attempts: Option<u64>,
    seed: Option<u64>,
    policy: Option<PathBuf>,
    set: Vec<(String, String)>,
    rejected_max: f64,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<(u64, u64)> {
    let location = Location::parse(out).map_err(wrong)?;
    let overrides = Overrides { seed, shards, attempts, policy: policy.as_deref(), set: &set };
    let config = Config::load(config.as_deref(), overrides).map_err(|error| raised(&error.into()))?;
    let info = config.dataset_info();
    let wanted: Vec<u32> = (0..config.shards).collect();
    let (stop, done, held) = (AtomicBool::new(false), AtomicU64::new(0), AtomicU64::new(0));
    let on_event = |event: Event| {
        let (more, positive) = match event {
            Event::Skipped { attempts, .. } | Event::TakenUp { attempts } => (attempts, 0),
            Event::Scene { attempts, positives } => (attempts, positives),
            Event::Committed { .. } => (0, 0),
        };
        done.fetch_add(more, Ordering::Relaxed);
        held.fetch_add(positive, Ordering::Relaxed);
    };
    let total: u64 = wanted.iter().map(|shard| attempts_of(&info, *shard)).sum();
    let tell = |py: Python<'_>| {
        let numbers = (done.load(Ordering::Relaxed), total, held.load(Ordering::Relaxed));
        progress.as_ref().map_or(Ok(()), |progress| progress.call1(py, numbers).map(drop))
    };
    let work =
        || on_threads(threads, || ::generator::generate(&config, location, &wanted, rejected_max, &stop, &on_event));
    let (ended, told) = thread::scope(|scope| {
        let worker = scope.spawn(|| caught(|| work().and_then(|done| done)));
        let mut told = Ok(());
        while !worker.is_finished() {
            py.detach(|| thread::sleep(LOOK));
            // The first exception, a KeyboardInterrupt perhaps, stops the work; the finished scenes are kept.
            if told.is_ok() {
                told = py.check_signals().and_then(|()| tell(py));
                stop.store(told.is_err(), Ordering::Relaxed);
            }
        }
        let ended = py.detach(|| worker.join()).unwrap_or_else(|panic| resume_unwind(panic)); // none is left
        (ended, told)
    });
    told?;
    let report = ended.map_err(|failure| raised(&failure))?;
    tell(py)?;
    if let Some(Finalized::Incomplete { missing }) = &report.dataset {
        let text = format!("{} shards are missing, {} the first of them", missing.len(), missing[0]);
        return Err(raised(&Failure::new(ExitCode::Incomplete, text)));
    }
    Ok((done.into_inner(), report.made.labels.positives))
}
