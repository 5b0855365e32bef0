//! The program on small datasets: it learns, it resumes, it refuses.
#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by panicking, and tells what it measured")]

mod bad_input;
mod fixture;
mod learning;
mod resume;
