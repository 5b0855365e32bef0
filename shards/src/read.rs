//! Reading a dataset: every file is compared with its checksum, and every row is checked.

pub(crate) mod dataset;
#[cfg(any(test, fuzzing))]
pub mod fuzzing;
#[cfg(test)]
mod hostile;
mod read_error;
mod scenes;
mod table_reader;

pub use dataset::Dataset;
pub use read_error::ReadError;
pub use scenes::Scenes;
