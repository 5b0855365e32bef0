//! Writing a dataset by any number of independent processes, until it is complete.

mod begin;
mod card;
mod draft;
mod finalize;
mod plain_table;
mod table_writer;
mod writer;

pub use begin::BeginError;
pub use draft::Draft;
pub use finalize::{FinalizeError, Finalized};
pub use plain_table::{PlainColumn, PlainTableError, plain_table};
pub use table_writer::TableError;
pub use writer::{ShardWriter, WriteError};
