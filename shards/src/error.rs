//! Why an operation on a dataset failed.

use program::{Exit, ExitCode};

use crate::StoreError;

/// Why a dataset, or a part of it, cannot be begun, written, completed, read or exported. Nobody acts on the reason but
/// for the exit code and a failed store, which may work the next time.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The disk or the object store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Anything else, in words, and the code with which a program ends because of it.
    #[error("{1}")]
    Wrong(ExitCode, String),
}

impl Error {
    /// The number of something that there is not, such as a scene.
    #[must_use]
    pub fn out_of_range(what: &str, limit: u64, got: u64) -> Self {
        Self::Wrong(ExitCode::Config, format!("{what} must be below {limit}, got {got}"))
    }
}

impl Exit for Error {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::Store(error) => error.exit_code(),
            Self::Wrong(code, _) => *code,
        }
    }
}
