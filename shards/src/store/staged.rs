//! A file being published: first written under its staging name or in memory, then complete, then published.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use program::Failure;
use sha2::{Digest, Sha256};
use tempfile::TempPath;

use crate::Location;
use crate::store::error::failed;
use crate::store::fault::Fault;
use crate::store::remote::{OBJECT_BYTES_MAX, Remote};

/// A file being written. If dropped before it is published, it leaves nothing behind.
#[derive(Debug)]
pub(crate) struct Staged {
    body: Body,
    hash: Sha256,
    bytes: u64,
    at: Location,
    trouble: Trouble,
}

/// Where the bytes are kept until they are complete.
#[derive(Debug)]
enum Body {
    /// In the target folder.
    File(StagingFile),
    /// In memory, because an object is uploaded in one piece.
    Object { remote: Arc<Remote>, name: String, bytes: Vec<u8> },
}

/// A file under its staging name, removed on drop.
#[derive(Debug)]
struct StagingFile {
    file: File,
    staging: TempPath,
    target: PathBuf,
    fault: Fault,
}

/// The first error while writing a file. Libraries between a writer and its file convert disk errors to text; this
/// keeps the error itself.
pub(crate) type Trouble = Arc<OnceLock<Failure>>;

impl Write for Staged {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let result = match &mut self.body {
            Body::File(staged) => staged.fault.check().and_then(|()| staged.file.write(buffer)),
            Body::Object { bytes, .. } => keep(bytes, buffer),
        };
        let written = result.inspect_err(|e| {
            let error = io::Error::new(e.kind(), e.to_string());
            let _ = self.trouble.set(failed("write a file", &self.at)(error)); // keeps the first error
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
    /// An empty file for `target`.
    pub(crate) fn file(file: File, staging: TempPath, target: PathBuf, fault: Fault) -> Self {
        let at = Location::Path(target.clone());
        Self::new(Body::File(StagingFile { file, staging, target, fault }), at)
    }

    /// An empty object for `name`.
    pub(crate) fn object(remote: &Arc<Remote>, name: &str) -> Self {
        let body = Body::Object { remote: Arc::clone(remote), name: name.to_owned(), bytes: Vec::new() };
        Self::new(body, remote.location(name))
    }

    fn new(body: Body, at: Location) -> Self {
        Self { body, hash: Sha256::new(), bytes: 0, at, trouble: Arc::default() }
    }

    /// Writes all of a small file.
    pub(crate) fn put(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        self.write_all(bytes).map_err(failed("write a file", &self.at))
    }

    /// Where the disk's first error will be.
    pub(crate) fn trouble(&self) -> Trouble {
        Arc::clone(&self.trouble)
    }

    #[cfg(test)]
    pub(crate) fn staging(&self) -> PathBuf {
        match &self.body {
            Body::File(staged) => staged.staging.to_path_buf(),
            Body::Object { .. } => PathBuf::new(),
        }
    }

    /// The file, complete and flushed to the disk, but not renamed yet.
    pub(crate) fn finish(self) -> Result<Ready, Failure> {
        if let Body::File(StagingFile { file, target, fault, .. }) = &self.body {
            fault.check().and_then(|()| file.sync_all()).map_err(failed("flush a file", target))?;
        }
        Ok(Ready { body: self.body, bytes: self.bytes, sha256: crate::format::seal::hex(&self.hash.finalize()) })
    }
}

/// A complete file that is not published yet.
#[derive(Debug)]
pub(crate) struct Ready {
    body: Body,
    /// Its size.
    pub(crate) bytes: u64,
    /// Its SHA-256 in hex.
    pub(crate) sha256: String,
}

impl Ready {
    /// Publishes the file and replaces an existing one.
    pub(crate) fn publish(self) -> Result<(), Failure> {
        match self.body {
            Body::File(staged) => staged.publish(),
            Body::Object { remote, name, bytes } => remote.put(&name, bytes),
        }
    }

    /// Publishes the file unless the name is taken; returns whether it did.
    pub(crate) fn publish_new(self) -> Result<bool, Failure> {
        match self.body {
            Body::File(staged) => staged.publish_new(),
            Body::Object { remote, name, bytes } => remote.put_new(&name, bytes),
        }
    }
}

impl StagingFile {
    fn publish(self) -> Result<(), Failure> {
        let Self { staging, target, fault, .. } = self;
        let renamed = fault.check().and_then(|()| staging.persist(&target).map_err(|e| unless_swept(e.error, &target)));
        renamed.map_err(failed("publish a file", &target))?;
        sync_folder(target.parent(), &fault)
    }

    fn publish_new(self) -> Result<bool, Failure> {
        use io::ErrorKind::{PermissionDenied, TooManyLinks, Unsupported};
        let Self { file, staging, target, fault } = self;
        let named = match fault.check() {
            Ok(()) => staging.persist_noclobber(&target).map_err(|e| (e.error, Some(e.path))),
            Err(error) => Err((error, None)),
        };
        let Err((error, staging)) = named else { return sync_folder(target.parent(), &fault).map(|()| true) };
        // The name is taken, the answer was lost (NFS), or a sweeper removed the file. The writer of an existing file
        // may have been killed before it flushed the folder.
        if target.try_exists().map_err(failed("look at a file", &target))? {
            return sync_folder(target.parent(), &fault).map(|()| false);
        }
        match (error.kind(), staging) {
            // Renaming only to a free name is not supported (exFAT, some network mounts). The checks of the dataset's
            // id detect the remaining race; otherwise it is between equal files.
            (PermissionDenied | TooManyLinks | Unsupported, Some(staging)) => {
                Self { file, staging, target, fault }.publish().map(|()| true)
            }
            _ => Err(failed("publish a file", &target)(unless_swept(error, &target))),
        }
    }
}

/// The error of a rename. If the folder is there, it was a sweeper who removed the file, and running again makes it
/// anew.
fn unless_swept(error: io::Error, target: &Path) -> io::Error {
    let is_swept = error.kind() == io::ErrorKind::NotFound && target.parent().is_some_and(Path::is_dir);
    if is_swept { io::Error::other("its staging file is gone: does another program delete files?") } else { error }
}

/// Flushes a folder. Ignores network mounts that do not support it, and folders without read permission, such as
/// parents of users' folders.
pub(crate) fn sync_folder(folder: Option<&Path>, fault: &Fault) -> Result<(), Failure> {
    use io::ErrorKind::{InvalidInput, PermissionDenied, Unsupported};
    let Some(folder) = folder else { return Ok(()) };
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    match fault.check().and_then(|()| File::open(folder)).and_then(|f| f.sync_all()) {
        Err(e) if !matches!(e.kind(), InvalidInput | PermissionDenied | Unsupported) => {
            Err(failed("flush a folder", folder)(e))
        }
        _ => Ok(()),
    }
}
