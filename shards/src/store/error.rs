//! Errors of the disk and the object store.

use std::io::{self, ErrorKind};

use program::{Exit as _, ExitCode, Failure};

use crate::Location;

/// What makes a failure of the system's error: what was to be done, and with what.
///
/// Its code is [`ExitCode::TryAgain`], or [`ExitCode::Config`] if a retry would fail in the same way: wrong
/// credentials, no such bucket; on a disk, that of the system's error.
pub(crate) fn failed(action: &'static str, at: impl Into<Location>) -> impl FnOnce(io::Error) -> Failure {
    use ErrorKind::{FileTooLarge, InvalidInput, PermissionDenied};
    let at = at.into();
    move |source| {
        let code = match (&at, source.kind()) {
            (Location::Url(_), FileTooLarge | InvalidInput | PermissionDenied) => ExitCode::Config,
            (Location::Url(_), _) => ExitCode::TryAgain,
            (Location::Path(_), _) => source.exit_code(),
        };
        Failure::new(code, format!("failed to {action}: {source}: {at}"))
    }
}
