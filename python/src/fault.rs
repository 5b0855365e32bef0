//! Failures as Python exceptions, and what keeps a call from ending the interpreter: a panic, or memory that ends.

use std::hint::black_box;
use std::panic::{AssertUnwindSafe, catch_unwind};

use numpy::{Element, IntoPyArray, PyArray1};
use program::{ExitCode, Failure};
use pyo3::exceptions::PyMemoryError;
use pyo3::prelude::*;

use crate::detached::detached;

mod classes {
    pyo3::import_exception!(graspmill.errors, DataError);
    pyo3::import_exception!(graspmill.errors, IncompleteError);
    pyo3::import_exception!(graspmill.errors, InputError);
    pyo3::import_exception!(graspmill.errors, InternalError);
    pyo3::import_exception!(graspmill.errors, OutsideError);
}

/// Memory that must be free for a call, in bytes, besides what follows from the sizes of its arguments. Allocations
/// within the work cannot fail without ending the process, so a call begins only where there is room.
const SPARE: usize = 64 << 20;

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
    room(0)?;
    detached(py, || caught(work)).map_err(|failure| raised(&failure))
}

/// Refuses a call that may need more memory than there is: so many bytes, and those that any call needs.
pub(crate) fn room(bytes: usize) -> PyResult<()> {
    // Seen by the compiler as used, or it would leave the allocation out.
    reserved::<u8>(bytes.saturating_add(SPARE)).map(|room| drop(black_box(room))).map_err(|failure| raised(&failure))
}

/// A vector with room for so many values.
pub(crate) fn reserved<T>(count: usize) -> Result<Vec<T>, Failure> {
    let mut values = Vec::new();
    let bytes = count.saturating_mul(size_of::<T>());
    let none = |_| Failure::new(ExitCode::TryAgain, format!("out of memory: {bytes} bytes could not be allocated"));
    values.try_reserve_exact(count).map_err(none)?;
    Ok(values)
}

/// An array that keeps these values where they are. Where Python has no memory even for its head, numpy's crate panics.
pub(crate) fn array<T: Element>(py: Python<'_>, values: Vec<T>) -> PyResult<Bound<'_, PyArray1<T>>> {
    let made = catch_unwind(AssertUnwindSafe(|| values.into_pyarray(py)));
    made.map_err(|_| PyMemoryError::new_err("an array could not be allocated"))
}
