//! Still pictures of what a [`crate::view`] shows, as PNG: points as a lit surface, with lines, boxes and words on it.
//!
//! Drawn in software at twice the size and averaged down. The bytes depend on the arguments alone: text is set with this
//! crate's font, and nothing runs on a graphics card.

mod canvas;
mod layer;
mod sheet;

pub use self::canvas::{Canvas, INK};
pub use self::layer::{Opacity, Rgb, lit};
pub use self::sheet::{Sheet, StillError, Symbol, Word};
pub use crate::eye::Outlook;
