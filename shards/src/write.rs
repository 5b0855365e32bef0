//! Writing a dataset by any number of independent processes, until it is complete.

mod begin;
mod card;
mod draft;
mod finalize;
mod plain_table;
pub(crate) mod table_writer;
mod writer;

pub use draft::Draft;
pub use finalize::Finalized;
pub use plain_table::{PlainColumn, plain_table, pose_columns};
pub use writer::ShardWriter;
