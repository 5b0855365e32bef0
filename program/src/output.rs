//! What a command prints and writes.

use std::fmt::Display;
use std::io::{self, ErrorKind, Write};
use std::path::Path;

use crate::{Context, Failure, publish};

/// Prints to standard output. A reader that closed it, such as `head`, had enough: that is no error.
///
/// # Errors
/// If the output cannot be written, for example to a file on a full disk.
pub fn print(text: impl Display) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    match write!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        printed => printed.context("failed to print"),
    }
}

/// Prints a line to standard error. A closed standard error is no reason to fail.
pub fn print_error(text: &str) {
    let _ = writeln!(io::stderr(), "{text}");
}

/// Writes a requested output file with [`publish`].
///
/// # Errors
/// If it cannot be written; the message names it.
pub fn write(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), Failure> {
    publish(path, bytes.as_ref()).context(format_args!("failed to write {}", path.display()))
}
