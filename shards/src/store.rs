//! Where a dataset's files lie, a folder or an object store, and how a file appears there whole or not at all.

mod error;
mod fault;
mod folder;
mod location;
mod remote;
mod staged;
mod storage;

use std::collections::BTreeMap;

#[cfg(test)]
pub(crate) use fault::{Fault, Kind};
#[cfg(test)]
pub(crate) use folder::Store;
pub(crate) use folder::is_staging;
pub use location::Location;
pub(crate) use remote::Patience;
pub(crate) use staged::{Ready, Staged, Trouble};
pub(crate) use storage::{Storage, file_name, size_in, size_problem};

/// What lies in a folder: names, and the sizes of those that are files.
pub(crate) type Listing = BTreeMap<String, Option<u64>>;

/// Largest file of `meta/` that is read.
pub(crate) const META_BYTES_MAX: u64 = 1 << 30;
