//! Reading a dataset: every file is compared with its checksum, and every row is checked.

pub(crate) mod dataset;
mod plain_table;
mod stream;
pub(crate) mod table_reader;
#[cfg(any(test, fuzzing))]
pub(crate) mod tests;
mod verify;

pub use dataset::Dataset;
pub use plain_table::read_plain_table;
pub use stream::ArrowStream;
pub use verify::{Verified, verify};
