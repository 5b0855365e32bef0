//! The threads that share work. They are this module's own and not the process's: threads do not outlive a fork, as of
//! PyTorch's workers, so a child makes new ones.

use std::collections::BTreeMap;
use std::process;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use program::{ExitCode, Failure, thread_pool};
use pyo3::prelude::*;
use rayon::ThreadPool;

use crate::detached::detached;
use crate::fault::{caught, raised, room};

/// Pools by process and number of threads.
static POOLS: Mutex<BTreeMap<(u32, usize), Arc<ThreadPool>>> = Mutex::new(BTreeMap::new());

/// How often a wait looks for a signal.
const LOOK: Duration = Duration::from_millis(100);

/// So many threads; 0 for one per core. More than cores would change nothing.
fn count(threads: usize) -> usize {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    if threads == 0 { cores } else { threads.min(cores) }
}

/// Runs work on so many threads; 0 for one per core.
pub(crate) fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> Result<T, Failure> {
    let key = (process::id(), count(threads));
    let pools = || POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    let found = pools().get(&key).map(Arc::clone);
    let pool = match found {
        Some(pool) => pool,
        // Made without the lock, which a fork at that moment would leave locked in the child.
        None => {
            let made = Arc::new(thread_pool(key.1)?);
            Arc::clone(pools().entry(key).or_insert(made))
        }
    };
    Ok(pool.install(work))
}

/// How far work is, and whether it shall stop.
#[derive(Debug, Default)]
pub(crate) struct Counts {
    pub(crate) stop: AtomicBool,
    pub(crate) done: AtomicU64,
    pub(crate) held: AtomicU64,
}

impl Counts {
    /// So many more are done, of which so many held.
    pub(crate) fn add(&self, done: u64, held: u64) {
        self.done.fetch_add(done, Ordering::Relaxed);
        self.held.fetch_add(held, Ordering::Relaxed);
    }

    /// What is done, and what of it held.
    pub(crate) fn told(&self) -> [u64; 2] {
        [&self.done, &self.held].map(|count| count.load(Ordering::Relaxed))
    }
}

/// What work on threads of its own tells while it runs, and at last what it made. It shall stop when this is dropped.
#[derive(Debug)]
pub(crate) struct Apart<T> {
    told: Mutex<Receiver<Result<T, Failure>>>,
    pub(crate) counts: Arc<Counts>,
}

impl<T> Drop for Apart<T> {
    fn drop(&mut self) {
        self.counts.stop.store(true, Ordering::Relaxed);
    }
}

impl<T: Send + 'static> Apart<T> {
    /// Starts work on threads that no other work waits for: because it waits for Python, or is left alone after Ctrl-C.
    pub(crate) fn start(
        threads: usize,
        work: impl FnOnce(&Sender<Result<T, Failure>>, &Counts) -> Result<T, Failure> + Send + 'static,
    ) -> PyResult<Self> {
        room(0)?;
        let (tell, told) = channel();
        let counts = Arc::new(Counts::default());
        let shared = Arc::clone(&counts);
        let pool = thread_pool(count(threads)).map_err(|failure| raised(&failure))?;
        pool.spawn(move || _ = tell.send(caught(|| work(&tell, &shared)))); // nobody listens after Ctrl-C
        Ok(Self { told: Mutex::new(told), counts })
    }

    /// What it tells next, if it does so soon.
    pub(crate) fn soon(&self, py: Python<'_>) -> PyResult<Option<T>> {
        match detached(py, || self.told().recv_timeout(LOOK)) {
            Ok(told) => told.map(Some).map_err(|failure| raised(&failure)),
            Err(RecvTimeoutError::Timeout) => py.check_signals().map(|()| None),
            Err(RecvTimeoutError::Disconnected) => Err(raised(&Failure::new(ExitCode::Internal, "the work has ended"))),
        }
    }

    /// What it tells next.
    pub(crate) fn next(&self, py: Python<'_>) -> PyResult<T> {
        loop {
            if let Some(told) = self.soon(py)? {
                return Ok(told);
            }
        }
    }

    /// Stops it, and waits until it has ended, whatever signals come.
    pub(crate) fn stop(&self, py: Python<'_>) {
        self.counts.stop.store(true, Ordering::Relaxed);
        detached(py, || self.told().iter().for_each(drop));
    }

    fn told(&self) -> MutexGuard<'_, Receiver<Result<T, Failure>>> {
        self.told.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
