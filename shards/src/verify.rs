//! Checking all of a dataset: every byte, every row, every key, and that nothing lies beside it which a glob would
//! take for data.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use schema::{AttemptRecord, ObjectRecord, SceneRecord, SceneRows};

use crate::check;
use crate::store::is_staging;
use crate::summary::{Counts, ShardSummary};
use crate::{Dataset, ReadError, Table, layout, seal};

/// What was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Verified {
    /// Rows that were read and found right.
    pub counts: Counts,
    /// Bytes of all tables.
    pub bytes: u64,
    /// What is wrong, in the order of shards; at most [`PROBLEMS_MAX`].
    pub problems: Vec<String>,
    /// Problems beyond these.
    pub more: u64,
}

impl Verified {
    /// Whether nothing is wrong.
    #[must_use]
    pub fn is_ok(&self) -> bool {
        self.problems.is_empty()
    }
}

/// Most problems that are told; the rest is counted.
pub const PROBLEMS_MAX: usize = 50;

/// Reads everything and compares it with everything else. `progress` hears of each finished shard.
///
/// # Errors
/// [`ReadError`] if there is no complete dataset, or its info or manifest is damaged, so that nothing else can be told.
pub fn verify(dir: &Path, mut progress: impl FnMut(u32)) -> Result<Verified, ReadError> {
    let dataset = Dataset::open_with_any_files(dir)?;
    let bytes = Table::ALL.into_iter().map(|table| dataset.manifest().bytes(table)).sum();
    let mut found = Verified { counts: Counts::zero(), bytes, problems: Vec::new(), more: 0 };
    for table in Table::ALL {
        found.tell(strangers(&dataset, table));
    }
    for shard in 0..dataset.shard_count() {
        found.tell(marker(&dataset, shard).err());
        if let Some(counts) = rows(&dataset, shard, &mut found) {
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

    fn keep<T>(&mut self, result: Result<T, ReadError>) -> Option<T> {
        result.map_err(|e| self.tell([e.to_string()])).ok()
    }
}

/// Files in a table's folder that the manifest does not know.
fn strangers(dataset: &Dataset, table: Table) -> Vec<String> {
    let folder = dataset.dir().join(table.name());
    let Ok(entries) = fs::read_dir(&folder) else { return Vec::new() }; // missing files are told shard by shard
    let shards = dataset.manifest().shards.iter();
    let known: Vec<&str> = shards.map(|s| s.file(table).path.as_str()).collect();
    let mut strangers: Vec<String> = entries
        .flatten()
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .filter(|name| !is_staging(name) && !known.contains(&format!("{}/{name}", table.name()).as_str()))
        .map(|name| format!("{}/{name} is not in the manifest, and readers may take it for data", table.name()))
        .collect();
    strangers.sort();
    strangers
}

/// The marker must be there and say what the manifest says.
fn marker(dataset: &Dataset, shard: u32) -> Result<(), String> {
    let name = layout::marker(shard);
    let wrong = |message: String| format!("shard {shard}: {message}: {}", dataset.dir().join(&name).display());
    let bytes = dataset.read_meta(&name).map_err(|e| e.to_string())?;
    let bytes = bytes.ok_or_else(|| wrong("the marker is missing".to_owned()))?;
    let marker: ShardSummary = seal::unseal(&String::from_utf8_lossy(&bytes)).map_err(|e| wrong(e.to_string()))?;
    if marker == dataset.manifest().shards[shard as usize] {
        Ok(())
    } else {
        Err(wrong("the marker must say what the manifest says".to_owned()))
    }
}

/// Reads a shard's three tables, each by itself, then one with another. What was counted, unless a table is damaged.
fn rows(dataset: &Dataset, shard: u32, found: &mut Verified) -> Option<Counts> {
    let attempts = found.keep(dataset.read_attempts(shard));
    let objects = found.keep(dataset.read_objects(shard));
    let scenes = dataset.scenes(shard).and_then(|scenes| {
        scenes.map(|scene| scene.map(|scene| SceneRecord { tsdf: Vec::new(), ..scene })).collect::<Result<Vec<_>, _>>()
    });
    let scenes = found.keep(scenes);
    let (Some(attempts), Some(objects), Some(scenes)) = (attempts, objects, scenes) else { return None };
    let counts = link(shard, scenes, objects, attempts, found);
    if counts != dataset.manifest().shards[shard as usize].counts {
        found.tell([format!("shard {shard}: the counts of the manifest must be those of the rows")]);
    }
    Some(counts)
}

/// Follows the keys among the tables of a shard, and counts.
fn link(
    shard: u32,
    scenes: Vec<SceneRecord>,
    objects: Vec<ObjectRecord>,
    attempts: Vec<AttemptRecord>,
    found: &mut Verified,
) -> Counts {
    let mut objects_of: BTreeMap<u64, Vec<ObjectRecord>> = BTreeMap::new();
    for object in objects {
        objects_of.entry(object.scene_id).or_default().push(object);
    }
    let mut attempts_of: BTreeMap<u64, Vec<AttemptRecord>> = BTreeMap::new();
    for attempt in attempts {
        attempts_of.entry(attempt.scene_id).or_default().push(attempt);
    }
    let mut counts = Counts::zero();
    for scene in scenes {
        let id = scene.scene_id;
        let rows = SceneRows {
            objects: objects_of.remove(&id).unwrap_or_default(),
            attempts: attempts_of.remove(&id).unwrap_or_default(),
            scene,
        };
        if let Err(e) = check::links(&rows.scene, &rows.objects, &rows.attempts) {
            found.tell([format!("shard {shard}, scene {id}: {e}")]);
        }
        counts.count(&rows);
    }
    counts
}
