//! A folder with one writer at a time.

use std::fs::{self, File, TryLockError};
use std::path::Path;

use crate::publish::sweep;
use crate::{Context as _, ExitCode, Failure, open_as};

/// Keeps other writers out of a folder while it exists.
#[derive(Debug)]
pub struct FolderLock(File);

/// Closing the file is not enough: a child process that another thread is starting may hold it open a moment longer.
impl Drop for FolderLock {
    fn drop(&mut self) {
        let _ = self.0.unlock();
    }
}

impl FolderLock {
    /// The lock's name in the folder.
    pub const NAME: &str = ".lock";

    /// Makes the folder if it is missing, locks it, and removes what killed writers left in it.
    ///
    /// # Errors
    /// [`ExitCode::TryAgain`] if another process has the lock; otherwise if the folder cannot be made, locked or swept.
    pub fn take(folder: &Path) -> Result<Self, Failure> {
        let failed = |what: &str| format!("failed to {what} the folder {}", folder.display());
        fs::create_dir_all(folder).context(failed("make"))?;
        let lock =
            open_as(&folder.join(Self::NAME), File::options().create(true).append(true)).context(failed("lock"))?;
        match lock.try_lock() {
            Err(TryLockError::WouldBlock) => {
                let text = format!("another process writes in this folder: {}", folder.display());
                return Err(Failure::new(ExitCode::TryAgain, text));
            }
            Ok(()) => sweep(folder).context(failed("sweep"))?,
            Err(TryLockError::Error(_)) => {} // without support for locks, trust the user
        }
        Ok(Self(lock))
    }
}
