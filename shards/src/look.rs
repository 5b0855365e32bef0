//! Looking at a dataset: checking all of it, statistics, single scenes, and copies in formats of others.

mod browse;
mod export;
pub mod report;
mod verify;
mod view;

pub use browse::{begin_browsing, browse};
pub use export::{ExportCounts, ExportFormat, ExportOrigin, Exported, ExportedFile, export, tsdf};
pub use verify::{PROBLEMS_MAX, Verified, verify};
pub use view::{object_bodies, scene_view};
