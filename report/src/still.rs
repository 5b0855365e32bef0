//! Grasps drawn into a camera's image, as PNG: with it one sees at once whether a frame is right.
//!
//! Drawn in software at twice the size and averaged down. The bytes depend only on the arguments.

mod canvas;
mod hand;
mod layer;
mod overlay;
mod relief;

pub use self::overlay::{Hand, Image, overlay};
