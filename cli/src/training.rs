//! Commands that train networks and evaluate them.

mod console;
pub(crate) mod evaluate;
pub(crate) mod fit;
mod report;
