//! The Python package's native half: the programs, and what they are made of, as functions on NumPy arrays.
//!
//! The package's Python half (`python/graspmill`) has the names that users see. It checks arguments, so that a message
//! names them; here arrays have the right types. All work runs without the interpreter's lock (`detached`), on threads
//! of this module's own (`pool`), and a panic becomes an exception (`fault`).

mod annotate;
mod crops;
mod dataset;
mod detached;
mod experiment;
mod fault;
mod generate;
mod plan;
mod pool;
mod programs;
mod scene;

use pyo3::prelude::*;
#[cfg(feature = "as-tests")]
use regex_syntax as _; // for its features alone, which proptest switches on

/// The module `graspmill._native`.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::annotate::Annotation;
    #[pymodule_export]
    use crate::crops::Crops;
    #[pymodule_export]
    use crate::dataset::Dataset;
    #[pymodule_export]
    use crate::detached::end;
    #[pymodule_export]
    use crate::experiment::{Experiment, Seen, experiment_page};
    #[pymodule_export]
    use crate::generate::Generation;
    #[pymodule_export]
    use crate::plan::{Plan, Planner, Planning};
    #[pymodule_export]
    use crate::programs::{check_checkpoint, publish, run_program};
    #[pymodule_export]
    use crate::scene::{Body, Scene, Simulation, execute, fuse};
    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "its name in Python")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
