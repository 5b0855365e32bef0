//! Checks a complete dataset: every checksum, every row, every key, and that there are no other files which a glob
//! would read as data.

use std::collections::BTreeSet;

use program::{ExitCode, Failure};
use schema::SceneRows;

use crate::format::summary::{Counts, ShardSummary};
use crate::format::{check, layout, seal};
use crate::store::is_staging;
use crate::{Dataset, Location, Table};

/// The result of a check.
#[derive(Debug, Clone, PartialEq)]
pub struct Verified {
    /// Rows that were read and are valid.
    pub counts: Counts,
    /// Bytes of all tables.
    pub bytes: u64,
    /// Problems, in the order of shards; at most [`PROBLEMS_MAX`].
    pub problems: Vec<String>,
    /// Number of further problems.
    pub more: u64,
    /// Exit codes of the problems that are failed reads, which do not show a fault of the dataset.
    pub unread: Vec<ExitCode>,
    /// Whether the store supports listing. Web servers do not, so other files were not searched there.
    pub listed: bool,
}

impl Verified {
    /// Whether there are no problems.
    #[must_use]
    pub fn is_ok(&self) -> bool {
        self.problems.is_empty()
    }

    /// [`ExitCode::Data`] if the dataset has a fault. If all problems are failed reads, [`ExitCode::Config`] where a
    /// right is missing or something else than a file is in the way, otherwise [`ExitCode::TryAgain`].
    #[must_use]
    pub fn exit_code(&self) -> ExitCode {
        match self.problems.len() as u64 + self.more {
            0 => ExitCode::Ok,
            problems if problems > self.unread.len() as u64 => ExitCode::Data,
            _ => self.unread.iter().max().copied().unwrap_or(ExitCode::TryAgain),
        }
    }
}

/// Maximum number of reported problems; further ones are counted.
pub const PROBLEMS_MAX: usize = 50;

/// Reads and cross-checks the whole dataset. `progress` is called for each finished shard.
///
/// # Errors
/// [`Failure`] if there is no complete dataset, or its info or manifest is damaged, so that nothing else can be
/// checked; also if an object store stops answering.
pub fn verify(at: impl Into<Location>, mut progress: impl FnMut(u32)) -> Result<Verified, Failure> {
    let dataset = Dataset::open_with_any_files(&at.into())?;
    let bytes = Table::ALL.into_iter().map(|table| dataset.manifest().bytes(table)).sum();
    let mut found =
        Verified { counts: Counts::zero(), bytes, problems: Vec::new(), more: 0, unread: Vec::new(), listed: true };
    for table in Table::ALL {
        match found.keep(&dataset, strangers(&dataset, table))? {
            Some(None) => found.listed = false,
            strangers => found.tell(strangers.flatten().unwrap_or_default()),
        }
    }
    for shard in 0..dataset.shard_count() {
        let marker = found.keep(&dataset, marker(&dataset, shard))?;
        found.tell(marker.flatten());
        if let Some(counts) = rows(&dataset, shard, &mut found)? {
            found.counts.add(&counts);
        }
        progress(shard);
    }
    Ok(found)
}

impl Verified {
    fn tell(&mut self, problems: impl IntoIterator<Item = String>) {
        for problem in problems {
            if self.problems.len() < PROBLEMS_MAX {
                self.problems.push(problem);
            } else {
                self.more += 1;
            }
        }
    }

    /// Records a problem and continues; but errors that would repeat for every file of an object store (refused access,
    /// a full scratch folder) end the check.
    fn keep<T>(&mut self, dataset: &Dataset, result: Result<T, Failure>) -> Result<Option<T>, Failure> {
        match result {
            Err(error) if is_of_store(dataset, &error) => Err(error),
            Err(error) => {
                let code = error.exit_code();
                self.unread.extend([ExitCode::TryAgain, ExitCode::Config].contains(&code).then_some(code));
                self.tell([error.to_string()]);
                Ok(None)
            }
            Ok(value) => Ok(Some(value)),
        }
    }
}

/// Whether an object store failed, which it would for every file; what is wrong with a file has another code.
fn is_of_store(dataset: &Dataset, error: &Failure) -> bool {
    matches!(dataset.location(), Location::Url(_)) && error.exit_code() != ExitCode::Data
}

/// Files in a table's folder that are not in the manifest; `None` if the store does not support listing.
fn strangers(dataset: &Dataset, table: Table) -> Result<Option<Vec<String>>, Failure> {
    // Missing files are reported by shard.
    let Some(listing) = dataset.storage.list(table.name())? else { return Ok(None) };
    let shards = dataset.manifest().shards.iter();
    let known: BTreeSet<&str> = shards.map(|s| s.file(table).path.as_str()).collect();
    let names = listing.into_keys().filter(|name| !is_staging(name)).map(|name| format!("{}/{name}", table.name()));
    let strangers = names.filter(|name| !known.contains(name.as_str()));
    let told = strangers.map(|name| format!("{name} is not in the manifest, and readers may take it for data"));
    Ok(Some(told.collect()))
}

/// The problem of a marker, which must exist and agree with the manifest.
fn marker(dataset: &Dataset, shard: u32) -> Result<Option<String>, Failure> {
    let name = layout::marker(shard);
    let at = dataset.location().join(&name);
    let wrong = |message: &str| Ok(Some(format!("shard {shard}: {message}: {at}")));
    let Some(bytes) = dataset.storage.read(&name)? else { return wrong("the marker is missing") };
    match seal::unseal::<ShardSummary>(bytes) {
        Err(e) => wrong(&e),
        Ok(marker) if marker == dataset.manifest().shards[shard as usize] => Ok(None),
        Ok(_) => wrong("the marker must say what the manifest says"),
    }
}

/// Reads a shard's three tables together or, if one is damaged, each alone. Returns the counts, unless a table is
/// damaged.
fn rows(dataset: &Dataset, shard: u32, found: &mut Verified) -> Result<Option<Counts>, Failure> {
    let mut counts = Counts::zero();
    let mut problems = Vec::new();
    let mut count = |rows: Result<SceneRows, Failure>| {
        let rows = rows?;
        if let Err(e) = check::joined(&rows) {
            problems.push(format!("shard {shard}, scene {}: {e}", rows.scene.scene_id));
        }
        counts.count(&rows);
        Ok::<(), Failure>(())
    };
    let together = dataset.scenes(shard).and_then(|scenes| dataset.joined(shard, scenes)?.try_for_each(&mut count));
    if let Err(error) = together {
        if is_of_store(dataset, &error) {
            return Err(error); // which the store would repeat
        }
        let attempts = dataset.attempts(shard).and_then(|mut rows| rows.try_for_each(|row| row.map(drop)));
        let objects = dataset.objects(shard).and_then(|mut rows| rows.try_for_each(|row| row.map(drop)));
        let scenes = dataset.scenes(shard).and_then(|mut rows| rows.try_for_each(|row| row.map(drop)));
        let mut is_found = false;
        for table in [attempts, objects, scenes] {
            is_found |= found.keep(dataset, table)?.is_none();
        }
        if !is_found {
            // A read that failed once must not pass for a sound table.
            found.keep(dataset, Err::<(), _>(error))?;
        }
        return Ok(None);
    }
    found.tell(problems);
    if counts != dataset.manifest().shards[shard as usize].counts {
        found.tell([format!("shard {shard}: the counts of the manifest must be those of the rows")]);
    }
    Ok(Some(counts))
}
