//! Every scene's grid, decoded once and kept in a file.
//!
//! Parquet suits storage and sharing, but a shuffled epoch needs random access to grids. Therefore each grid is decoded
//! once at the start of training to a file of raw floats (256 kB per scene, in the run's folder) and read from there.
//! The system's page cache holds what fits; about 40 bytes per attempt are in memory. The file has no name, so it
//! disappears with the process.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use program::{Exit, ExitCode};

use network::receptive_field::RESOLUTION;

const VALUES: usize = RESOLUTION.pow(3);
const BYTES: usize = 4 * VALUES;

/// The spool file cannot be created, written or read.
#[derive(Debug, thiserror::Error)]
#[error("failed to {action} the file of decoded grids ({bytes} bytes in all): {source}: {}", .path.display())]
pub struct SpoolError {
    /// The operation.
    pub action: &'static str,
    /// Size of the whole file.
    pub bytes: u64,
    /// Its folder.
    pub path: PathBuf,
    /// What the system said.
    pub source: io::Error,
}

impl Exit for SpoolError {
    /// [`ExitCode::TryAgain`]: the disk may have space later.
    fn exit_code(&self) -> ExitCode {
        ExitCode::TryAgain
    }
}

/// The grids of all scenes, 40³ values each.
#[derive(Debug)]
pub struct Grids {
    file: Mutex<File>,
    path: PathBuf,
    count: usize,
}

impl Grids {
    /// A file for `count` grids in `folder`, which must exist.
    ///
    /// # Errors
    /// [`SpoolError`] if the file cannot be created.
    pub fn create(folder: &Path, count: usize) -> Result<Self, SpoolError> {
        let path = folder.to_owned();
        let bytes = (count * BYTES) as u64;
        let made = tempfile::tempfile_in(folder);
        let file = made.map_err(|source| SpoolError { action: "make", bytes, path: path.clone(), source })?;
        Ok(Self { file: Mutex::new(file), path, count })
    }

    /// Number of grids.
    #[must_use]
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Writes a grid.
    ///
    /// # Errors
    /// [`SpoolError`], for example on a full disk.
    ///
    /// # Panics
    /// If there is no such grid or it is not 40³.
    pub fn write(&self, number: usize, values: &[f32]) -> Result<(), SpoolError> {
        assert!(number < self.count && values.len() == VALUES, "grid {number} of {}", self.count);
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.at(number, "write", |file| file.write_all(&bytes))
    }

    /// Reads a grid.
    ///
    /// # Errors
    /// [`SpoolError`].
    ///
    /// # Panics
    /// If there is no such grid.
    pub fn read(&self, number: usize) -> Result<Arc<[f32]>, SpoolError> {
        assert!(number < self.count, "grid {number} of {}", self.count);
        let mut bytes = vec![0; BYTES];
        self.at(number, "read", |file| file.read_exact(&mut bytes))?;
        Ok(bytes.as_chunks::<4>().0.iter().map(|value| f32::from_le_bytes(*value)).collect())
    }

    fn at(
        &self,
        number: usize,
        action: &'static str,
        act: impl FnOnce(&mut File) -> io::Result<()>,
    ) -> Result<(), SpoolError> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let offset = (number * BYTES) as u64;
        file.seek(SeekFrom::Start(offset)).and_then(|_| act(&mut file)).map_err(|source| SpoolError {
            action,
            bytes: (self.count * BYTES) as u64,
            path: self.path.clone(),
            source,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn grids_come_back_and_leave_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let grids = Grids::create(folder.path(), 3).unwrap();
        for number in [2, 0, 1] {
            grids.write(number, &vec![number as f32 + 0.25; VALUES]).unwrap();
        }
        assert!(grids.read(1).unwrap().iter().all(|value| *value == 1.25));
        assert!(grids.read(2).unwrap().iter().all(|value| *value == 2.25));
        drop(grids);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn no_folder_is_told_with_the_path() {
        let error = Grids::create(Path::new("/nonexistent/folder"), 1).unwrap_err();
        assert!(error.to_string().contains("/nonexistent/folder"), "{error}");
        assert_eq!(error.exit_code(), ExitCode::TryAgain);
    }
}
