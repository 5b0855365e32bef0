//! The five programs, run by an interpreter.

use std::ffi::OsString;

use program::{embed, run_to_code};
use pyo3::prelude::*;

use crate::fault::wrong;

/// Runs a program as all of this process: `words` are its command line, its name first, and `starter` starts any of the
/// programs. The exit code.
#[pyfunction]
pub(crate) fn run_program(py: Python<'_>, name: &str, words: Vec<OsString>, starter: Vec<OsString>) -> PyResult<u8> {
    let run = match name {
        "generator" => || run_to_code(generator::commands::run),
        "shards" => || run_to_code(shards::commands::run),
        "trainer" => || run_to_code(trainer::commands::run),
        "planner" => || run_to_code(planner::commands::run),
        "experiments" => || run_to_code(experiments::commands::run),
        _ => return Err(wrong(format!("there is no program {name}"))),
    };
    embed(words, starter);
    Ok(py.detach(run).code())
}
