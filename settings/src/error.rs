//! Why settings are refused.

use std::path::PathBuf;

/// Why settings are refused. Every program ends with its exit code for a wrong configuration, 78.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file cannot be read.
    #[error("failed to read the config: {source}: {}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system reports.
        source: std::io::Error,
    },
    /// The text is not TOML.
    #[error("the config is not TOML: {message}: {}", .path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Where and why.
        message: String,
    },
    /// All keys that are unknown, missing or out of range.
    #[error("the config has {} problem{}:\n  {}\n({})", .faults.len(), if .faults.len() == 1 { "" } else { "s" },
            .faults.join("\n  "), .path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// One message per fault, beginning with the key's path.
        faults: Vec<String>,
    },
}
