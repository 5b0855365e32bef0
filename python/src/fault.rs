//! Failures as Python exceptions.

use std::panic::{AssertUnwindSafe, catch_unwind};

use program::{ExitCode, Failure};
use pyo3::prelude::*;

mod classes {
    pyo3::import_exception!(graspmill.errors, DataError);
    pyo3::import_exception!(graspmill.errors, IncompleteError);
    pyo3::import_exception!(graspmill.errors, InputError);
    pyo3::import_exception!(graspmill.errors, InternalError);
    pyo3::import_exception!(graspmill.errors, OutsideError);
}

/// The exception of a failure: its class says what its exit code says.
pub(crate) fn raised(failure: &Failure) -> PyErr {
    let text = failure.to_string();
    match failure.exit_code() {
        ExitCode::Ok | ExitCode::Internal => classes::InternalError::new_err(text),
        ExitCode::Usage | ExitCode::Config => classes::InputError::new_err(text),
        ExitCode::Data | ExitCode::Partial => classes::DataError::new_err(text),
        ExitCode::Incomplete => classes::IncompleteError::new_err(text),
        ExitCode::TryAgain => classes::OutsideError::new_err(text),
    }
}

/// A failure of what the caller gave.
pub(crate) fn wrong(text: impl Into<String>) -> PyErr {
    classes::InputError::new_err(text.into())
}

/// Does work. A panic, which prints where it happened, is a defect of ours.
pub(crate) fn caught<T, E: Into<Failure>>(work: impl FnOnce() -> Result<T, E>) -> Result<T, Failure> {
    let done = catch_unwind(AssertUnwindSafe(|| work().map_err(Into::into)));
    done.unwrap_or_else(|_| Err(Failure::new(ExitCode::Internal, "a defect of graspmill; please report it")))
}

/// Does work without the interpreter's lock.
pub(crate) fn free<T: Send, E: Into<Failure> + Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T, E> + Send,
) -> PyResult<T> {
    py.detach(|| caught(work)).map_err(|failure| raised(&failure))
}
