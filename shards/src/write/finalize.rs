//! Completing a dataset: when every shard has its marker, the dataset card, the manifest and the success mark are
//! written. Any process may do this at any time and repeatedly; the bytes are always the same.

use std::collections::BTreeSet;

use program::{ExitCode, Failure};

use crate::format::summary::{Manifest, ShardSummary};
use crate::format::{layout, seal};
use crate::store::{Listing, Sweep, file_name, size_in, size_problem};
use crate::write::card;
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
        self.committed(|_| ())
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

    /// Passes on the marker of every committed shard, in order; returns the indices of the others.
    fn committed(&self, mut take: impl FnMut(ShardSummary)) -> Result<Vec<u32>, Failure> {
        let listings = self.listings()?;
        let (mut missing, mut doubtful) = (Vec::new(), Vec::new());
        let mut next = 0;
        let names = (0..self.info.shard_count).map(layout::marker);
        self.storage.read_each(names, |marker| {
            let shard = next;
            next += 1;
            match marker.and_then(|bytes| self.summary(shard, bytes)) {
                Some(summary) => {
                    if !is_listed(&summary, &listings) {
                        doubtful.push(summary.clone());
                    }
                    take(summary);
                }
                None => missing.push(shard),
            }
        })?;
        if !doubtful.is_empty() {
            // They may have been committed after the listing.
            let listings = self.listings()?;
            doubtful.retain(|summary| !is_listed(summary, &listings));
            missing.extend(doubtful.iter().map(|summary| summary.shard));
            missing.sort_unstable();
        }
        Ok(missing)
    }

    fn listings(&self) -> Result<Vec<(Table, Listing)>, Failure> {
        Table::ALL.into_iter().map(|table| Ok((table, self.storage.must_list(table.name())?))).collect()
    }

    /// Writes `README.md`, `meta/manifest.json` and `_SUCCESS` if every shard exists. An existing card remains, because
    /// users may edit it. An existing manifest must be equal.
    ///
    /// # Errors
    /// [`Failure`] if the storage fails, or a different manifest exists.
    pub fn finalize(&self) -> Result<Finalized, Failure> {
        let mut shards = Vec::new();
        let missing = self.committed(|summary| shards.push(summary))?;
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
        if let Err(error) = self.sweep_folders(Sweep::Dead, false) {
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

/// Whether a shard's files are listed with the marker's sizes.
fn is_listed(summary: &ShardSummary, listings: &[(Table, Listing)]) -> bool {
    listings.iter().all(|(table, listing)| {
        let file = summary.file(*table);
        size_problem(file, size_in(listing, &file.path)).is_none()
    })
}
