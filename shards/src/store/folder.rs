//! Publishing a dataset's files in a folder. (`program::publish` replaces any other file atomically.)
//!
//! A file is written under a staging name in its own folder (`.name#….tmp`, which neither readers nor globs match)
//! and flushed to the disk. Then it is renamed if its final name is free, and the folder is flushed. A final name
//! therefore has a complete file or none. Staging names are unique and never reused. Files of killed writers remain
//! until the dataset is complete.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};

use program::Failure;

use crate::store::error::failed;
use crate::store::fault::Fault;
use crate::store::staged::{Staged, sync_folder};
use crate::store::{Listing, META_BYTES_MAX};

/// A folder in which files are published.
#[derive(Debug, Clone)]
pub(crate) struct Store {
    root: PathBuf,
    fault: Fault,
}

impl Store {
    pub(crate) fn new(root: &Path) -> Self {
        Self { root: root.to_owned(), fault: Fault::default() }
    }

    #[cfg(test)]
    pub(crate) fn faulty(root: &Path, fault: Fault) -> Self {
        Self { root: root.to_owned(), fault }
    }

    pub(crate) fn root(&self) -> &Path {
        &self.root
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// The size of a file in bytes, `None` if there is none.
    pub(crate) fn size(&self, name: &str) -> Result<Option<u64>, Failure> {
        let path = self.path(name);
        match fs::metadata(&path) {
            Ok(metadata) if metadata.is_file() => Ok(Some(metadata.len())),
            Ok(_) => Ok(None),
            Err(e) if is_absent(&e) => Ok(None),
            Err(e) => Err(failed("look at a file", &path)(e)),
        }
    }

    /// Opens a file to read it.
    pub(crate) fn open(&self, name: &str) -> Result<File, Failure> {
        let path = self.path(name);
        program::open(&path).map_err(failed("open a file", &path))
    }

    /// The listing of a folder; empty if there is none.
    pub(crate) fn list(&self, folder: &str) -> Result<Listing, Failure> {
        let size = |name: String| match self.size(&format!("{folder}/{name}")) {
            Ok(size) => Ok((name, size)),
            Err(error) => Err(error),
        };
        self.names(folder)?.into_iter().map(size).collect()
    }

    /// The names in a folder, in any order; none if there is no folder.
    pub(crate) fn names(&self, folder: &str) -> Result<Vec<String>, Failure> {
        let folder = self.path(folder);
        match program::names_in(&folder) {
            Err(e) if is_absent(&e) => Ok(Vec::new()),
            names => names.map_err(failed("list a folder", &folder)),
        }
    }

    /// The bytes of a small file, `None` if there is none.
    pub(crate) fn read(&self, name: &str) -> Result<Option<Vec<u8>>, Failure> {
        let path = self.path(name);
        match program::read(&path, META_BYTES_MAX) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(e) if is_absent(&e) => Ok(None),
            Err(e) => Err(failed("read a file", &path)(e)),
        }
    }

    /// Creates a staging file for `name`.
    pub(crate) fn stage(&self, name: &str) -> Result<Staged, Failure> {
        let target = self.path(name);
        let folder = target.parent().unwrap_or(&self.root);
        self.create_folder(folder)?;
        let prefix = format!(".{}#", target.file_name().unwrap_or_default().to_string_lossy());
        self.fault.check().map_err(failed("create a file", &target))?;
        let staging = tempfile::Builder::new()
            .prefix(&prefix)
            .rand_bytes(16)
            .suffix(STAGING_END)
            .make_in(folder, |path| OpenOptions::new().write(true).create_new(true).open(path))
            .map_err(failed("create a file", &target))?;
        let (file, staging) = staging.into_parts();
        Ok(Staged::file(file, staging, target, self.fault.clone()))
    }

    /// Removes leftovers of killed writers from a folder of a complete dataset. A writer that is still running finds
    /// everything in place.
    pub(crate) fn sweep(&self, folder: &str) -> Result<(), Failure> {
        for name in self.names(folder)?.into_iter().filter(|name| is_staging(name)) {
            let _ = fs::remove_file(self.path(folder).join(name)); // its writer may have ended just now
        }
        Ok(())
    }

