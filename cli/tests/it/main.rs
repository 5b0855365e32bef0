//! The program as a user runs it, often by the names of its parts. What the crates do without a command line is tested
//! beside them.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod dataset;
#[path = "../../../tests/support/disk.rs"]
mod disk;
mod experiment;
mod generate;
mod plan;
mod programs;
#[path = "../../../tests/support/sample.rs"]
mod sample;
#[path = "../../../tests/support/synthetic.rs"]
mod synthetic;
mod train;
