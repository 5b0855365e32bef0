//! How signals reach a program.

use std::io;
use std::process::exit;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use crate::ExitCode;

/// Signals that come so soon after another are the same one: a scheduler signals a job's script and its processes, and
/// the script passes its own on.
const ONE_SIGNAL: Duration = Duration::from_secs(1);

/// A flag that SIGINT, SIGTERM and SIGHUP raise, after `on_first`. A second signal ends the process at once, with
/// [`ExitCode::TryAgain`]: nothing committed is lost. A process has one flag: a command that is a step of another one
/// gets that one's.
///
/// # Errors
/// If the system refuses.
pub fn stop_on_signals(on_first: impl Fn() + Send + 'static) -> io::Result<Arc<AtomicBool>> {
    static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    if let Some(stop) = STOP.get() {
        return Ok(Arc::clone(stop));
    }
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    let mut first: Option<Instant> = None;
    let handler = move || match first {
        None => {
            first = Some(Instant::now());
            flag.store(true, Ordering::Relaxed);
            on_first();
        }
        Some(first) if first.elapsed() < ONE_SIGNAL => {}
        Some(_) => exit(ExitCode::TryAgain.code().into()),
    };
    ctrlc::set_handler(handler).map_err(io::Error::other)?;
    Ok(Arc::clone(STOP.get_or_init(|| stop)))
}

/// Makes a write beyond the file-size limit (`ulimit -f`) fail like one to a full disk, where it would end the program
/// by a signal.
///
/// # Errors
/// If the system refuses.
pub(crate) fn writes_fail_at_the_file_size_limit() -> io::Result<()> {
    signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default()).map(drop)
}
