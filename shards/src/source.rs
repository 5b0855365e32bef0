//! Reading the files of a dataset, wherever it lies.

use std::fs::File;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::Location;
use crate::remote::{Fetched, Remote};
use crate::store::{Listing, Store, StoreError};
use crate::summary::FileSummary;
use crate::table_reader::hash;

/// Where files are read from.
#[derive(Debug)]
pub(crate) enum Source {
    /// A folder: files are opened where they are.
    Folder(Store),
    /// An object store: files are fetched.
    Remote(Remote),
}

/// Why a file is not read.
#[derive(Debug)]
pub(crate) enum Unread {
    /// It is not the one that was written.
    Wrong(String),
    /// Nobody knows.
    Store(StoreError),
}

impl From<StoreError> for Unread {
    fn from(error: StoreError) -> Self {
        Self::Store(error)
    }
}

impl Source {
    pub(crate) fn open(at: &Location) -> Result<Self, StoreError> {
        match at {
            Location::Path(path) => Ok(Self::Folder(Store::new(path))),
            Location::Url(url) => Remote::open(url).map(Self::Remote),
        }
    }

    /// Where a file lies, or the dataset itself if the name is empty.
    pub(crate) fn location(&self, name: &str) -> Location {
        match self {
            Self::Folder(store) => Location::Path(store.path(name)),
            Self::Remote(remote) => remote.location(name),
        }
    }

    /// The bytes of a small file, `None` if there is none.
    pub(crate) fn read(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        match self {
            Self::Folder(store) => store.read(name),
            Self::Remote(remote) => remote.read(name),
        }
    }

    /// What lies in a folder; `None` where that cannot be asked.
    pub(crate) fn list(&self, folder: &str) -> Result<Option<Listing>, StoreError> {
        match self {
            Self::Folder(store) => store.list(folder).map(Some),
            Self::Remote(remote) => remote.list(folder),
        }
    }

    /// A shard's file, after a look at its size and its checksum. On a disk the checksum is looked at once, which
    /// `is_checked` remembers; what was fetched is looked at each time.
    pub(crate) fn open_file(&self, expected: &FileSummary, is_checked: &AtomicBool) -> Result<File, Unread> {
        let (file, sha256) = match self {
            Self::Folder(store) => {
                size_problem(expected, store.size(&expected.path)?).map_or(Ok(()), |p| Err(Unread::Wrong(p)))?;
                let mut file = store.open(&expected.path)?;
                if is_checked.load(Ordering::Acquire) {
                    return Ok(file);
                }
                let at = |source| StoreError { action: "read a file", at: self.location(&expected.path), source };
                let sha256 = hash(&mut file).map_err(at)?;
                (file, sha256)
            }
            Self::Remote(remote) => match remote.fetch(&expected.path, expected.bytes)? {
                Fetched::Whole(file, sha256) => (file, sha256),
                Fetched::Missing => return Err(Unread::Wrong(MISSING.to_owned())),
                Fetched::OtherSize(bytes) => return Err(Unread::Wrong(other_size(expected, bytes))),
            },
        };
        if sha256 != expected.sha256 {
            return Err(Unread::Wrong(format!("sha256 must be {}, got {sha256}", expected.sha256)));
        }
        is_checked.store(true, Ordering::Release);
        Ok(file)
    }
}

const MISSING: &str = "the file is missing";

fn other_size(expected: &FileSummary, bytes: u64) -> String {
    format!("size must be {} bytes, got {bytes}", expected.bytes)
}

/// What is wrong with the size of a file, or with there being none.
pub(crate) fn size_problem(expected: &FileSummary, found: Option<u64>) -> Option<String> {
    match found {
        Some(bytes) if bytes == expected.bytes => None,
        Some(bytes) => Some(other_size(expected, bytes)),
        None => Some(MISSING.to_owned()),
    }
}
