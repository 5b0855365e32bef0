//! The planner from outside.

mod detections;
