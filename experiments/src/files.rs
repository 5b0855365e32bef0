//! Reading the files of an experiment's folder, and their digests.

use std::io::ErrorKind;
use std::path::Path;

use program::{Failure, unread};
use sha2::{Digest as _, Sha256};

/// Largest file that is read, in bytes: far more than the rounds that fit into memory.
const BYTES_MAX: u64 = 1 << 40;

/// The bytes of a file; `None` if there is none.
pub(crate) fn bytes(path: &Path) -> Result<Option<Vec<u8>>, Failure> {
    match program::read(path, BYTES_MAX) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        read => read.map(Some).map_err(|error| unread(path, &error)),
    }
}

/// SHA-256 of a text or of bytes, in hex.
pub(crate) fn sha256(bytes: impl AsRef<[u8]>) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
