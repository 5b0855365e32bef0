//! Storage of a dataset's files: a folder or an object store with the same interface.

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use program::{ExitCode, Failure};

use crate::Location;
use crate::format::layout;
use crate::format::seal::{sha256_hex, sha256_of_file};
use crate::format::summary::FileSummary;
use crate::store::Listing;
use crate::store::error::failed;
use crate::store::folder::Store;
use crate::store::remote::{Patience, Remote};
use crate::store::staged::{Ready, Staged};

/// The storage of a dataset.
#[derive(Debug, Clone)]
pub(crate) enum Storage {
    /// A folder: files are opened in place.
    Folder(Store),
    /// An object store: files are fetched, and uploaded in one piece.
    Remote(Arc<Remote>),
}

impl Storage {
    /// The storage at a location, for a reader or a writer.
    pub(crate) fn open(at: &Location, patience: Patience) -> Result<Self, Failure> {
        match at {
            Location::Path(path) => Ok(Self::Folder(Store::new(path))),
            Location::Url(url) => Remote::open(url, patience).map(|remote| Self::Remote(Arc::new(remote))),
        }
    }

    /// The location of a file, or of the dataset if the name is empty.
    pub(crate) fn location(&self, name: &str) -> Location {
        match self {
            Self::Folder(store) if name.is_empty() => store.root().into(),
            Self::Folder(store) => Location::Path(store.path(name)),
            Self::Remote(remote) => remote.location(name),
        }
    }

    /// The bytes of a small file, `None` if there is none.
    pub(crate) fn read(&self, name: &str) -> Result<Option<Vec<u8>>, Failure> {
        match self {
            Self::Folder(store) => store.read(name),
            Self::Remote(remote) => remote.read(name),
        }
    }

    /// Reads small files and passes each on, in order; concurrently in an object store.
    pub(crate) fn read_each(
        &self,
        mut names: impl Iterator<Item = String>,
        mut take: impl FnMut(Option<Vec<u8>>),
    ) -> Result<(), Failure> {
        match self {
            Self::Folder(store) => names.try_for_each(|name| store.read(&name).map(&mut take)),
            Self::Remote(remote) => remote.read_each(names, take),
        }
    }

    /// The size of a file in bytes, `None` if there is none.
    pub(crate) fn size(&self, name: &str) -> Result<Option<u64>, Failure> {
        match self {
            Self::Folder(store) => store.size(name),
            Self::Remote(remote) => remote.size(name),
        }
    }

    /// The listing of a folder; `None` if listing is not supported.
    pub(crate) fn list(&self, folder: &str) -> Result<Option<Listing>, Failure> {
        match self {
            Self::Folder(store) => store.list(folder).map(Some),
            Self::Remote(remote) => remote.list(folder),
        }
    }

    /// A shard's file, after a check of its size and checksum. On a disk the checksum is checked once, as recorded in
    /// `is_checked`; a fetched file is checked each time. The inner error is what is wrong with the file.
    pub(crate) fn open_file(
        &self,
        expected: &FileSummary,
        is_checked: &AtomicBool,
    ) -> Result<Result<File, String>, Failure> {
        let (file, sha256) = match self {
            Self::Folder(store) => {
                if let Some(problem) = size_problem(expected, store.size(&expected.path)?) {
                    return Ok(Err(problem));
                }
                let mut file = store.open(&expected.path)?;
                if is_checked.load(Ordering::Acquire) {
                    return Ok(Ok(file));
                }
                let sha256 = sha256_of_file(&mut file).map_err(failed("read a file", self.location(&expected.path)))?;
                (file, sha256)
            }
            Self::Remote(remote) => match remote.fetch(&expected.path, expected.bytes)? {
                Ok(fetched) => fetched,
                Err(found) => return Ok(Err(size_problem(expected, found).unwrap_or_default())),
            },
        };
        if sha256 != expected.sha256 {
            return Ok(Err(format!("sha256 must be {}, got {sha256}", expected.sha256)));
        }
        is_checked.store(true, Ordering::Release);
        Ok(Ok(file))
    }

    /// The SHA-256 of a file in hex, `None` if there is none.
    pub(crate) fn digest(&self, name: &str) -> Result<Option<String>, Failure> {
        let Some(bytes) = self.size(name)? else { return Ok(None) };
        match self {
            Self::Folder(store) => {
                sha256_of_file(&mut store.open(name)?).map(Some).map_err(failed("read a file", self.location(name)))
            }
            Self::Remote(remote) => Ok(remote.fetch(name, bytes)?.ok().map(|(_, sha256)| sha256)),
        }
    }

    /// Creates a staging file for `name`.
    pub(crate) fn stage(&self, name: &str) -> Result<Staged, Failure> {
        match self {
            Self::Folder(store) => store.stage(name),
            Self::Remote(remote) => Ok(Staged::object(remote, name)),
        }
    }

    /// Publishes a small file and replaces an existing one.
    pub(crate) fn publish(&self, name: &str, bytes: &[u8]) -> Result<(), Failure> {
        self.stage_bytes(name, bytes)?.publish()
    }

    /// Publishes a small file unless it exists; returns the bytes of one that does.
    pub(crate) fn publish_new(&self, name: &str, bytes: &[u8]) -> Result<Option<Vec<u8>>, Failure> {
        if let Some(existing) = self.read(name)? {
            // Its writer may have been killed before it flushed the folder.
            if let (Self::Folder(store), Some(folder)) = (self, Path::new(name).parent()) {
                store.flush(&store.root().join(folder))?;
            }
            return Ok(Some(existing));
        }
        if self.stage_bytes(name, bytes)?.publish_new()? {
            return Ok(None);
        }
        self.read(name)?.map(Some).ok_or_else(|| self.vanished(name))
    }

