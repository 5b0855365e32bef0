//! The program, run by an interpreter.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs `graspmill` as all of this process: `words` are its command line, its name first. The exit code.
#[pyfunction]
pub(crate) fn run_program(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| graspmill::run(words)).code()
}
