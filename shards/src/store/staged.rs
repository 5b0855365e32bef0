//! A file on its way: written under its staging name or in memory, then whole, then published.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use sha2::{Digest, Sha256};
use tempfile::TempPath;

use crate::Location;
use crate::store::error::{StoreError, failed};
use crate::store::fault::Fault;
use crate::store::remote::{OBJECT_BYTES_MAX, Remote};

/// A file being written. Dropped before it is published, it leaves nothing behind.
#[derive(Debug)]
pub(crate) struct Staged {
    body: Body,
    hash: Sha256,
    bytes: u64,
    trouble: Trouble,
}

/// Where the bytes are kept until they are whole.
#[derive(Debug)]
enum Body {
    /// In the folder that the file goes to.
    File(StagingFile),
    /// In memory: a store takes an object in one piece, or not at all.
    Object { remote: Arc<Remote>, name: String, bytes: Vec<u8> },
}

/// A file under its staging name, which is gone when this is dropped.
#[derive(Debug)]
struct StagingFile {
    file: File,
    staging: TempPath,
    target: PathBuf,
    fault: Fault,
}

/// The first thing that went wrong while writing a file. Libraries between a writer and its file turn errors of the
/// disk into texts; this is where the error itself is kept.
#[derive(Debug, Clone)]
pub(crate) struct Trouble {
    at: Location,
    first: Arc<OnceLock<(io::ErrorKind, String)>>,
}

impl Trouble {
    /// The error of the disk, if there was one.
    pub(crate) fn error(&self) -> Option<StoreError> {
        let (kind, text) = self.first.get()?;
        Some(self.told(io::Error::new(*kind, text.clone())))
    }

    fn told(&self, source: io::Error) -> StoreError {
        StoreError { action: "write a file", at: self.at.clone(), source }
    }
}

impl Write for Staged {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let result = match &mut self.body {
            Body::File(staged) => staged.fault.check().and_then(|()| staged.file.write(buffer)),
            Body::Object { bytes, .. } => keep(bytes, buffer),
        };
        let written = result.inspect_err(|e| {
            let _ = self.trouble.first.set((e.kind(), e.to_string())); // the first one is kept
        })?;
        self.hash.update(&buffer[..written]);
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.body {
            Body::File(staged) => staged.file.flush(),
            Body::Object { .. } => Ok(()),
        }
    }
}

fn keep(bytes: &mut Vec<u8>, more: &[u8]) -> io::Result<usize> {
    if (bytes.len() + more.len()) as u64 > OBJECT_BYTES_MAX {
        let text = format!("an object must have at most {OBJECT_BYTES_MAX} bytes: give the dataset more shards");
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, text));
    }
    bytes.extend_from_slice(more);
    Ok(more.len())
}

impl Staged {
    /// An empty file that will be called `target`.
    pub(crate) fn file(file: File, staging: TempPath, target: PathBuf, fault: Fault) -> Self {
        let at = Location::Path(target.clone());
        Self::new(Body::File(StagingFile { file, staging, target, fault }), at)
    }

    /// An empty object that will be called `name`.
    pub(crate) fn object(remote: &Arc<Remote>, name: &str) -> Self {
        let body = Body::Object { remote: Arc::clone(remote), name: name.to_owned(), bytes: Vec::new() };
        Self::new(body, remote.location(name))
    }

    fn new(body: Body, at: Location) -> Self {
        let trouble = Trouble { at, first: Arc::default() };
        Self { body, hash: Sha256::new(), bytes: 0, trouble }
    }

    /// Writes all of a small file.
    pub(crate) fn put(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        self.write_all(bytes).map_err(|e| self.trouble.told(e))
    }

    /// Where errors of the disk are kept.
    pub(crate) fn trouble(&self) -> Trouble {
        self.trouble.clone()
    }

    #[cfg(test)]
    pub(crate) fn staging(&self) -> PathBuf {
        match &self.body {
            Body::File(staged) => staged.staging.to_path_buf(),
            Body::Object { .. } => PathBuf::new(),
        }
    }

    /// The file, whole and flushed to the disk, still without its name.
    pub(crate) fn finish(self) -> Result<Ready, StoreError> {
        if let Body::File(StagingFile { file, target, fault, .. }) = &self.body {
            fault.check().and_then(|()| file.sync_all()).map_err(failed("flush a file", target))?;
        }
        Ok(Ready { body: self.body, bytes: self.bytes, sha256: crate::format::seal::hex(&self.hash.finalize()) })
    }
}

/// A written file that waits for its name.
#[derive(Debug)]
pub(crate) struct Ready {
    body: Body,
    /// Its size.
    pub(crate) bytes: u64,
    /// Its SHA-256 in hex.
    pub(crate) sha256: String,
}

impl Ready {
    /// Gives the file its name, in place of what may be there.
    pub(crate) fn publish(self) -> Result<(), StoreError> {
        match self.body {
            Body::File(staged) => staged.publish(),
            Body::Object { remote, name, bytes } => remote.put(&name, bytes),
        }
    }

    /// Gives the file its name unless it is taken; whether it did.
    pub(crate) fn publish_new(self) -> Result<bool, StoreError> {
        match self.body {
            Body::File(staged) => staged.publish_new(),
            Body::Object { remote, name, bytes } => remote.put_new(&name, bytes),
        }
    }
}

impl StagingFile {
    fn publish(self) -> Result<(), StoreError> {
        let Self { staging, target, fault, .. } = self;
        let renamed = fault.check().and_then(|()| staging.persist(&target).map_err(|e| e.error));
        renamed.map_err(failed("publish a file", &target))?;
        sync_folder(target.parent(), &fault)
    }

    fn publish_new(self) -> Result<bool, StoreError> {
        use io::ErrorKind::{PermissionDenied, TooManyLinks, Unsupported};
        let Self { file, staging, target, fault } = self;
        let named = match fault.check() {
            Ok(()) => staging.persist_noclobber(&target).map_err(|e| (e.error, Some(e.path))),
            Err(error) => Err((error, None)),
        };
        let Err((error, staging)) = named else { return sync_folder(target.parent(), &fault).map(|()| true) };
        // A name that is taken says so, or the answer got lost (NFS), or a sweeper was here: who made the file may have been
        // killed before it was flushed.
        if target.try_exists().map_err(failed("look at a file", &target))? {
            return sync_folder(target.parent(), &fault).map(|()| false);
        }
        match (error.kind(), staging) {
            // No way to take a free name only (exFAT, some network mounts): the race that is left is told by the checks of
            // the dataset's id, and otherwise between equal files.
            (PermissionDenied | TooManyLinks | Unsupported, Some(staging)) => {
                Self { file, staging, target, fault }.publish().map(|()| true)
            }
            _ => Err(failed("publish a file", &target)(error)),
        }
    }
}

/// Flushes a folder. Some network mounts have no such thing, and say so; a folder that we may not read, such as one above
/// users' folders, is somebody else's.
pub(crate) fn sync_folder(folder: Option<&Path>, fault: &Fault) -> Result<(), StoreError> {
    use io::ErrorKind::{InvalidInput, PermissionDenied, Unsupported};
    let Some(folder) = folder.filter(|_| cfg!(unix)) else { return Ok(()) };
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    match fault.check().and_then(|()| File::open(folder)).and_then(|f| f.sync_all()) {
        Err(e) if !matches!(e.kind(), InvalidInput | PermissionDenied | Unsupported) => {
            Err(failed("flush a folder", folder)(e))
        }
        _ => Ok(()),
    }
}
