//! Training samples from a dataset's shards. In memory are two bits for each attempt, and the scenes that are in use.

mod batches;
mod load;
mod loader;
pub(crate) mod split_bits;

pub use batches::batch;
pub use load::{GraspDataset, Shard};
pub use loader::for_each_batch;
pub use split_bits::{Set, SplitBits};
