//! What a program must set up before it writes.

use std::io;

/// Makes a write beyond the file-size limit (`ulimit -f`) fail like one to a full disk, where it would end the program by
/// a signal. Call it once, when a program starts.
///
/// # Errors
/// If the system refuses.
#[cfg(unix)]
pub fn writes_fail_at_the_file_size_limit() -> io::Result<()> {
    signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default()).map(drop)
}

/// Elsewhere there is no such signal.
#[cfg(not(unix))]
pub fn writes_fail_at_the_file_size_limit() -> io::Result<()> {
    Ok(())
}
