//! Tests of the crate from outside: written data are read, damage is found, and killed writers can be continued.
#![expect(clippy::unwrap_used, reason = "what a test cannot unwrap has failed it")]

mod commit;
mod containers;
mod damage;
#[path = "../../../tests/support/disk.rs"]
mod disk;
mod disk_full;
mod golden;
mod grippers;
mod killed;
mod models;
mod round_trip;
#[path = "../../../tests/support/sample.rs"]
mod sample;
#[path = "../../../tests/support/synthetic.rs"]
mod synthetic;
