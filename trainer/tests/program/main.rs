//! The program on small datasets: it learns, it resumes, it refuses.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod bad_input;
mod fixture;
mod hands;
mod interchange;
mod learning;
mod models;
mod page;
mod recipe;
mod resume;
#[path = "../../../tests/support/synthetic.rs"]
mod synthetic;
mod watching;
