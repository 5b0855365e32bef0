//! Atomic publishing of files: written under a temporary name, flushed, renamed, and the folder flushed.

use std::fs::{self, File};
use std::io::{self, Write};
use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt};
use std::path::Path;

/// Writes a file and replaces an existing one. After a crash either the old or the new file exists, complete. A device
/// or a pipe, such as `/dev/stdout`, is written to, not replaced.
///
/// # Errors
/// The system's error; the old file is then unchanged. [`io::ErrorKind::InvalidInput`] for a pipe that nobody reads.
pub fn publish(path: &Path, bytes: &[u8]) -> io::Result<()> {
    if fs::metadata(path).is_ok_and(|there| !there.is_file() && !there.is_dir()) {
        return device(path)?.write_all(bytes);
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // An unused name: two writers of one path do not share it, and it does not collide with a file of the user.
    let mut staging = staging().tempfile_in(folder)?;
    staging.write_all(bytes)?;
    staging.as_file().sync_all()?;
    staging.persist(path)?;
    File::open(folder)?.sync_all()
}

/// Opens a device or a pipe to write. A pipe that nobody reads would block for ever, also a program that is told to
/// stop.
fn device(path: &Path) -> io::Result<File> {
    let mut options = File::options();
    options.write(true);
    let unread = |error: io::Error| match error.raw_os_error() {
        Some(ENXIO) => io::Error::new(io::ErrorKind::InvalidInput, "it is a socket, or a pipe that nobody reads"),
        _ => error,
    };
    let _at_once = options.clone().custom_flags(O_NONBLOCK).open(path).map_err(unread)?;
    options.open(path)
}

// The system's numbers.
const ENXIO: i32 = 6;
const O_NONBLOCK: i32 = if cfg!(target_os = "linux") { 0o4000 } else { 4 };

/// Removes what killed writers of [`publish`] left in a folder in which no other process writes now.
///
/// # Errors
/// If the folder cannot be listed or a file not removed.
pub(crate) fn sweep(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_name().to_str().is_some_and(is_temporary) && entry.file_type()?.is_file() {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// Whether a file's name is one of [`publish`]'s temporary ones.
#[must_use]
pub fn is_temporary(name: &str) -> bool {
    let random = name.strip_prefix(PREFIX).and_then(|name| name.strip_suffix(SUFFIX));
    random.is_some_and(|random| random.len() == RANDOM_LENGTH && random.bytes().all(|b| b.is_ascii_alphanumeric()))
}

// What a temporary name is made of.
const PREFIX: &str = ".";
const RANDOM_LENGTH: usize = 6;
const SUFFIX: &str = ".tmp";

fn staging() -> tempfile::Builder<'static, 'static> {
    let mut staging = tempfile::Builder::new();
    staging.prefix(PREFIX).rand_bytes(RANDOM_LENGTH).suffix(SUFFIX);
    // The mode of any new file; that of temporary files lets only their owner read them.
    staging.permissions(PermissionsExt::from_mode(0o666));
    staging
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_new_file_takes_the_place_of_the_old_one_and_nothing_else_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        publish(&path, b"one").unwrap();
        publish(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_killed_writers_left_is_swept_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let (_, left) = staging().tempfile_in(folder.path()).unwrap().keep().unwrap();
        for kept in ["x.tmp", ".seven77.tmp", ".sïx66.tmp", ".abcdef"] {
            fs::write(folder.path().join(kept), b"").unwrap();
        }
        fs::create_dir(folder.path().join(".folder.tmp")).unwrap();
        assert!(left.exists());
        sweep(folder.path()).unwrap();
        assert!(!left.exists());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 5);
    }

    #[test]
    fn a_pipe_is_written_to_where_somebody_reads_it() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        assert_eq!(publish(&pipe, b"one").unwrap_err().kind(), io::ErrorKind::InvalidInput);
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read(pipe).unwrap()
        });
        while publish(&pipe, b"two").is_err() {
            std::thread::yield_now();
        }
        assert_eq!(reader.join().unwrap(), b"two");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_device_is_written_to_and_not_replaced() {
        publish(Path::new("/dev/null"), b"one").unwrap();
        let full = publish(Path::new("/dev/full"), b"one").unwrap_err();
        assert_eq!(full.kind(), io::ErrorKind::StorageFull);
        for device in ["/dev/null", "/dev/full"] {
            assert!(!fs::metadata(device).unwrap().is_file(), "{device} is a file now");
        }
    }
}
