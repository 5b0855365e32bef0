//! A dataset that is being written. Any number of processes on any machines may write the same dataset. There is no
//! lock, no clock and no coordinator: files are created atomically and never changed.

use program::Failure;

use crate::format::summary::ShardSummary;
use crate::format::{layout, seal};
use crate::read::dataset::read_info;
use crate::store::{Patience, Storage};
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
}

/// A dataset's folders, parents last.
pub(crate) const FOLDERS: [&str; 6] = ["attempts", "scenes", "objects", "meta/shards", "meta", ""];
