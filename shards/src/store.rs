//! The only place that publishes anything on disk.
//!
//! A file is written under a staging name in its own folder (`.name#0.tmp`, which neither readers nor globs match),
//! flushed to the disk, renamed, and the folder flushed. So a name that readers know holds a whole file or nothing.
//! A writer holds a lock on its staging file; what a killed writer left behind carries no lock and is removed by the
//! next one, while two live writers of the same shard (schedulers do that) never share a file.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use crate::fault::Fault;
use crate::staged::Staged;
use crate::{ExitCode, Location};

/// The disk, or the object store, did not do what it was asked.
#[derive(Debug, thiserror::Error)]
#[error("failed to {action}: {source}: {at}")]
pub struct StoreError {
    /// What was tried.
    pub action: &'static str,
    /// On what.
    pub at: Location,
    /// What the system said.
    pub source: io::Error,
}

impl StoreError {
    /// [`ExitCode::TryAgain`], or [`ExitCode::Config`] if an object store will say the same again: wrong credentials,
    /// no such bucket.
    #[must_use]
    pub fn exit_code(&self) -> ExitCode {
        use io::ErrorKind::{FileTooLarge, InvalidInput, PermissionDenied};
        match (&self.at, self.source.kind()) {
            (Location::Url(_), FileTooLarge | InvalidInput | PermissionDenied) => ExitCode::Config,
            _ => ExitCode::TryAgain,
        }
    }
}

pub(crate) fn failed(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> StoreError {
    let at = path.into();
    move |source| StoreError { action, at, source }
}

/// A folder in which files are published.
#[derive(Debug, Clone)]
pub(crate) struct Store {
    root: PathBuf,
    fault: Fault,
}

/// Which leftovers to remove.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sweep {
    /// None: count those of dead writers.
    Look,
    /// Those of dead writers. Where a file system has no locks, nobody is known to be dead.
    Dead,
    /// All of them. A writer that is alive fails then, and says that it should be run again.
    All,
}

/// What was found of killed writers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Swept {
    /// Files removed, or to be removed.
    pub files: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Files that were left: somebody writes them, or may do so.
    pub kept: u64,
}

/// What lies in a folder: names, and the sizes of those that are files.
pub(crate) type Listing = BTreeMap<String, Option<u64>>;

/// Most live writers of one file.
const WRITERS_MAX: u32 = 64;
/// Largest file of `meta/` that is read.
pub(crate) const META_BYTES_MAX: u64 = 1 << 30;

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
    pub(crate) fn size(&self, name: &str) -> Result<Option<u64>, StoreError> {
        let path = self.path(name);
        match fs::metadata(&path) {
            Ok(metadata) if metadata.is_file() => Ok(Some(metadata.len())),
            Ok(_) => Ok(None),
            Err(e) if is_absent(&e) => Ok(None),
            Err(e) => Err(failed("look at a file", &path)(e)),
        }
    }

    /// Opens a file to read it.
    pub(crate) fn open(&self, name: &str) -> Result<File, StoreError> {
        let path = self.path(name);
        File::open(&path).map_err(failed("open a file", &path))
    }

    /// What lies in a folder; nothing if there is none.
    pub(crate) fn list(&self, folder: &str) -> Result<Listing, StoreError> {
        let folder = self.path(folder);
        let listed = match fs::read_dir(&folder) {
            Err(e) if is_absent(&e) => return Ok(Listing::new()),
            listed => listed.and_then(|entries| {
                let entry = |entry: fs::DirEntry| {
                    let size = fs::metadata(entry.path()).ok().filter(fs::Metadata::is_file).map(|m| m.len());
                    (entry.file_name().to_string_lossy().into_owned(), size)
                };
                entries.map(|found| found.map(entry)).collect()
            }),
        };
        listed.map_err(failed("list a folder", &folder))
    }

    /// The bytes of a small file, `None` if there is none.
    pub(crate) fn read(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        let path = self.path(name);
        let file = match File::open(&path) {
            Ok(file) => file,
            Err(e) if is_absent(&e) => return Ok(None),
            Err(e) => return Err(failed("open a file", &path)(e)),
        };
        let mut bytes = Vec::new();
        file.take(META_BYTES_MAX).read_to_end(&mut bytes).map_err(failed("read a file", &path))?;
        Ok(Some(bytes))
    }

    /// Begins a file that will be called `name`.
    pub(crate) fn stage(&self, name: &str) -> Result<Staged, StoreError> {
        let target = self.path(name);
        let folder = target.parent().unwrap_or(&self.root).to_owned();
        self.create_folder(&folder)?;
        let (staging, file) = self.open_staging(&folder, &target)?;
        Ok(Staged::file(file, staging, target, self.fault.clone()))
    }

    /// Removes what killed writers left in a folder.
    pub(crate) fn sweep(&self, folder: &str, sweep: Sweep, swept: &mut Swept) -> Result<(), StoreError> {
        for (name, bytes) in self.list(folder)? {
            if !is_staging(&name) {
                continue;
            }
            let path = self.path(folder).join(&name);
            let is_gone = match sweep {
                Sweep::Look => dead(&path).is_some(),
                Sweep::Dead => remove_if_dead(&path),
                Sweep::All => fs::remove_file(&path).is_ok(),
            };
            if is_gone {
                swept.files += 1;
                swept.bytes += bytes.unwrap_or_default();
            } else {
                swept.kept += 1;
            }
        }
        Ok(())
    }

    /// Creates a folder and what is above it, each flushed into its parent.
    pub(crate) fn create_folder(&self, folder: &Path) -> Result<(), StoreError> {
        if folder.is_dir() {
            return Ok(());
        }
        if let Some(parent) = folder.parent().filter(|p| !p.as_os_str().is_empty()) {
            self.create_folder(parent)?;
        }
        self.fault.check().map_err(failed("create a folder", folder))?;
        match fs::create_dir(folder) {
            Ok(()) => {}
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists && folder.is_dir() => {}
            Err(e) => return Err(failed("create a folder", folder)(e)),
        }
        sync_folder(folder.parent())
    }

    fn open_staging(&self, folder: &Path, target: &Path) -> Result<(PathBuf, File), StoreError> {
        let name = target.file_name().unwrap_or_default().to_string_lossy();
        let mut attempt = 0;
        while attempt < WRITERS_MAX {
            let path = folder.join(format!(".{name}#{attempt}.tmp"));
            self.fault.check().map_err(failed("create a file", target))?;
            match OpenOptions::new().write(true).create_new(true).open(&path) {
                Ok(file) if is_mine(&file, &path) => return Ok((path, file)),
                Ok(_) => attempt += 1,
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {
                    if !remove_if_dead(&path) {
                        attempt += 1;
                    }
                }
                Err(e) => return Err(failed("create a file", target)(e)),
            }
        }
        Err(failed("find a staging name", target)(io::ErrorKind::ResourceBusy.into()))
    }
}

