//! Shards that only look committed: a marker, and empty files of the marker's sizes. They take no time to make, so that
//! completing, listing and opening datasets of a hundred thousand shards can be measured.

use std::fs::{self, File};
use std::io;
use std::path::Path;

use schema::{Outcome, Rule};

use crate::format::summary::{Counts, FileSummary, ShardSummary, Tally};
use crate::format::{layout, seal};
use crate::{DatasetInfo, Table};

/// Puts a shard that only looks committed into a dataset's folder. The files are sparse and take no space.
///
/// # Errors
/// If the disk fails.
pub fn pretend_shard(dir: &Path, info: &DatasetInfo, dataset_id: &str, shard: u32) -> io::Result<()> {
    let scenes = info.scenes_of(shard);
    let (scenes, attempts) =
        (scenes.end - scenes.start, scenes.map(|scene| u64::from(info.attempts_of_scene(scene))).sum::<u64>());
    let file = |table: Table, rows: u64, bytes_of_row: u64| FileSummary {
        path: layout::table_file(table, shard, info.shard_count),
        bytes: 4_000 + rows * bytes_of_row,
        rows,
        sha256: seal::sha256_hex(&shard.to_le_bytes()),
    };
    let summary = ShardSummary {
        dataset_id: dataset_id.to_owned(),
        shard,
        attempts: file(Table::Attempts, attempts, 56),
        scenes: file(Table::Scenes, scenes, 38_000),
        objects: file(Table::Objects, 4 * scenes, 40),
        counts: counts(scenes, attempts),
    };
    for table in Table::ALL {
        let file = summary.file(table);
        File::create(dir.join(&file.path))?.set_len(file.bytes)?;
    }
    fs::write(dir.join(layout::marker(shard)), seal::seal(&summary))
}

/// Consistent counts: a quarter is held, the rest collides on the way.
fn counts(scenes: u64, attempts: u64) -> Counts {
    let mut counts = Counts { scenes, objects: 4 * scenes, ..Counts::zero() };
    counts.labels = Tally { attempts, positives: attempts / 4 };
    counts.outcomes.insert(Outcome::Held.name().to_owned(), attempts / 4);
    counts.outcomes.insert(Outcome::PregraspCollision.name().to_owned(), attempts - attempts / 4);
    let rules = Rule::all();
    for (place, rule) in (0..).zip(rules.iter()) {
        let attempts = attempts / rules.len() as u64 + u64::from(place < attempts % rules.len() as u64);
        counts.rules.insert(rule.name().to_owned(), Tally { attempts, positives: attempts / 4 });
    }
    counts
}
