//! Settings: a key is one row (name, type, range, meaning), and everything else comes from the rows.
//!
//! [`settings!`] makes a struct from rows, with its reader and checks; [`words!`] makes an enum whose variants have
//! names in files. A [`Document`] is a TOML file or a built-in text with overrides. Reading it reports all faults at
//! once in one [`Error`].
//!
//! A crate's settings are therefore the types that the crate computes with. Settings stored as JSON with a dataset are
//! read by the same rows ([`read_stored`]), so stored and configured values have the same ranges.

mod document;
mod error;
mod limits;
mod macros;
mod reader;
mod setting;

pub use document::{Document, faults_of, read_stored, read_text};
pub use error::Error;
pub use limits::{Limits, above};
pub use reader::{Reader, hint};
pub use serde;
pub use setting::{Row, Setting, rows_of};
pub use toml::Value;