/// Whether a name is that of a file being written, or left behind by a killed writer.
pub(crate) fn is_staging(name: &str) -> bool {
    name.starts_with('.') && name.contains('#') && name.ends_with(".tmp")
}

fn is_absent(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
}

/// Locks a fresh staging file; false if a sweeper was faster. Where there are no locks the file counts as ours.
fn is_mine(file: &File, path: &Path) -> bool {
    match file.try_lock() {
        Ok(()) => is_same_file(file, path),
        Err(TryLockError::WouldBlock) => false,
        Err(TryLockError::Error(_)) => true,
    }
}

/// Removes a staging file if its writer is dead. Where there are no locks nobody is known to be dead.
fn remove_if_dead(path: &Path) -> bool {
    match dead(path) {
        Some(_locked) => fs::remove_file(path).is_ok(),
        None => !path.exists(),
    }
}

/// The file of a dead writer, locked.
fn dead(path: &Path) -> Option<File> {
    let file = OpenOptions::new().write(true).open(path).ok()?;
    (file.try_lock().is_ok() && is_same_file(&file, path)).then_some(file)
}

#[cfg(unix)]
fn is_same_file(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let number = |m: &fs::Metadata| (m.dev(), m.ino());
    matches!((file.metadata(), fs::metadata(path)), (Ok(a), Ok(b)) if number(&a) == number(&b))
}

#[cfg(not(unix))]
fn is_same_file(_: &File, path: &Path) -> bool {
    path.exists()
}

pub(crate) fn sync_folder(folder: Option<&Path>) -> Result<(), StoreError> {
    let Some(folder) = folder.filter(|f| cfg!(unix) && !f.as_os_str().is_empty()) else { return Ok(()) };
    File::open(folder).and_then(|f| f.sync_all()).map_err(failed("flush a folder", folder))
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn live_writers_do_not_meet_and_dead_ones_are_swept() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::new(folder.path());
        let dead = folder.path().join(".x#0.tmp");
        fs::write(&dead, b"left by a killed writer").unwrap();
        let first = store.stage("x").unwrap();
        let second = store.stage("x").unwrap();
        assert_eq!(first.staging(), dead, "the leftover's name is free again");
        assert_ne!(first.staging(), second.staging());
        let sweep = |which| {
            let mut swept = Swept::default();
            store.sweep("", which, &mut swept).unwrap();
            swept
        };
        assert_eq!(sweep(Sweep::Dead), Swept { files: 0, bytes: 0, kept: 2 });
        drop((first, second));
        fs::write(&dead, b"left again").unwrap();
        assert_eq!(sweep(Sweep::Look), Swept { files: 1, bytes: 10, kept: 0 });
        assert_eq!(names(folder.path()).len(), 1);
        assert_eq!(sweep(Sweep::Dead), Swept { files: 1, bytes: 10, kept: 0 });
        assert!(names(folder.path()).is_empty());
        let alive = store.stage("x").unwrap();
        assert_eq!(sweep(Sweep::All).files, 1);
        assert_eq!(alive.finish().unwrap().publish().unwrap_err().exit_code(), ExitCode::TryAgain);
    }
}
