//! Tests of the planner's public interface and program.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod detections;
mod doubts;
mod judged;
mod plans;
