//! The files of an experiment whose rounds are all played: tables, and results with where they come from.

use std::collections::BTreeMap;
use std::io::{Error, ErrorKind};
use std::path::Path;

use program::{ExitCode, Failure, json, unread, write};
use serde::{Deserialize, Serialize};

use crate::config::Config;
use crate::files::bytes;
use crate::record::Round;
use crate::statistics::{Results, results};
use crate::tables::{attempts_table, bodies, conditions, objects_table, rounds_table};

/// Where results come from: what it takes to find them again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// The command that was given.
    pub command: String,
    /// The configuration as resolved, TOML.
    pub config: String,
    /// Who planned; nothing in reports of before this was told.
    #[serde(default)]
    pub planner: String,
    /// SHA-256 of the network's weights.
    pub model_id: String,
    /// Versions of what took part, by name.
    pub versions: BTreeMap<String, String>,
}

/// An experiment's results and where they come from: `report.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// The results.
    pub results: Results,
    /// Where they come from.
    pub about: About,
}

impl Report {
    /// Reads the report in the folder of an experiment that is done.
    ///
    /// # Errors
    /// If there is none, or it cannot be read or is damaged.
    pub fn read(folder: &Path) -> Result<Self, Failure> {
        let path = folder.join("report.json");
        let text = bytes(&path)?.ok_or_else(|| {
            let text = "no experiment that is done here, report.json comes after the last round";
            Failure::new(ExitCode::Config, format!("{text}: {}", folder.display()))
        })?;
        serde_json::from_slice(&text).map_err(|error| unread(&path, &Error::new(ErrorKind::InvalidData, error)))
    }
}

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
    let planner = config.planned_by.clone();
    let about = About { command, config: config.text.clone(), planner, model_id, versions };
    let report = Report { results: results(&config.keys.protocol, rounds), about };
    write(&folder.join("rounds.parquet"), rounds_table(rounds)?)?;
    write(&folder.join("attempts.parquet"), attempts_table(rounds)?)?;
    write(&folder.join("objects.parquet"), objects_table(rounds)?)?;
    write(&folder.join("bodies.json"), bodies(config))?;
    write(&folder.join("run.json"), conditions(config))?;
    write(&folder.join("report.json"), json(&report)?)?;
    Ok(report.results)
}
