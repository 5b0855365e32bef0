//! Reading the files of an experiment's folder.

use std::io::{self, ErrorKind};
use std::path::Path;

use program::{Failure, unread};
use serde::de::DeserializeOwned;

/// Largest file that is read, in bytes: far more than the rounds that fit into memory.
pub(crate) const BYTES_MAX: u64 = 1 << 40;

/// What a JSON file holds; `None` if there is no such file.
pub(crate) fn json<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, Failure> {
    if !path.exists() {
        return Ok(None);
    }
    let invalid = |error| io::Error::new(ErrorKind::InvalidData, error);
    let read = program::read(path, BYTES_MAX).and_then(|text| serde_json::from_slice(&text).map_err(invalid));
    read.map(Some).map_err(|source| unread(path, &source))
}
