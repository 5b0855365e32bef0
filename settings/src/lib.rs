//! Settings: a key is one row (name, type, range, meaning), and everything else comes from the rows.
//!
//! [`settings!`] makes a struct from rows and how it is read and checked; [`words!`] makes an enum whose variants have
//! a name in files. A [`Document`] is a TOML file or a built-in text with overrides; reading it reports all faults at
//! once in one [`Error`].
//!
//! A crate's settings are thus the very types that the crate computes with. Settings that were stored as JSON with a
//! dataset are read by the same rows ([`read_stored`]), so a stored value is held to the range of a configured one.

mod document;
mod error;
mod limits;
mod macros;
mod reader;
mod setting;

pub use document::{Document, faults_of, read_stored, stored_faults};
pub use error::Error;
pub use limits::{Limits, above};
pub use reader::Reader;
pub use serde;
pub use setting::{Row, Setting, rows_of};
pub use toml::Value;
