//! Still pictures of a [`crate::view`] as PNG: points as a lit surface, or a camera's image, with lines, boxes and
//! labels.
//!
//! Drawn in software at twice the size and averaged down. The bytes depend only on the arguments: text uses this
//! crate's font, and no GPU is involved.

mod canvas;
mod layer;
mod sheet;

pub use self::canvas::{Canvas, INK};
pub use self::layer::{Opacity, Rgb, lit, mixed};
pub use self::sheet::{Sheet, Symbol, Word, png};
pub use crate::eye::Outlook;
