//! How the records of a dataset lie on disk: three Parquet tables, their manifest, and the way a shard appears whole
//! or not at all. The only crate that knows Parquet, and the only one that talks to object stores.
//!
//! # A dataset's folder
//!
//! ```text
//! README.md                                  dataset card, made by finalize
//! meta/info.json                             what the dataset is: written first; its SHA-256 is the dataset's id
//! meta/shards/00003.json                     marker: written last; the shard counts iff it is there
//! meta/manifest.json                         every marker and their sum: there iff the dataset is complete
//! _SUCCESS                                   empty: made after the manifest
//! attempts/shard-00003-of-00064.parquet      one row an attempt
//! scenes/shard-00003-of-00064.parquet        one row a scene, with its TSDF
//! objects/shard-00003-of-00064.parquet       one row an object
//! ```
//!
//! # Writing and reading
//!
//! ```
//! # let dir = tempfile::tempdir().unwrap();
//! # let dir = dir.path();
//! let mut info = shards::synthetic::info(7, 2, 60, 10);
//! info.grid.resolution = 8;
//! let draft = shards::Draft::begin(dir, &info)?;
//! for shard in 0..info.shard_count {
//!     if draft.is_committed(shard)? {
//!         continue; // written by an earlier run
//!     }
//!     let mut writer = draft.shard(shard)?;
//!     for scene in info.scenes_of(shard) {
//!         writer.push(&shards::synthetic::scene_rows(scene, info.seed, &info))?;
//!     }
//!     writer.commit()?;
//! }
//! assert!(matches!(draft.finalize()?, shards::Finalized::Complete(_)));
//!
//! let dataset = shards::Dataset::open(dir)?;
//! let attempts = dataset.read_attempts(0)?;
//! assert_eq!(attempts.len(), 30);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A shard's bytes are a pure function of its rows: no clock, no host name, no library version. Every error has an
//! [`ExitCode`].

mod argument;
mod begin;
mod card;
mod check;
mod column;
mod dataset;
mod decode;
mod draft;
mod encode;
mod exit;
mod export;
mod fault;
mod finalize;
mod footer;
mod frame;
#[cfg(any(test, fuzzing))]
pub mod fuzzing;
#[cfg(test)]
mod hostile;
mod info;
mod inspect;
pub mod layout;
mod location;
pub mod manual;
mod plain_table;
mod pretend;
mod process;
mod publish;
mod read_error;
mod remote;
pub mod report;
mod scenes;
mod seal;
mod staged;
mod storage;
mod store;
mod summary;
pub mod synthetic;
mod table_reader;
mod table_writer;
pub mod text;
mod thrift;
mod verify;
mod version;
mod view;
mod writer;

pub use argument::LocationParser;
pub use begin::BeginError;
pub use check::{POSITION_M_MAX, QUATERNION_TOLERANCE, RowError, VIEWS_MAX, WIDTH_TOLERANCE_M};
pub use column::{Column, Kind, Table};
pub use dataset::Dataset;
pub use draft::Draft;
pub use exit::ExitCode;
pub use export::{ExportCounts, ExportError, ExportFormat, ExportOrigin, Exported, ExportedFile, export};
pub use finalize::{FinalizeError, Finalized};
pub use info::{ATTEMPTS_MAX, DatasetInfo, InfoError, RESOLUTION_MAX, SHARDS_MAX};
pub use inspect::Inspection;
pub use location::{Location, LocationError};
pub use plain_table::{PlainColumn, PlainTableError, plain_table};
pub use pretend::pretend_shard;
pub use process::{stop_on_signals, writes_fail_at_the_file_size_limit};
pub use publish::publish;
pub use read_error::ReadError;
pub use report::{Bin, Group, OutcomeGroup, Report, TableSize, report};
pub use scenes::Scenes;
pub use seal::SealError;
pub use store::{StoreError, Sweep, Swept};
pub use summary::{Counts, FileSummary, Manifest, RejectionCounts, ShardSummary, Tally};
pub use table_writer::TableError;
pub use verify::{PROBLEMS_MAX, Verified, verify};
pub use version::{FormatVersion, UnreadableVersion};
pub use view::{object_bodies, scene_view, write_view};
pub use writer::{SCENES_PER_ROW_GROUP, ShardWriter, WriteError};
