//! Commands that train networks and examine them.

mod console;
pub(crate) mod evaluate;
pub(crate) mod fit;
pub(crate) mod report;