    /// The error for a file that existed when publishing and was gone when reading.
    pub(crate) fn vanished(&self, name: &str) -> Failure {
        let source = io::Error::other("it existed and is gone: does another program delete files?");
        failed("publish a file", self.location(name))(source)
    }

    fn stage_bytes(&self, name: &str, bytes: &[u8]) -> Result<Ready, Failure> {
        let mut staged = self.stage(name)?;
        staged.put(bytes)?;
        staged.finish()
    }

    /// Creates a folder, if the storage has folders.
    pub(crate) fn create_folder(&self, name: &str) -> Result<(), Failure> {
        match self {
            Self::Folder(store) => store.create_folder(&store.path(name)),
            Self::Remote(_) => Ok(()),
        }
    }

    /// The listing of a folder of a dataset that is being written; the store must support it.
    pub(crate) fn must_list(&self, folder: &str) -> Result<Listing, Failure> {
        self.list(folder)?.ok_or_else(|| {
            let source = io::Error::new(io::ErrorKind::PermissionDenied, "writing takes the right to list");
            failed("list a folder", self.location(folder))(source)
        })
    }

    /// The names in a folder.
    pub(crate) fn names(&self, folder: &str) -> Result<Vec<String>, Failure> {
        match self {
            Self::Folder(store) => store.names(folder),
            Self::Remote(_) => self.must_list(folder).map(|listing| listing.into_keys().collect()),
        }
    }

    /// Flushes some folders and all their parents, so that their names survive a power cut.
    pub(crate) fn flush(&self, folders: &[&str]) -> Result<(), Failure> {
        let Self::Folder(store) = self else { return Ok(()) };
        folders.iter().try_for_each(|folder| store.flush(&store.path(folder)))?;
        store.root().ancestors().skip(1).try_for_each(|above| store.flush(above))
    }

    /// Checks that the dataset with this id is still here.
    pub(crate) fn check_in_place(&self, dataset_id: &str) -> Result<(), Failure> {
        if self.read(layout::INFO)?.is_some_and(|info| sha256_hex(&info) == dataset_id) {
            return Ok(());
        }
        let text = format!("the dataset is gone, or another is in its place: {}", self.location(""));
        Err(Failure::new(ExitCode::Config, text))
    }

    /// Checks that the store refuses to upload an existing object again.
    pub(crate) fn check_creates_once(&self, name: &str, bytes: &[u8]) -> Result<(), Failure> {
        let Self::Remote(remote) = self else { return Ok(()) };
        if !remote.put_new(name, bytes.to_vec())? {
            return Ok(());
        }
        let text = "this store replaces an existing object in spite of the condition If-None-Match: *";
        let source = io::Error::new(io::ErrorKind::InvalidInput, text);
        Err(failed("use the object store", self.location(name))(source))
    }

    /// The folder, unless this is an object store.
    pub(crate) fn folder(&self) -> Option<&Path> {
        match self {
            Self::Folder(store) => Some(store.root()),
            Self::Remote(_) => None,
        }
    }

    /// Removes leftovers of killed writers from a folder of a complete dataset. An object store has none: objects are
    /// uploaded in one piece.
    pub(crate) fn sweep(&self, folder: &str) -> Result<(), Failure> {
        match self {
            Self::Folder(store) => store.sweep(folder),
            Self::Remote(_) => Ok(()),
        }
    }
}

/// The last part of a path.
pub(crate) fn file_name(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or_default()
}

/// The size of a file in its folder's listing, `None` if it is not there.
pub(crate) fn size_in(listing: &Listing, path: &str) -> Option<u64> {
    listing.get(file_name(path)).copied().flatten()
}

/// The error for a missing file or one of a wrong size.
pub(crate) fn size_problem(expected: &FileSummary, found: Option<u64>) -> Option<String> {
    match found {
        Some(bytes) if bytes == expected.bytes => None,
        Some(bytes) => Some(format!("size must be {} bytes, got {bytes}", expected.bytes)),
        None => Some("the file is missing".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use program::ExitCode;

    use super::*;
    use crate::store::fault::{Fault, Kind};

    #[test]
    fn what_is_there_stays() {
        let folder = tempfile::tempdir().unwrap();
        let storage = Storage::Folder(Store::new(folder.path()));
        assert_eq!(storage.publish_new("a/x", b"one").unwrap(), None);
        assert_eq!(storage.publish_new("a/x", b"two").unwrap(), Some(b"one".to_vec()));
        storage.publish("a/x", b"three").unwrap();
        assert_eq!(storage.read("a/x").unwrap().unwrap(), b"three");
        assert_eq!(storage.digest("a/x").unwrap().unwrap(), crate::format::seal::sha256_hex(b"three"));
        assert_eq!(storage.digest("a/y").unwrap(), None);
    }

    #[test]
    fn whichever_operation_fails_no_half_file_appears() {
        for operations in 0..32 {
            let folder = tempfile::tempdir().unwrap();
            let storage = Storage::Folder(Store::faulty(folder.path(), Fault::after(operations, Kind::Fail)));
            let result = storage.publish_new("a/b/x", b"whole");
            let found = Store::new(folder.path()).read("a/b/x").unwrap();
            match result {
                Ok(published) => {
                    assert_eq!((published, found.as_deref()), (None, Some(&b"whole"[..])));
                    return;
                }
                Err(e) => {
                    assert_eq!(e.exit_code(), ExitCode::TryAgain);
                    assert!(found.is_none_or(|found| found == b"whole"), "after {operations} operations");
                }
            }
        }
        panic!("publishing a file takes fewer than 32 operations");
    }
}
