//! The paper's and the community's experiments in simulation: a table of objects is scanned, planned and cleared, and
//! every result carries its protocol's name and an interval.
//!
//! [`config`] parses an experiment's file, [`start`] sets up the scene (with objects of a [`catalogue`], dropped or
//! packed), [`offer`] says what a planner is asked, [`round`] runs one round, [`run`] runs all of them into a
//! journal, [`statistics`] computes the rates, [`report`] writes them and [`tables`],
//! and [`failures`] are for replays.

pub mod config;
pub mod failures;
mod files;
mod journal;
pub mod offer;
pub mod record;
pub mod report;
pub mod round;
pub mod run;
pub mod start;
pub mod statistics;
pub mod tables;

pub use generator::catalogue;
