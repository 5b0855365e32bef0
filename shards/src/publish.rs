//! Files that appear whole or not at all: written under a temporary name, flushed, renamed, the folder flushed.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

/// Writes a file in place of what may be there. After a crash the old or the new file is there, whole.
///
/// # Errors
/// What the system says; the old file is then untouched.
pub fn publish(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // A name that nobody has: two writers of one path do not share it, and no file of the user's is in its way.
    let mut staging = staging().tempfile_in(folder)?;
    staging.write_all(bytes)?;
    staging.as_file().sync_all()?;
    staging.persist(path)?;
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}

fn staging() -> tempfile::Builder<'static, 'static> {
    let mut staging = tempfile::Builder::new();
    staging.prefix(".").suffix(".tmp");
    #[cfg(unix)] // as any file is made; what is temporary is its owner's alone by default
    staging.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    staging
}

#[cfg(test)]
mod tests {
    use std::fs;

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
}
