//! The program on small datasets: it learns, it resumes, it refuses.

mod bad_input;
mod beyond_the_paper;
mod fixture;
mod grippers;
mod interchange;
mod learning;
mod models;
mod resume;
mod watching;
