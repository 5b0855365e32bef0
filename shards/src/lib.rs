//! The records of a dataset on disk: three Parquet tables, their manifest, and the atomic commit of a shard. The only
//! crate that uses Parquet, and the only one that accesses object stores.
//!
//! # A dataset's folder
//!
//! ```text
//! README.md                                  dataset card, made by finalize
//! meta/info.json                             the identity: written first; its SHA-256 is the dataset's id
//! meta/shards/00003.json                     marker: written last; a shard exists iff its marker does
//! meta/manifest.json                         all markers and their sum: exists iff the dataset is complete
//! _SUCCESS                                   empty: written after the manifest
//! attempts/shard-00003-of-00064.parquet      one row per attempt
//! scenes/shard-00003-of-00064.parquet        one row per scene, with its TSDF
//! objects/shard-00003-of-00064.parquet       one row per object
//! ```
//!
//! # Writing and reading
//!
//! ```
//! # let dir = tempfile::tempdir().unwrap();
//! # let dir = dir.path();
//! // A copy of another dataset: its scenes are as good as any.
//! let sample = shards::Dataset::open(std::path::Path::new("tests/data/format-1"))?;
//! let info = sample.info().clone();
//! let draft = shards::Draft::begin(dir, &info)?;
//! for shard in 0..info.shard_count {
//!     if draft.is_committed(shard)? {
//!         continue; // written by an earlier run
//!     }
//!     let mut writer = draft.shard(shard)?;
//!     for scene in info.scenes_of(shard) {
//!         writer.push(&sample.read_scene(scene)?)?;
//!     }
//!     writer.commit()?;
//! }
//! assert!(matches!(draft.finalize()?, shards::Finalized::Complete(_)));
//!
//! let dataset = shards::Dataset::open(dir)?;
//! assert_eq!(dataset.read_scene(0)?, sample.read_scene(0)?);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A shard's bytes are a pure function of its rows: no clock, no host name, no library version. Every error is a
//! [`program::Failure`], which has an exit code.

#[cfg(any(test, fuzzing))]
extern crate self as shards; // as the files of tests/support name it

mod format;
mod read;
mod store;
#[cfg(any(test, fuzzing))]
#[path = "../../tests/support/synthetic.rs"]
mod synthetic;
mod write;

pub use format::layout::{self, SCENES_PER_ROW_GROUP};
pub use format::summary::{Counts, FileSummary, Manifest, RejectionCounts, ShardSummary, Tally};
pub use format::{ATTEMPTS_MAX, DatasetInfo, Form, RESOLUTION_MAX, SHARDS_MAX, Table};
#[cfg(any(test, fuzzing))]
pub use read::tests::fuzzing;
pub use read::{ArrowStream, Dataset, Verified, read_plain_table, verify};
pub use store::Location;
pub use write::{Draft, Finalized, PlainColumn, ShardWriter, plain_table, pose_columns};
