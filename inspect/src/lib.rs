//! Looking at a dataset: its statistics and a report of them, pages of its scenes, and replays of its attempts. Only
//! reads what `shards` holds; nothing that writes or trains needs it.
//!
//! ```
//! let dataset = shards::Dataset::open(std::path::Path::new("../shards/tests/data/format-1"))?;
//! let report = inspect::report(&dataset)?;
//! assert_eq!(report.labels.attempts, dataset.info().attempt_count);
//! assert!(report.document(dataset.info()).text().contains("How attempts ended"));
//! # Ok::<(), program::Failure>(())
//! ```

mod browse;
mod grasps;
mod page;
mod replay;
mod spread;
mod statistics;
#[cfg(test)]
#[path = "../../tests/support/synthetic.rs"]
mod synthetic;
mod view;

pub use browse::browse;
pub use grasps::{browse_grasps, given_grasps, grasp_columns, grasp_sets, grasps_info, grasps_table, read_grasp_set};
pub use replay::{Replays, failure_page, replayed};
pub use spread::spread;
pub use statistics::{Bin, Group, OutcomeGroup, Report, TableSize, report};
pub use view::scene_view;
