//! The planner from outside.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod binary;
mod detections;
mod plans;
