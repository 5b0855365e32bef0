//! Training samples from a dataset's shards. In memory are two bits for each attempt, and the scenes that are in use.

mod item;
mod load;
mod loader;
pub(crate) mod marks;

pub use item::{HandRecord, Record, Scene, TrainingTransform, batch};
pub use load::{GraspDataset, Seen};
pub use loader::for_each_batch;
pub use marks::{Marks, Set};
