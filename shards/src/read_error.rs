//! Why a dataset cannot be read.

use std::path::PathBuf;

use crate::{ExitCode, InfoError, StoreError, layout};

/// Why a dataset, or a part of it, cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// There is no dataset.
    #[error("no dataset here, there is no {}: {}", layout::INFO, .0.display())]
    NotADataset(PathBuf),
    /// The dataset has no manifest yet.
    #[error("the dataset is not complete, there is no {}: run the missing shards and finalize: {}", layout::MANIFEST, .0.display())]
    Incomplete(PathBuf),
    /// The info is damaged, or of an unknown version.
    #[error("{source}: {}", .path.display())]
    Info {
        /// What is wrong.
        source: InfoError,
        /// The file.
        path: PathBuf,
    },
    /// The manifest is damaged, or belongs to another info.
    #[error("{}: {}", .problems.join("; "), .path.display())]
    Manifest {
        /// What is wrong.
        problems: Vec<String>,
        /// The file.
        path: PathBuf,
    },
    /// A file of a shard is missing, or not the one that was written.
    #[error("shard {shard}: {message}: {}", .path.display())]
    File {
        /// The shard.
        shard: u32,
        /// What is wrong.
        message: String,
        /// The file.
        path: PathBuf,
    },
    /// There is no such shard or scene.
    #[error("{what} must be below {limit}, got {got}")]
    OutOfRange {
        /// `shard` or `scene`.
        what: &'static str,
        /// How many there are.
        limit: u64,
        /// What was asked for.
        got: u64,
    },
    /// The disk refused.
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl ReadError {
    /// The code to end with.
    #[must_use]
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::NotADataset(_) | Self::OutOfRange { .. } => ExitCode::Config,
            Self::Incomplete(_) => ExitCode::Incomplete,
            Self::Info { source, .. } => source.exit_code(),
            Self::Manifest { .. } | Self::File { .. } => ExitCode::Data,
            Self::Store(error) => error.exit_code(),
        }
    }
}
