//! What people look at: figures, pages that need nothing else, pictures and 3-D views of scenes.
//!
//! This crate knows what a solid and a hand are (`schema`) and nothing of datasets, networks or physics; who has
//! numbers gives them to it.

mod eye;
pub mod figure;
pub mod page;
pub mod picture;
pub mod still;
pub mod view;
