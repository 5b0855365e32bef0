//! Opening the files of users' folders: regular files only, for a pipe would block for ever and a device never ends.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Read};
use std::path::Path;

use crate::{Exit as _, ExitCode, Failure};

/// Opens a regular file to read it, or a link to one.
///
/// # Errors
/// The system's error; [`ErrorKind::IsADirectory`]; [`ErrorKind::InvalidInput`] for another special file.
pub fn open(path: &Path) -> io::Result<File> {
    open_as(path, File::options().read(true))
}

/// Opens a regular file in any way, or a link to one; makes it where the options say so.
///
/// # Errors
/// As [`open`].
pub fn open_as(path: &Path, options: &OpenOptions) -> io::Result<File> {
    if let Ok(there) = fs::metadata(path) {
        if there.is_dir() {
            return Err(ErrorKind::IsADirectory.into());
        }
        if !there.is_file() {
            let text = "it must be a regular file, not a pipe, socket or device";
            return Err(io::Error::new(ErrorKind::InvalidInput, text));
        }
    }
    options.open(path)
}

/// The names of what lies in a folder, in any order.
///
/// # Errors
/// The system's error.
pub fn names_in(folder: &Path) -> io::Result<Vec<String>> {
    fs::read_dir(folder)?.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned())).collect()
}

/// Makes a regular file, or empties one that is there.
///
/// # Errors
/// As [`open`].
pub fn create(path: &Path) -> io::Result<File> {
    open_as(path, File::options().write(true).create(true).truncate(true))
}

/// Reads a regular file of at most `bytes_max` bytes.
///
/// # Errors
/// As [`open`]; [`ErrorKind::InvalidData`] if the file is larger.
pub fn read(path: &Path, bytes_max: u64) -> io::Result<Vec<u8>> {
    let file = open(path)?;
    let (size, mut bytes) = (file.metadata()?.len(), Vec::new());
    // The file may grow between the two.
    if size > bytes_max || file.take(bytes_max + 1).read_to_end(&mut bytes)? as u64 > bytes_max {
        return Err(io::Error::new(
            ErrorKind::InvalidData,
            format!("it must have at most {bytes_max} bytes, got {}", size.max(bytes.len() as u64)),
        ));
    }
    Ok(bytes)
}

/// The failure to read a file: [`ErrorKind::InvalidData`] is a damaged file.
#[must_use]
pub fn unread(path: &Path, error: &io::Error) -> Failure {
    match error.kind() {
        ErrorKind::InvalidData => Failure::new(ExitCode::Data, format!("damaged {}: {error}", path.display())),
        _ => Failure::new(error.exit_code(), format!("failed to read: {error}: {}", path.display())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_read_up_to_its_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        fs::write(&path, b"12345").unwrap();
        assert_eq!(read(&path, 5).unwrap(), b"12345");
        let error = read(&path, 4).unwrap_err();
        assert_eq!(error.to_string(), "it must have at most 4 bytes, got 5");
        // A file of a terabyte takes no memory.
        File::options().write(true).open(&path).unwrap().set_len(1 << 40).unwrap();
        assert_eq!(read(&path, 4).unwrap_err().kind(), ErrorKind::InvalidData);
    }

    #[test]
    fn special_files_are_refused_without_waiting_for_them() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let endless = folder.path().join("endless");
        std::os::unix::fs::symlink("/dev/zero", &endless).unwrap();
        for path in [&pipe, &endless] {
            assert_eq!(read(path, 1 << 20).unwrap_err().kind(), ErrorKind::InvalidInput, "{}", path.display());
        }
        assert_eq!(read(folder.path(), 1).unwrap_err().kind(), ErrorKind::IsADirectory);
        assert_eq!(read(&folder.path().join("absent"), 1).unwrap_err().kind(), ErrorKind::NotFound);
    }
}
