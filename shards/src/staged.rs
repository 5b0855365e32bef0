//! A file on its way to the disk: written under its staging name, then whole, then published.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use sha2::{Digest, Sha256};

use crate::store::{Fault, StoreError, failed, sync_folder};

/// A file being written. Dropped before it is published, it leaves nothing behind.
#[derive(Debug)]
pub(crate) struct Staged {
    file: File,
    pub(crate) staging: PathBuf,
    target: PathBuf,
    hash: Sha256,
    bytes: u64,
    fault: Fault,
    trouble: Trouble,
    published: bool,
}

/// The first thing that went wrong while writing a file. Libraries between a writer and its file turn errors of the
/// disk into texts; this is where the error itself is kept.
#[derive(Debug, Clone, Default)]
pub(crate) struct Trouble(Arc<OnceLock<(PathBuf, io::ErrorKind, String)>>);

impl Trouble {
    /// The error of the disk, if there was one.
    pub(crate) fn error(&self) -> Option<StoreError> {
        let (path, kind, text) = self.0.get()?;
        Some(failed("write a file", path)(io::Error::new(*kind, text.clone())))
    }
}

impl Write for Staged {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let written = self.fault.check().and_then(|()| self.file.write(buffer)).inspect_err(|e| {
            let _ = self.trouble.0.set((self.target.clone(), e.kind(), e.to_string())); // the first one is kept
        })?;
        self.hash.update(&buffer[..written]);
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Staged {
    /// An empty file that will be called `target`.
    pub(crate) fn new(file: File, staging: PathBuf, target: PathBuf, fault: Fault) -> Self {
        Self {
            file,
            staging,
            target,
            hash: Sha256::new(),
            bytes: 0,
            fault,
            trouble: Trouble::default(),
            published: false,
        }
    }

    /// Where it will be.
    pub(crate) fn target(&self) -> PathBuf {
        self.target.clone()
    }

    /// Where errors of the disk are kept.
    pub(crate) fn trouble(&self) -> Trouble {
        self.trouble.clone()
    }

    /// The file, whole and flushed to the disk, still under its staging name.
    pub(crate) fn finish(self) -> Result<Ready, StoreError> {
        self.fault.check().and_then(|()| self.file.sync_all()).map_err(failed("flush a file", &self.target))?;
        Ok(Ready { sha256: crate::seal::hex(&self.hash.clone().finalize()), staged: self })
    }
}

impl Drop for Staged {
    fn drop(&mut self) {
        if !self.published {
            let _ = fs::remove_file(&self.staging); // a leftover counts for nothing; the next writer removes it
        }
    }
}

/// A written file that waits for its name.
#[derive(Debug)]
pub(crate) struct Ready {
    staged: Staged,
    /// Its SHA-256 in hex.
    pub(crate) sha256: String,
}

impl Ready {
    /// Its size.
    pub(crate) fn bytes(&self) -> u64 {
        self.staged.bytes
    }

    /// Gives the file its name, in place of what may be there.
    pub(crate) fn publish(mut self) -> Result<(), StoreError> {
        let target = self.staged.target.clone();
        let rename = self.staged.fault.check().and_then(|()| fs::rename(&self.staged.staging, &target));
        rename.map_err(failed("publish a file", &target))?;
        self.staged.published = true;
        sync_folder(target.parent())
    }

    /// Gives the file its name unless it is taken; whether it did.
    pub(crate) fn publish_new(self) -> Result<bool, StoreError> {
        let target = self.staged.target.clone();
        match self.staged.fault.check().and_then(|()| fs::hard_link(&self.staged.staging, &target)) {
            Ok(()) => sync_folder(target.parent()).map(|()| true),
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => Ok(false),
            Err(e) if e.kind() == io::ErrorKind::StorageFull => Err(failed("publish a file", &target)(e)),
            // No hard links here (exFAT, many network mounts): the race that is left is between equal files.
            Err(_) if target.exists() => Ok(false),
            Err(_) => self.publish().map(|()| true),
        }
    }
}
