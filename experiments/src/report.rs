//! An experiment's results as a file, with where they come from.

use std::collections::BTreeMap;
use std::path::Path;

use program::{ExitCode, Failure};
use serde::{Deserialize, Serialize};

use crate::files::json;
use crate::statistics::Results;

/// Where results come from: what it takes to find them again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// The command that was given.
    pub command: String,
    /// The configuration as resolved, TOML.
    pub config: String,
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
        json(&folder.join("report.json"))?.ok_or_else(|| {
            let text = "no experiment that is done here, report.json comes after the last round";
            Failure::new(ExitCode::Config, format!("{text}: {}", folder.display()))
        })
    }
}
