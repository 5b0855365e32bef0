//! Still pictures of a [`crate::view`] as PNG: points as a lit surface, with lines, boxes and labels.
//!
//! Drawn in software at twice the size and averaged down. The bytes depend only on the arguments: text uses this
//! crate's font, and no GPU is involved.

mod canvas;
mod layer;
mod sheet;

pub use self::canvas::{Canvas, INK};
pub use self::layer::{Opacity, Rgb, lit};
pub use self::sheet::{Sheet, Symbol, Word};
pub use crate::eye::Outlook;
