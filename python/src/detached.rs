//! Out of the interpreter, and back into it.
//!
//! A thread that asks for the interpreter's lock while the interpreter ends is ended by it (hung, from Python 3.14 on):
//! its stack is unwound through frames of Rust, which ends the process with a signal. So what comes back when the
//! interpreter is about to end stays outside, and Python's functions are called by its half of the package alone, with
//! no frame of ours below them.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering, fence};
use std::thread::{self, ThreadId};
use std::time::{Duration, Instant};

use pyo3::prelude::*;

/// The thread that ends the interpreter.
static ENDING: OnceLock<ThreadId> = OnceLock::new();
/// Threads that may be waiting for the interpreter's lock.
static RETURNING: AtomicUsize = AtomicUsize::new(0);
/// Longest wait for them: a forked child counts those of its parent, too.
const WAIT: Duration = Duration::from_secs(1);

/// Does work without the interpreter's lock. It does not return to an interpreter that ends.
pub(crate) fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> T {
    let done = py.detach(|| {
        let done = work();
        RETURNING.fetch_add(1, Ordering::SeqCst);
        fence(Ordering::SeqCst);
        if ENDING.get().is_some_and(|ending| *ending != thread::current().id()) {
            RETURNING.fetch_sub(1, Ordering::SeqCst);
            loop {
                thread::park();
            }
        }
        done
    });
    RETURNING.fetch_sub(1, Ordering::SeqCst);
    done
}

/// Called when the interpreter is about to end (`atexit`): lets the threads that are on their way back come back.
#[pyfunction]
pub(crate) fn end(py: Python<'_>) {
    ENDING.get_or_init(|| thread::current().id());
    fence(Ordering::SeqCst);
    let begun = Instant::now();
    while RETURNING.load(Ordering::SeqCst) > 0 && begun.elapsed() < WAIT {
        py.detach(|| thread::sleep(Duration::from_millis(1)));
    }
}
