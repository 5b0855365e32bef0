//! Errors of the disk and the object store.

use std::io;

use program::{Exit, ExitCode};

use crate::Location;

/// A failed operation on the disk or the object store.
#[derive(Debug, thiserror::Error)]
#[error("failed to {action}: {source}: {at}")]
pub struct StoreError {
    /// The operation.
    pub action: &'static str,
    /// The file or object.
    pub at: Location,
    /// The system's error.
    pub source: io::Error,
}

impl Exit for StoreError {
    /// [`ExitCode::TryAgain`], or [`ExitCode::Config`] if a retry would fail in the same way: wrong credentials, no
    /// such bucket; on a disk, that of the system's error.
    fn exit_code(&self) -> ExitCode {
        use io::ErrorKind::{FileTooLarge, InvalidInput, PermissionDenied};
        match (&self.at, self.source.kind()) {
            (Location::Url(_), FileTooLarge | InvalidInput | PermissionDenied) => ExitCode::Config,
            (Location::Url(_), _) => ExitCode::TryAgain,
            (Location::Path(_), _) => self.source.exit_code(),
        }
    }
}

/// What makes an operation's error of the system's.
pub(crate) fn failed(action: &'static str, at: impl Into<Location>) -> impl FnOnce(io::Error) -> StoreError {
    let at = at.into();
    move |source| StoreError { action, at, source }
}
