//! Reads complete files up to a limit, because a path may be `/dev/zero`.

use std::io::ErrorKind;
use std::path::Path;

use crate::input::error::InputError;

/// Maximum size of a file.
const BYTES_MAX: u64 = 1 << 30;

/// The bytes of a file.
///
/// # Errors
/// [`InputError`] if the file is missing, a folder, larger than a gibibyte, or cannot be read.
pub fn read_file(path: &Path) -> Result<Vec<u8>, InputError> {
    let failed = |source: std::io::Error| match source.kind() {
        ErrorKind::NotFound => InputError::Value(format!("no such file: {}", path.display())),
        ErrorKind::IsADirectory => InputError::Value(format!("must be a file, got a folder: {}", path.display())),
        ErrorKind::InvalidInput | ErrorKind::InvalidData => InputError::Value(format!("{source}: {}", path.display())),
        _ => InputError::Io { path: path.to_owned(), source },
    };
    program::read(path, BYTES_MAX).map_err(failed)
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
        assert_eq!(missing.to_string(), format!("no such file: {}", nowhere.display()));
        assert_eq!(missing.exit_code(), ExitCode::Config);
        assert!(read_file(folder.path()).unwrap_err().to_string().contains("got a folder"));
        let there = folder.path().join("there");
        std::fs::write(&there, b"abc").unwrap();
        assert_eq!(read_file(&there).unwrap(), b"abc");
    }
}
