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

use network::receptive_field::RESOLUTION;

const VALUES: usize = RESOLUTION.pow(3);
const BYTES: usize = 4 * VALUES;

/// The grids of all scenes, 40³ values each.
#[derive(Debug)]
pub(super) struct Grids {
    file: Mutex<File>,
    folder: PathBuf,
    count: usize,
}

impl Grids {
    /// A file for `count` grids in `folder`, which must exist.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub(super) fn create(folder: &Path, count: usize) -> io::Result<Self> {
        let file = tempfile::tempfile_in(folder).map_err(|error| failed("make", count, folder, &error))?;
        Ok(Self { file: Mutex::new(file), folder: folder.to_owned(), count })
    }

    /// Writes a grid.
    ///
    /// # Errors
    /// The system's error, for example on a full disk.
    ///
    /// # Panics
    /// If there is no such grid or it is not 40³.
    pub(super) fn write(&self, number: usize, values: &[f32]) -> io::Result<()> {
        assert!(number < self.count && values.len() == VALUES, "grid {number} of {}", self.count);
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.at(number, "write", |file| file.write_all(&bytes))
    }

    /// Reads a grid.
    ///
    /// # Errors
    /// The system's error.
    ///
    /// # Panics
    /// If there is no such grid.
    pub(super) fn read(&self, number: usize) -> io::Result<Arc<[f32]>> {
        assert!(number < self.count, "grid {number} of {}", self.count);
        let mut bytes = vec![0; BYTES];
        self.at(number, "read", |file| file.read_exact(&mut bytes))?;
        Ok(bytes.as_chunks::<4>().0.iter().map(|value| f32::from_le_bytes(*value)).collect())
    }

    fn at(&self, number: usize, action: &str, act: impl FnOnce(&mut File) -> io::Result<()>) -> io::Result<()> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let done = file.seek(SeekFrom::Start((number * BYTES) as u64)).and_then(|_| act(&mut file));
        done.map_err(|error| failed(action, self.count, &self.folder, &error))
    }
}

/// The system's error with the size and the folder of the file.
fn failed(action: &str, count: usize, folder: &Path, error: &io::Error) -> io::Error {
    let (bytes, folder) = (count * BYTES, folder.display());
    let text = format!("failed to {action} the file of decoded grids ({bytes} bytes in all): {error}: {folder}");
    io::Error::new(error.kind(), text)
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
        assert_eq!(program::Exit::exit_code(&error), program::ExitCode::TryAgain);
    }
}
