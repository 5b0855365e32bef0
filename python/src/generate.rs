//! `graspmill.generate`: the generator, with progress and Ctrl-C.

use std::path::PathBuf;

use ::generator::{Config, Event, Overrides, attempts_of};
use program::{ExitCode, Failure};
use pyo3::prelude::*;
use shards::{Finalized, Location};

use crate::fault::{raised, wrong};
use crate::pool::Apart;

/// All shards of a dataset, which are being generated.
#[pyclass(module = "graspmill._native")]
#[derive(Debug)]
pub(crate) struct Generation {
    work: Apart<()>,
    total: u64,
}

#[pymethods]
impl Generation {
    /// Begins it.
    #[new]
    #[expect(clippy::too_many_arguments, reason = "its caller in Python has them as keywords")]
    fn new(
        out: &str,
        config: Option<PathBuf>,
        shards: Option<u64>,
        attempts: Option<u64>,
        seed: Option<u64>,
        policy: Option<PathBuf>,
        set: Vec<(String, String)>,
        rejected_max: f64,
        threads: usize,
    ) -> PyResult<Self> {
        let location = Location::parse(out).map_err(wrong)?;
        let overrides = Overrides { seed, shards, attempts, policy: policy.as_deref(), set: &set };
        let config = Config::load(config.as_deref(), overrides).map_err(|error| raised(&error.into()))?;
        let info = config.dataset_info();
        let wanted: Vec<u32> = (0..config.shards).collect();
        let total = wanted.iter().map(|shard| attempts_of(&info, *shard)).sum();
        let work = Apart::start(threads, move |_, counts| {
            let on_event = |event: Event| match event {
                Event::Skipped { attempts } => counts.add(attempts, 0),
                Event::Scene { attempts, positives } => counts.add(attempts, positives),
            };
            let report = ::generator::generate(&config, location, &wanted, rejected_max, &counts.stop, &on_event)?;
            match &report.dataset {
                Some(Finalized::Incomplete { missing }) => {
                    let text = format!("{} shards are missing, {} the first of them", missing.len(), missing[0]);
                    Err(Failure::new(ExitCode::Incomplete, text))
                }
                _ => Ok(()),
            }
        })?;
        Ok(Self { work, total })
    }

    /// The attempts that are there, all attempts of the dataset, and the positive ones of this run.
    #[getter]
    fn counts(&self) -> (u64, u64, u64) {
        let [done, held] = self.work.counts.told();
        (done, self.total, held)
    }

    /// Whether it ends within a moment.
    fn has_ended(&mut self, py: Python<'_>) -> PyResult<bool> {
        Ok(self.work.soon(py)?.is_some())
    }

    /// Stops it, and waits until the complete shards are committed.
    fn stop(&mut self, py: Python<'_>) {
        self.work.stop(py);
    }
}