    /// Creates a folder and its parents. Its name survives a power cut; those of its parents once they are flushed.
    pub(crate) fn create_folder(&self, folder: &Path) -> Result<(), Failure> {
        if folder.is_dir() {
            return Ok(());
        }
        let created = self.fault.check().and_then(|()| fs::create_dir_all(folder));
        created.map_err(failed("create a folder", folder))?;
        sync_folder(folder.parent(), &self.fault)
    }

    /// Flushes a folder, so that its names survive a power cut even if their writer was killed before flushing.
    pub(crate) fn flush(&self, folder: &Path) -> Result<(), Failure> {
        sync_folder(Some(folder), &self.fault)
    }
}

/// The suffix of staging names.
const STAGING_END: &str = ".tmp";

/// Whether a name is a staging name.
pub(crate) fn is_staging(name: &str) -> bool {
    name.starts_with('.') && name.contains('#') && name.ends_with(STAGING_END)
}

fn is_absent(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
}

#[cfg(test)]
mod tests {
    use program::ExitCode;

    use super::*;
    use crate::store::staged::Ready;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    fn publish(store: &Store, name: &str, bytes: &[u8]) {
        let mut staged = store.stage(name).unwrap();
        staged.put(bytes).unwrap();
        staged.finish().unwrap().publish().unwrap();
    }

    #[test]
    fn a_dropped_file_leaves_nothing_and_a_published_one_only_itself() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::new(folder.path());
        drop(store.stage("a/x").unwrap());
        assert!(names(&folder.path().join("a")).is_empty());
        publish(&store, "a/x", b"one");
        publish(&store, "a/x", b"two");
        assert_eq!(store.read("a/x").unwrap().unwrap(), b"two");
        assert_eq!(names(&folder.path().join("a")), ["x"]);
    }

    #[test]
    fn writers_do_not_meet_and_a_sweep_takes_what_they_leave() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::new(folder.path());
        let (first, second) = (store.stage("x").unwrap(), store.stage("x").unwrap());
        assert_ne!(first.staging(), second.staging());
        publish(&store, "y", b"whole");
        store.sweep("").unwrap();
        assert_eq!(names(folder.path()), ["y"]);
        assert_eq!(first.finish().unwrap().publish().unwrap_err().exit_code(), ExitCode::TryAgain);
        drop(second);
    }

    #[test]
    fn a_swept_writer_finds_the_file_that_another_made_and_takes_no_other_for_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::new(folder.path());
        let mut swept = store.stage("x").unwrap();
        swept.put(b"whole").unwrap();
        store.sweep("").unwrap();
        let unfinished = store.stage("x").unwrap();
        assert_eq!(swept.finish().unwrap().publish_new().unwrap_err().exit_code(), ExitCode::TryAgain);
        assert_eq!(store.read("x").unwrap(), None);
        let mut late = store.stage("x").unwrap();
        late.put(b"whole").unwrap();
        publish(&store, "x", b"whole");
        store.sweep("").unwrap();
        assert!(!late.finish().unwrap().publish_new().unwrap(), "it is there");
        assert_eq!(store.read("x").unwrap().unwrap(), b"whole");
        drop(unfinished);
    }

    #[test]
    fn a_file_in_place_of_a_folder_or_a_folder_that_is_gone_is_no_matter_of_time() {
        let folder = tempfile::tempdir().unwrap();
        let staged = || Store::new(&folder.path().join("gone")).stage("x").unwrap().finish().unwrap();
        for publish in [|staged: Ready| staged.publish(), |staged: Ready| staged.publish_new().map(drop)] {
            let staged = staged();
            fs::remove_dir_all(folder.path().join("gone")).unwrap();
            assert_eq!(publish(staged).unwrap_err().exit_code(), ExitCode::Config);
        }
        fs::write(folder.path().join("file"), b"").unwrap();
        for name in ["file/x", "file/a/x"] {
            assert_eq!(Store::new(folder.path()).stage(name).unwrap_err().exit_code(), ExitCode::Config, "{name}");
        }
    }
}
