//! The content of a dataset's files and its checks: columns, rows, `meta/`, and the frame of a Parquet file.

pub(crate) mod check;
pub(crate) mod column;
pub(crate) mod decode;
pub(crate) mod encode;
mod footer;
pub(crate) mod frame;
mod info;
pub mod layout;
pub(crate) mod seal;
pub(crate) mod summary;
mod thrift;

pub use column::{Form, Table};
pub use info::{ATTEMPTS_MAX, DatasetInfo, RESOLUTION_MAX, SHARDS_MAX};
