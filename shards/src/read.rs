//! Reading a dataset: every byte is compared with its checksum, every row is checked.

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
