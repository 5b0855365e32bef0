//! What people look at: documents as pages, Markdown and text; 3-D views of scenes, and grasps in
//! images.
//!
//! This crate knows what a solid and a gripper are (`schema`) and nothing of datasets, networks or physics; who
//! has numbers gives them to it.

mod assets;
pub mod document;
pub mod overlay;
pub mod view;
