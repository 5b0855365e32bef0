//! Reading a dataset: every file is compared with its checksum, and every row is checked.

pub(crate) mod dataset;
mod read_error;
mod scenes;
mod table_reader;
#[cfg(any(test, fuzzing))]
pub(crate) mod tests;

pub use dataset::Dataset;
pub use read_error::ReadError;
pub use scenes::Scenes;
