//! Checks a complete dataset: every checksum, every row, every key, and that there are no other files which a glob
//! would read as data.

use std::collections::BTreeSet;

use program::{ExitCode, Failure};

use crate::format::summary::{Counts, ShardSummary};
use crate::format::{layout, seal};
use crate::store::{Patience, Storage, is_staging};
use crate::{Dataset, Location, Table};

/// The result of a check.
#[derive(Debug, Clone, PartialEq)]
pub struct Verified {
    /// Rows that were read and are valid.
    pub counts: Counts,
    /// Bytes of all tables.
    pub bytes: u64,
    /// Problems, in the order of shards; of a shard's rows the first.
    pub problems: Vec<String>,
    /// [`ExitCode::Data`] if the dataset has a fault. If all problems are failed reads, which do not show one,
    /// [`ExitCode::Config`] where a right is missing or something else than a file is in the way, otherwise
    /// [`ExitCode::TryAgain`].
    pub exit_code: ExitCode,
    /// Whether the store supports listing. Web servers do not, so other files were not searched there.
    pub listed: bool,
}

/// Reads and cross-checks the whole dataset. `progress` is called for each finished shard.
///
/// # Errors
/// [`Failure`] if there is no complete dataset, or its info or manifest is damaged, so that nothing else can be
/// checked; also if an object store stops answering.
pub fn verify(at: impl Into<Location>, mut progress: impl FnMut(u32)) -> Result<Verified, Failure> {
    let dataset = Dataset::of_storage(Storage::open(&at.into(), Patience::Reader)?)?;
    let bytes = Table::ALL.into_iter().map(|table| dataset.manifest().bytes(table)).sum();
    let (counts, exit_code) = (Counts::zero(), ExitCode::Ok);
    let mut found = Verified { counts, bytes, problems: Vec::new(), exit_code, listed: true };
    for table in Table::ALL {
        match found.keep(&dataset, strangers(&dataset, table))? {
            Some(None) => found.listed = false,
            strangers => {
                let told = |name| format!("{name} is not in the manifest, and readers may take it for data");
                strangers.flatten().into_iter().flatten().for_each(|name| found.tell(ExitCode::Data, told(name)));
            }
        }
    }
    for shard in 0..dataset.shard_count() {
        found.keep(&dataset, marker(&dataset, shard))?;
        if let Some(counts) = found.keep(&dataset, rows(&dataset, shard))? {
            if counts != dataset.manifest().shards[shard as usize].counts {
                let text = format!("shard {shard}: the counts of the manifest must be those of the rows");
                found.tell(ExitCode::Data, text);
            }
            found.counts.add(&counts);
        }
        progress(shard);
    }
    Ok(found)
}

impl Verified {
    /// Whether there are no problems.
    #[must_use]
    pub fn is_ok(&self) -> bool {
        self.problems.is_empty()
    }

    fn tell(&mut self, code: ExitCode, problem: String) {
        let is_damaged = [self.exit_code, code].contains(&ExitCode::Data);
        self.exit_code = if is_damaged { ExitCode::Data } else { self.exit_code.max(code) };
        self.problems.push(problem);
    }

    /// Records a problem and continues; but errors that would repeat for every file of an object store (refused access,
    /// a full scratch folder) end the check.
    fn keep<T>(&mut self, dataset: &Dataset, result: Result<T, Failure>) -> Result<Option<T>, Failure> {
        match result {
            Err(error) if matches!(dataset.location(), Location::Url(_)) && error.exit_code() != ExitCode::Data => {
                Err(error)
            }
            Err(error) => {
                self.tell(error.exit_code(), error.to_string());
                Ok(None)
            }
            Ok(value) => Ok(Some(value)),
        }
    }
}

/// Files in a table's folder that are not in the manifest; `None` if the store does not support listing.
fn strangers(dataset: &Dataset, table: Table) -> Result<Option<Vec<String>>, Failure> {
    // Missing files are reported by shard.
    let Some(listing) = dataset.storage.list(table.name())? else { return Ok(None) };
    let shards = dataset.manifest().shards.iter();
    let known: BTreeSet<&str> = shards.map(|s| s.file(table).path.as_str()).collect();
    let names = listing.into_keys().filter(|name| !is_staging(name)).map(|name| format!("{}/{name}", table.name()));
    Ok(Some(names.filter(|name| !known.contains(name.as_str())).collect()))
}

/// Compares a marker, which must exist, with the manifest.
fn marker(dataset: &Dataset, shard: u32) -> Result<(), Failure> {
    let name = layout::marker(shard);
    let at = dataset.location().join(&name);
    let wrong = |message: &str| Failure::new(ExitCode::Data, format!("shard {shard}: {message}: {at}"));
    let bytes = dataset.storage.read(&name)?.ok_or_else(|| wrong("the marker is missing"))?;
    let marker: ShardSummary = seal::unseal(bytes).map_err(|e| wrong(&e))?;
    let is_equal = marker == dataset.manifest().shards[shard as usize];
    if is_equal { Ok(()) } else { Err(wrong("the marker must say what the manifest says")) }
}

/// Reads a shard's three tables together, and counts their rows.
fn rows(dataset: &Dataset, shard: u32) -> Result<Counts, Failure> {
    let mut counts = Counts::zero();
    for rows in dataset.rows(shard, true)? {
        counts.count(&rows?);
    }
    Ok(counts)
}
