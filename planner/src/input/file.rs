//! Reads complete files up to a limit, because a path may be `/dev/zero`.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::Path;

use crate::input::error::{InputError, refuse};

/// Maximum size of a file.
const BYTES_MAX: u64 = 1 << 30;

/// The bytes of a file.
///
/// # Errors
/// [`InputError`] if the file is missing, a folder, larger than a gibibyte, or cannot be read.
pub(crate) fn read_file(path: &Path) -> Result<Vec<u8>, InputError> {
    let failed = |source: std::io::Error| match source.kind() {
        ErrorKind::NotFound => InputError::Missing(path.to_owned()),
        ErrorKind::IsADirectory => InputError::Value(format!("must be a file, got a folder: {}", path.display())),
        _ => InputError::Io { path: path.to_owned(), source },
    };
    let mut bytes = Vec::new();
    File::open(path).map_err(failed)?.take(BYTES_MAX + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > BYTES_MAX {
        return refuse(format!("a file must have at most {BYTES_MAX} bytes: {}", path.display()));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_a_file_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let nowhere = folder.path().join("nowhere.png");
        assert!(matches!(read_file(&nowhere), Err(InputError::Missing(path)) if path == nowhere));
        assert!(read_file(folder.path()).unwrap_err().to_string().contains("got a folder"));
        let there = folder.path().join("there");
        std::fs::write(&there, b"abc").unwrap();
        assert_eq!(read_file(&there).unwrap(), b"abc");
    }
}
