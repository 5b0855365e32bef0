//! Training samples from a dataset's shards: attempts in memory, grids in a spool file.

mod grids;
mod item;
mod load;
mod loader;

pub use item::{GraspDataset, HandRecord, Record, TrainingTransform};
pub use load::{Seen, load};
pub use loader::for_each_batch;
