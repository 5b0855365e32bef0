//! Why a dataset cannot be read.

use program::{Exit, ExitCode};

use crate::format::layout;
use crate::{InfoError, Location, StoreError};

/// Why a dataset, or a part of it, cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// There is no dataset.
    #[error("no dataset here, there is no {}: {}", layout::INFO, .0)]
    NotADataset(Location),
    /// The dataset has no manifest yet.
    #[error("the dataset is not complete, there is no {}: run the missing shards and finalize: {}", layout::MANIFEST, .0)]
    Incomplete(Location),
    /// The info is damaged, or has an unknown version.
    #[error("{source}: {at}")]
    Info {
        /// What is wrong.
        source: InfoError,
        /// The file.
        at: Location,
    },
    /// The manifest is damaged, or belongs to another info.
    #[error("{}: {at}", .problems.join("; "))]
    Manifest {
        /// What is wrong.
        problems: Vec<String>,
        /// The file.
        at: Location,
    },
    /// A file of a shard is missing, or differs from the written one.
    #[error("shard {shard}: {message}: {at}")]
    File {
        /// The shard.
        shard: u32,
        /// What is wrong.
        message: String,
        /// The file.
        at: Location,
    },
    /// There is no such shard or scene.
    #[error("{what} must be below {limit}, got {got}")]
    OutOfRange {
        /// `shard` or `scene`.
        what: &'static str,
        /// The upper limit.
        limit: u64,
        /// The requested number.
        got: u64,
    },
    /// The disk or the object store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl Exit for ReadError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::NotADataset(_) | Self::OutOfRange { .. } => ExitCode::Config,
            Self::Incomplete(_) => ExitCode::Incomplete,
            Self::Info { source, .. } => source.exit_code(),
            Self::Manifest { .. } | Self::File { .. } => ExitCode::Data,
            Self::Store(error) => error.exit_code(),
        }
    }
}
