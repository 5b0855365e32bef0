//! The files of an experiment whose rounds are all played.

use std::path::Path;

use program::{Failure, json, write};

use crate::config::Config;
use crate::record::Round;
use crate::report::{About, Report};
use crate::statistics::{Results, results};
use crate::tables::{attempts_table, bodies, conditions, objects_table, rounds_table};

/// Writes tables and results into the folder. `command` is what the report names as what was asked for,
/// `model_id` who planned.
///
/// # Errors
/// If a file cannot be written.
pub fn finish(
    config: &Config,
    command: String,
    model_id: String,
    rounds: &[Round],
    folder: &Path,
) -> Result<Results, Failure> {
    let versions = [("experiments".to_owned(), env!("CARGO_PKG_VERSION").to_owned())].into();
    let about = About { command, config: config.text.clone(), model_id, versions };
    let report = Report { results: results(&config.keys.protocol, rounds), about };
    write(&folder.join("rounds.parquet"), rounds_table(rounds)?)?;
    write(&folder.join("attempts.parquet"), attempts_table(rounds)?)?;
    write(&folder.join("objects.parquet"), objects_table(rounds)?)?;
    write(&folder.join("bodies.json"), bodies(config))?;
    write(&folder.join("run.json"), conditions(config))?;
    write(&folder.join("report.json"), json(&report)?)?;
    Ok(report.results)
}
