//! What the disk or the object store refused.

use std::io;
use std::path::Path;

use program::{Exit, ExitCode};

use crate::Location;

/// The disk, or the object store, did not do what it was asked.
#[derive(Debug, thiserror::Error)]
#[error("failed to {action}: {source}: {at}")]
pub struct StoreError {
    /// What was tried.
    pub action: &'static str,
    /// On what.
    pub at: Location,
    /// What the system said.
    pub source: io::Error,
}

impl Exit for StoreError {
    /// [`ExitCode::TryAgain`], or [`ExitCode::Config`] if the same will be said again: wrong credentials, no such bucket, a
    /// file where a folder should be.
    fn exit_code(&self) -> ExitCode {
        use io::ErrorKind::{FileTooLarge, InvalidInput, NotADirectory, PermissionDenied};
        match (&self.at, self.source.kind()) {
            (Location::Url(_), FileTooLarge | InvalidInput | PermissionDenied) => ExitCode::Config,
            (Location::Path(_), NotADirectory) => ExitCode::Config,
            _ => ExitCode::TryAgain,
        }
    }
}

pub(crate) fn failed(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> StoreError {
    let at = path.into();
    move |source| StoreError { action, at, source }
}
