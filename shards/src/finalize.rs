//! Completing a dataset: when every shard has its marker, the manifest and the dataset card are written. Anyone may
//! do this, at any time, any number of times: the bytes are always the same.

use std::path::Path;

use crate::dataset::read_info;
use crate::source::Source;
use crate::store::{Store, StoreError};
use crate::summary::Manifest;
use crate::writer::committed;
use crate::{ExitCode, ReadError, Table, card, layout, seal};

/// What came of it.
#[derive(Debug, Clone, PartialEq)]
pub enum Finalized {
    /// The dataset is complete.
    Complete(Manifest),
    /// Shards are missing, or their files are not of the size that was written.
    Incomplete {
        /// Their numbers, in order.
        missing: Vec<u32>,
    },
}

/// Why a dataset cannot be completed.
#[derive(Debug, thiserror::Error)]
pub enum FinalizeError {
    /// There is no dataset, or its info is damaged.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The disk refused.
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl FinalizeError {
    /// The code to end with.
    #[must_use]
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Read(error) => error.exit_code(),
            Self::Store(error) => error.exit_code(),
        }
    }
}

/// Writes `meta/manifest.json` and `README.md` if every shard is there.
///
/// # Errors
/// [`FinalizeError`] if there is no dataset, its info is damaged, or the disk refuses.
pub fn finalize(dir: &Path) -> Result<Finalized, FinalizeError> {
    let store = Store::new(dir);
    let (info, dataset_id) = read_info(&Source::Folder(store.clone()), &dir.into())?;
    let mut shards = Vec::new();
    let mut missing = Vec::new();
    for shard in 0..info.shard_count {
        match committed(&store, &info, &dataset_id, shard)? {
            Some(summary) => shards.push(summary),
            None => missing.push(shard),
        }
    }
    if !missing.is_empty() {
        return Ok(Finalized::Incomplete { missing });
    }
    let mut manifest = Manifest::new(&info, shards);
    manifest.dataset_id = dataset_id;
    store.publish(layout::CARD, card::card(&info, &manifest).as_bytes())?;
    store.publish(layout::MANIFEST, seal::seal(&manifest).as_bytes())?;
    for folder in Table::ALL.map(Table::name).into_iter().chain(["meta", "meta/shards", ""]) {
        store.sweep(folder)?;
    }
    Ok(Finalized::Complete(manifest))
}
