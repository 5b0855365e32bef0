//! How every program starts and ends.

use std::io::{self, IsTerminal};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::prelude::*;

use crate::signals::writes_fail_at_the_file_size_limit;
use crate::{ExitCode, Failure, print_error};

/// Starts logging, runs the command, prints its error if there is one, and returns its exit code. Call it once, as all
/// of `main`. A panic, which prints where it happened, ends with [`ExitCode::Internal`].
///
/// Log lines go to standard error. `GRASPMILL_LOG` selects them, by level or as `target=level,…`
/// (`tracing_subscriber::filter::Targets`); by default warnings and errors are shown.
pub fn run(command: impl FnOnce() -> Result<ExitCode, Failure>) -> ExitCode {
    #[cfg(not(fuzzing))]
    crate::allocator::end_where_memory_ends();
    start_logging();
    if let Err(error) = writes_fail_at_the_file_size_limit() {
        tracing::warn!(%error, "a write beyond the file-size limit will end this program");
    }
    let ended = catch_unwind(AssertUnwindSafe(command));
    let ended =
        ended.unwrap_or_else(|_| Err(Failure::new(ExitCode::Internal, "a defect of this program; please report it")));
    ended.unwrap_or_else(|failure| {
        print_error(&format!("error: {failure}"));
        failure.exit_code()
    })
}

fn start_logging() {
    let asked = std::env::var("GRASPMILL_LOG").unwrap_or_default();
    let asked: Vec<&str> = asked.split(',').filter(|part| !part.trim().is_empty()).collect();
    let asked = (!asked.is_empty()).then(|| asked.join(",").parse::<Targets>()).transpose();
    let unread = asked.as_ref().err().map(ToString::to_string);
    let targets = asked.ok().flatten().unwrap_or_else(|| Targets::new().with_default(LevelFilter::WARN));
    let lines = tracing_subscriber::fmt::layer().with_writer(io::stderr).with_ansi(io::stderr().is_terminal());
    tracing_subscriber::registry().with(lines).with(targets).init();
    if let Some(error) = unread {
        tracing::warn!(%error, "GRASPMILL_LOG must be levels or target=level, separated by commas");
    }
}

/// Starts the threads that share parallel work, one per core unless `threads` says otherwise, before that work begins.
/// A command that is a step of another one goes on with that one's.
///
/// # Errors
/// [`ExitCode::TryAgain`] if the system refuses, or parallel work has begun.
pub fn start_threads(threads: Option<u16>) -> Result<(), Failure> {
    static STARTED: AtomicBool = AtomicBool::new(false);
    if STARTED.swap(true, Ordering::Relaxed) {
        return Ok(());
    }
    ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0).into()).build_global().map_err(|e| not_started(&e))
}

/// A number of threads apart from those.
///
/// # Errors
/// [`ExitCode::TryAgain`] if the system refuses.
pub fn thread_pool(threads: usize) -> Result<ThreadPool, Failure> {
    ThreadPoolBuilder::new().num_threads(threads).build().map_err(|e| not_started(&e))
}

fn not_started(error: &ThreadPoolBuildError) -> Failure {
    Failure::new(ExitCode::TryAgain, format!("failed to start the threads: {error}"))
}
