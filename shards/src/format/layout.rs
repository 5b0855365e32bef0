//! Paths in a dataset's folder.

use crate::Table;

/// The identity of the dataset.
pub const INFO: &str = "meta/info.json";
/// The manifest: all markers and their sum.
pub const MANIFEST: &str = "meta/manifest.json";
/// The dataset card.
pub const CARD: &str = "README.md";

/// An empty file that exists iff the dataset is complete: written last, for tools that check only this file.
pub const SUCCESS: &str = "_SUCCESS";

/// Scenes per row group; row group `k` holds the same scenes in every table.
pub const SCENES_PER_ROW_GROUP: u64 = 256;

/// A shard's file of a table, such as `attempts/shard-00003-of-00064.parquet`.
#[must_use]
pub fn table_file(table: Table, shard: u32, shard_count: u32) -> String {
    format!("{}/shard-{shard:05}-of-{shard_count:05}.parquet", table.name())
}

/// A shard's marker, such as `meta/shards/00003.json`.
#[must_use]
pub fn marker(shard: u32) -> String {
    format!("meta/shards/{shard:05}.json")
}
