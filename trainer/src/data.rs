//! Training samples from a dataset's shards: attempts in memory, grids in a spool file.

mod grids;
mod item;
mod load;
mod loader;

pub use grids::{Grids, SpoolError};
pub use item::{GraspDataset, GraspItem, TrainingTransform};
pub use load::{LoadError, load};
pub use loader::{for_each_batch, for_each_training_batch};
