//! Completing a dataset: when every shard has its marker, the dataset card, the manifest and the success mark are
//! written. Any process may do this at any time and repeatedly; the bytes are always the same.

use std::collections::BTreeSet;

use program::{ExitCode, Failure};

use crate::format::summary::{Manifest, ShardSummary};
use crate::format::{layout, seal};
use crate::store::{file_name, size_in};
use crate::write::card;
use crate::write::draft::FOLDERS;
use crate::{Draft, Table};

/// The result of completing a dataset.
#[derive(Debug, Clone, PartialEq)]
pub enum Finalized {
    /// The dataset is complete.
    Complete(Manifest),
    /// Shards are missing, or their files have wrong sizes.
    Incomplete {
        /// Their indices, in order.
        missing: Vec<u32>,
    },
}

impl Draft {
    /// The missing shards, in order: those without a marker of this dataset, or without files of the marker's sizes.
    ///
    /// # Errors
    /// [`Failure`] if the disk refuses.
    pub fn missing(&self) -> Result<Vec<u32>, Failure> {
        self.committed().map(|(_, missing)| missing)
    }

    /// The shards without a marker, in order: a quick check before a complete one.
    ///
    /// # Errors
    /// [`Failure`] if the disk refuses.
    pub fn unmarked(&self) -> Result<Vec<u32>, Failure> {
        let markers: BTreeSet<String> = self.storage.names("meta/shards")?.into_iter().collect();
        let has_marker = |shard: &u32| markers.contains(file_name(&layout::marker(*shard)));
        Ok((0..self.info.shard_count).filter(|shard| !has_marker(shard)).collect())
    }

    /// The markers of the committed shards, in order, and the indices of the others.
    fn committed(&self) -> Result<(Vec<ShardSummary>, Vec<u32>), Failure> {
        let (mut committed, mut missing) = (Vec::<ShardSummary>::new(), Vec::new());
        let names = (0..self.info.shard_count).map(layout::marker);
        self.storage.read_each(names, |marker| {
            let shard = (committed.len() + missing.len()) as u32; // below the number of shards
            match marker.and_then(|bytes| self.summary(shard, bytes)) {
                Some(summary) => committed.push(summary),
                None => missing.push(shard),
            }
        })?;
        // Listed after the markers were read: a shard's files are published before its marker.
        for table in Table::ALL {
            let listing = self.storage.must_list(table.name())?;
            committed.retain(|summary| {
                let file = summary.file(table);
                let is_there = size_in(&listing, &file.path) == Some(file.bytes);
                missing.extend((!is_there).then_some(summary.shard));
                is_there
            });
        }
        missing.sort_unstable();
        Ok((committed, missing))
    }

    /// Writes `README.md`, `meta/manifest.json` and `_SUCCESS` if every shard exists. An existing card remains, because
    /// users may edit it. An existing manifest must be equal.
    ///
    /// # Errors
    /// [`Failure`] if the storage fails, or a different manifest exists.
    pub fn finalize(&self) -> Result<Finalized, Failure> {
        let (shards, missing) = self.committed()?;
        if let Some(first) = missing.first() {
            self.must_not_be_of_another(*first)?;
            return Ok(Finalized::Incomplete { missing });
        }
        // The writers of these files may have been killed before they flushed the folders.
        self.flush()?;
        let manifest = Manifest::new(&self.info, self.dataset_id.clone(), shards);
        self.storage.check_in_place(&self.dataset_id)?;
        self.storage.publish_new(layout::CARD, card::card(&self.info, &manifest).as_bytes())?;
        let text = seal::seal(&manifest);
        self.storage.check_in_place(&self.dataset_id)?;
        if let Some(before) = self.storage.publish_new(layout::MANIFEST, text.as_bytes())?
            && before != text.as_bytes()
        {
            if seal::unseal::<Manifest>(before.clone()).is_ok() {
                let (before, now) = (seal::sha256_hex(&before), seal::sha256_hex(text.as_bytes()));
                let (manifest, card, success) = (layout::MANIFEST, layout::CARD, layout::SUCCESS);
                let text = format!(
                    "{manifest} is there, sealed, and not what the markers make it, SHA-256 {before} there and {now} \
                     now: was a shard made again by another program? If so, delete it, {card} and {success}, and \
                     finalize again"
                );
                return Err(Failure::new(ExitCode::Data, text));
            }
            self.storage.publish(layout::MANIFEST, text.as_bytes())?; // replaces a damaged one
        }
        self.storage.publish_new(layout::SUCCESS, b"")?;
        // The dataset is complete even if this fails. Writers that are still running find everything in place.
        if let Err(error) = FOLDERS.iter().try_for_each(|folder| self.storage.sweep(folder)) {
            tracing::warn!(%error, "leftovers of killed writers were not removed");
        }
        Ok(Finalized::Complete(manifest))
    }
}

impl Draft {
    /// A shard with a marker of another dataset is not missing: `meta/info.json` was edited, or folders were mixed.
    fn must_not_be_of_another(&self, shard: u32) -> Result<(), Failure> {
        let name = layout::marker(shard);
        let marker = self.storage.read(&name)?.and_then(|bytes| seal::unseal::<ShardSummary>(bytes).ok());
        let Some(other) = marker.map(|marker| marker.dataset_id).filter(|id| *id != self.dataset_id) else {
            return Ok(());
        };
        let (id, info) = (&self.dataset_id, layout::INFO);
        let text = format!(
            "{name} belongs to dataset {other}, and {info} is that of {id}: was {info} edited, or a folder of another \
             dataset copied here?"
        );
        Err(Failure::new(ExitCode::Data, text))
    }
}
