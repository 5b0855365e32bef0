//! Reads complete files up to a limit, because a path may be `/dev/zero`.

use std::path::Path;

use crate::input::error::InputError;

/// Maximum size of a file.
const BYTES_MAX: u64 = 1 << 30;

/// The bytes of a file.
///
/// # Errors
/// [`InputError`] if the file is missing, a folder, larger than a gibibyte, or cannot be read.
pub fn read_file(path: &Path) -> Result<Vec<u8>, InputError> {
    program::read(path, BYTES_MAX).map_err(|source| InputError::Io { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use program::{Exit as _, ExitCode};

    use super::*;

    #[test]
    fn what_is_not_a_file_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let nowhere = folder.path().join("nowhere.png");
        let missing = read_file(&nowhere).unwrap_err();
        assert!(missing.to_string().starts_with(&format!("failed to read {}: ", nowhere.display())));
        assert_eq!(missing.exit_code(), ExitCode::Config);
        assert!(read_file(folder.path()).unwrap_err().to_string().contains("directory"));
        let there = folder.path().join("there");
        std::fs::write(&there, b"abc").unwrap();
        assert_eq!(read_file(&there).unwrap(), b"abc");
    }
}
