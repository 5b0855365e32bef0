//! Reading a dataset: every file is compared with its checksum, and every row is checked.

pub(crate) mod dataset;
mod stream;
pub(crate) mod table_reader;
#[cfg(any(test, fuzzing))]
pub(crate) mod tests;
mod verify;

pub use dataset::Dataset;
pub use stream::ArrowStream;
pub use verify::{PROBLEMS_MAX, Verified, verify};
