//! A dataset that is being written. Any number of processes on any machines may write the same dataset. There is no
//! lock, no clock and no coordinator: files are created atomically and never changed.

use program::Failure;

use crate::format::summary::ShardSummary;
use crate::format::{layout, seal};
use crate::read::dataset::read_info;
use crate::store::{Patience, Storage, Sweep, Swept};
use crate::write::writer::ShardWriter;
use crate::{DatasetInfo, Location, Table};

/// A dataset that is being written, in a folder or an object store.
#[derive(Debug)]
pub struct Draft {
    pub(crate) storage: Storage,
    pub(crate) info: DatasetInfo,
    pub(crate) dataset_id: String,
}

impl Draft {
    /// Opens a dataset that [`Draft::begin`] has begun.
    ///
    /// # Errors
    /// [`Failure`] if there is no dataset, or its info is damaged.
    pub fn open(at: impl Into<Location>) -> Result<Self, Failure> {
        let storage = Storage::open(&at.into(), Patience::Writer)?;
        let (info, dataset_id) = read_info(&storage)?;
        Ok(Self { storage, info, dataset_id })
    }

    /// Its location.
    #[must_use]
    pub fn location(&self) -> Location {
        self.storage.location("")
    }

    /// The dataset's info.
    #[must_use]
    pub fn info(&self) -> &DatasetInfo {
        &self.info
    }

    /// Begins a shard.
    ///
    /// # Errors
    /// [`Failure`] if there is no such shard or the storage fails.
    pub fn shard(&self, shard: u32) -> Result<ShardWriter, Failure> {
        ShardWriter::create(self.storage.clone(), &self.info, &self.dataset_id, shard)
    }

    /// Whether a shard exists: a marker of this dataset, and files of the marker's sizes.
    ///
    /// # Errors
    /// [`Failure`] if the storage fails.
    pub fn is_committed(&self, shard: u32) -> Result<bool, Failure> {
        let marker = self.storage.read(&layout::marker(shard))?;
        let Some(summary) = marker.and_then(|bytes| self.summary(shard, bytes)) else { return Ok(false) };
        for table in Table::ALL {
            let file = summary.file(table);
            if self.storage.size(&file.path)? != Some(file.bytes) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The content of a marker, unless it is damaged or belongs to another shard.
    pub(crate) fn summary(&self, shard: u32, marker: Vec<u8>) -> Option<ShardSummary> {
        let summary = seal::unseal::<ShardSummary>(marker).ok()?;
        (summary.shard == shard && summary.problems(&self.info, &self.dataset_id).is_empty()).then_some(summary)
    }

    /// Flushes the dataset's folders, so that all names survive a power cut.
    ///
    /// # Errors
    /// [`Failure`] if the storage fails.
    pub fn flush(&self) -> Result<(), Failure> {
        self.storage.flush(&FOLDERS)
    }

    /// Removes leftovers of killed writers. In an object store there are none, because objects are uploaded in one
    /// piece. If the dataset is complete, no leftover is needed, so [`Sweep::Dead`]
    /// removes all. All shards are not enough: a writer may be about to publish the card, the manifest or `_SUCCESS`.
    ///
    /// # Errors
    /// [`Failure`] if the storage fails.
    pub fn sweep(&self, sweep: Sweep) -> Result<Swept, Failure> {
        let is_complete =
            || Ok::<_, Failure>(self.storage.size(layout::SUCCESS)?.is_some() && self.missing()?.is_empty());
        let is_needed = sweep != Sweep::All && !is_complete()?;
        self.sweep_folders(sweep, is_needed)
    }

    pub(crate) fn sweep_folders(&self, sweep: Sweep, is_needed: bool) -> Result<Swept, Failure> {
        let mut swept = Swept::default();
        for folder in FOLDERS {
            self.storage.sweep(folder, sweep, is_needed, &mut swept)?;
        }
        Ok(swept)
    }
}

/// A dataset's folders, parents last.
pub(crate) const FOLDERS: [&str; 6] = ["attempts", "scenes", "objects", "meta/shards", "meta", ""];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;
    use crate::write::finalize::Finalized;

    #[test]
    fn a_sweep_leaves_the_manifest_of_a_writer_that_completes_the_dataset() {
        let folder = tempfile::tempdir().unwrap();
        let mut info = synthetic::info(7, 2, 60, 10);
        info.grid.resolution = 8;
        let draft = Draft::begin(folder.path(), &info).unwrap();
        for shard in 0..2 {
            let mut writer = draft.shard(shard).unwrap();
            for scene in info.scenes_of(shard) {
                writer.push(&synthetic::scene_rows(scene, info.seed, &info)).unwrap();
            }
            writer.commit().unwrap();
        }
        let staged = draft.storage.stage(layout::MANIFEST).unwrap();
        let swept = draft.sweep(Sweep::Dead).unwrap();
        assert_eq!((swept.files, swept.kept), (0, 1));
        assert!(staged.finish().unwrap().publish_new().unwrap(), "the writer finds its file");
        std::fs::remove_file(folder.path().join(layout::MANIFEST)).unwrap();
        assert!(matches!(draft.finalize(), Ok(Finalized::Complete(_))));
        let unneeded = draft.storage.stage(layout::MANIFEST).unwrap();
        let swept = draft.sweep(Sweep::Dead).unwrap();
        assert_eq!((swept.files, swept.kept), (1, 0), "the dataset is complete");
        drop(unneeded);
    }
}
