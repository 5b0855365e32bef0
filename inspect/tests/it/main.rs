//! Tests of the crate from outside: exports and the statistics of stored datasets.
#![expect(clippy::unwrap_used, reason = "what a test cannot unwrap has failed it")]

mod export;
#[path = "../../../tests/support/sample.rs"]
mod sample;
mod scenes;
#[path = "../../../tests/support/synthetic.rs"]
mod synthetic;
