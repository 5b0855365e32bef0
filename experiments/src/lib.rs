//! The paper's and the community's experiments, in simulation: a table of objects is scanned, planned on and cleared, and every
//! number that comes of it carries its protocol's name and an interval.
//!
//! [`config`] is an experiment's file, [`start`] lays the table (with objects of a [`catalogue`], or [`packed`] ones), [`round`] plays one
//! round, [`run`] all of them, [`tables`] writes the rows down, [`statistics`] counts, [`report`] tells and [`page`]
//! shows.

pub mod config;
pub mod packed;
pub mod page;
pub mod record;
pub mod report;
pub mod round;
pub mod run;
pub mod start;
pub mod statistics;
pub mod tables;

pub use generator::catalogue;
