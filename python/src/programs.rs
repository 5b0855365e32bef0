//! The program, run by an interpreter, and how it writes files.

use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::prelude::*;

use crate::detached::detached;
use crate::fault::free;

/// Runs `graspmill` as all of this process: `words` are its command line, its name first. The exit code.
#[pyfunction]
pub(crate) fn run_program(py: Python<'_>, words: Vec<OsString>) -> u8 {
    detached(py, || graspmill::run(words)).code()
}

/// Writes a file, or replaces it, at once and whole.
#[pyfunction]
pub(crate) fn publish(py: Python<'_>, path: PathBuf, text: &str) -> PyResult<()> {
    Ok(detached(py, || program::publish(&path, text.as_bytes()))?)
}

/// Refuses what is no checkpoint that is whole.
#[pyfunction]
pub(crate) fn check_checkpoint(py: Python<'_>, path: PathBuf) -> PyResult<()> {
    free(py, || network::checkpoint::read(&path).map(drop))
}
