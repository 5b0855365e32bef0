//! Counts of a shard and of a dataset: the markers under `meta/shards/` and `meta/manifest.json`.

use std::collections::BTreeMap;

use schema::{AttemptRecord, Outcome, Rule, SceneRejections, SceneRows};
use serde::{Deserialize, Serialize};

use crate::{DatasetInfo, Table};

/// Maximum size of a file, so that sums over all shards do not overflow.
const FILE_BYTES_MAX: u64 = 1 << 44;

/// A saturating sum of untrusted numbers.
fn sum(numbers: impl IntoIterator<Item = u64>) -> u64 {
    numbers.into_iter().fold(0, u64::saturating_add)
}

/// A file of a shard.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileSummary {
    /// Path in the dataset's folder.
    pub path: String,
    /// Size in bytes.
    pub bytes: u64,
    /// Rows.
    pub rows: u64,
    /// SHA-256 in hex.
    pub sha256: String,
}

/// Attempts and how many of them held the object.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tally {
    /// Attempts.
    pub attempts: u64,
    /// Attempts with label 1.
    pub positives: u64,
}

impl Tally {
    /// Attempts with label 0.
    #[must_use]
    pub fn negatives(self) -> u64 {
        self.attempts.saturating_sub(self.positives)
    }

    /// Share of positives, 0 for no attempts.
    #[must_use]
    pub fn positive_share(self) -> f64 {
        if self.attempts == 0 { 0.0 } else { self.positives as f64 / self.attempts as f64 }
    }

    /// Counts one attempt.
    pub fn count(&mut self, attempt: &AttemptRecord) {
        self.attempts += 1;
        self.positives += u64::from(attempt.label());
    }

    fn add(&mut self, other: Self) {
        self.attempts = self.attempts.saturating_add(other.attempts);
        self.positives = self.positives.saturating_add(other.positives);
    }
}

/// Rejected scenes by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RejectionCounts {
    /// Did not come to rest in time.
    pub unsettled: u64,
    /// Every object fell off.
    pub empty: u64,
    /// The physics broke down.
    pub unstable: u64,
}

impl RejectionCounts {
    /// All rejected scenes.
    #[must_use]
    pub fn total(&self) -> u64 {
        sum([self.unsettled, self.empty, self.unstable])
    }

    fn add(&mut self, other: Self) {
        self.unsettled = self.unsettled.saturating_add(other.unsettled);
        self.empty = self.empty.saturating_add(other.empty);
        self.unstable = self.unstable.saturating_add(other.unstable);
    }

    /// Counts the scenes that were rejected before one.
    pub fn count(&mut self, rejections: SceneRejections) {
        self.unsettled += u64::from(rejections.unsettled);
        self.empty += u64::from(rejections.empty);
        self.unstable += u64::from(rejections.unstable);
    }
}

/// Counts of rows of a shard, or of all shards.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Counts {
    /// Scenes.
    pub scenes: u64,
    /// Objects.
    pub objects: u64,
    /// Attempts, and the positive ones.
    pub labels: Tally,
    /// Attempts by outcome; every outcome has an entry.
    pub outcomes: BTreeMap<String, u64>,
    /// Attempts by rule, and the positive ones; every rule has an entry.
    pub rules: BTreeMap<String, Tally>,
    /// Rejected scenes.
    pub rejections: RejectionCounts,
}

impl Counts {
    /// Empty counts.
    #[must_use]
    pub fn zero() -> Self {
        Self {
            scenes: 0,
            objects: 0,
            labels: Tally::default(),
            outcomes: Outcome::ALL.iter().map(|o| (o.name().to_owned(), 0)).collect(),
            rules: Rule::of_the_paper().iter().map(|r| (r.name().to_owned(), Tally::default())).collect(),
            rejections: RejectionCounts::default(),
        }
    }

    /// Attempts with an outcome.
    #[must_use]
    pub fn outcome(&self, outcome: Outcome) -> u64 {
        self.outcomes.get(outcome.name()).copied().unwrap_or_default()
    }

    /// Counts the rows of a scene.
    pub fn count(&mut self, rows: &SceneRows) {
        self.scenes += 1;
        self.objects += rows.objects.len() as u64;
        self.rejections.count(rows.scene.rejections);
        for attempt in &rows.attempts {
            self.labels.count(attempt);
            *self.outcomes.entry(attempt.outcome.name().to_owned()).or_default() += 1;
            self.rules.entry(attempt.rule.name().to_owned()).or_default().count(attempt);
        }
    }

    /// Adds the counts of other rows.
    pub fn add(&mut self, other: &Self) {
        self.scenes = self.scenes.saturating_add(other.scenes);
        self.objects = self.objects.saturating_add(other.objects);
        self.labels.add(other.labels);
        for (name, count) in &other.outcomes {
            let sum = self.outcomes.entry(name.clone()).or_default();
            *sum = sum.saturating_add(*count);
        }
        for (name, tally) in &other.rules {
            self.rules.entry(name.clone()).or_default().add(*tally);
        }
        self.rejections.add(other.rejections);
    }
}

/// A shard's marker, `meta/shards/00003.json`, written last: the shard exists iff its marker does.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShardSummary {
    /// The dataset: SHA-256 of its `meta/info.json`.
    pub dataset_id: String,
    /// The shard, from 0.
    pub shard: u32,
    /// Its file in each table.
    pub attempts: FileSummary,
    /// Its scenes.
    pub scenes: FileSummary,
    /// Its objects.
    pub objects: FileSummary,
    /// Its counts.
    pub counts: Counts,
}

impl ShardSummary {
    /// The shard's file of a table.
    #[must_use]
    pub fn file(&self, table: Table) -> &FileSummary {
        match table {
            Table::Attempts => &self.attempts,
            Table::Scenes => &self.scenes,
            Table::Objects => &self.objects,
        }
    }

    /// Contradictions to the dataset or within itself, one message each.
    #[must_use]
    pub fn problems(&self, info: &DatasetInfo, dataset_id: &str) -> Vec<String> {
        let mut problems = Vec::new();
        let mut must_be = |name: &str, expected: String, got: String| {
            if expected != got {
                problems.push(format!("{name} must be {expected}, got {got}"));
            }
        };
        must_be("dataset_id", dataset_id.to_owned(), self.dataset_id.clone());
        if self.shard >= info.shard_count {
            must_be("shard", format!("below {}", info.shard_count), self.shard.to_string());
            return problems;
        }
        for table in Table::ALL {
            let path = crate::format::layout::table_file(table, self.shard, info.shard_count);
            must_be("path", path, self.file(table).path.clone());
        }
        let scenes = info.scenes_of(self.shard);
        let attempts = info.attempts_before(scenes.end) - info.attempts_before(scenes.start);
        let count = scenes.end - scenes.start;
        for (name, expected, got) in [
            ("rows of scenes", count, self.scenes.rows),
            ("rows of attempts", attempts, self.attempts.rows),
            ("scenes", self.scenes.rows, self.counts.scenes),
            ("objects", self.objects.rows, self.counts.objects),
            ("attempts", self.attempts.rows, self.counts.labels.attempts),
            ("sum of outcomes", self.attempts.rows, sum(self.counts.outcomes.values().copied())),
            ("sum of rules", self.attempts.rows, sum(self.counts.rules.values().map(|t| t.attempts))),
            ("positives", self.counts.outcome(Outcome::Held), self.counts.labels.positives),
        ] {
            must_be(name, expected.to_string(), got.to_string());
        }
        for FileSummary { path, bytes, rows, .. } in Table::ALL.map(|table| self.file(table)) {
            if *bytes > FILE_BYTES_MAX {
                problems.push(format!("bytes of {path} must be at most {FILE_BYTES_MAX}, got {bytes}"));
            }
            // A row takes at least one byte; a file with more rows than bytes could decompress to any size.
            if rows > bytes {
                problems.push(format!("rows of {path} must be at most its {bytes} bytes, got {rows}"));
            }
        }
        problems
    }
}

/// The manifest, `meta/manifest.json`: every marker in order, and their sum. It exists iff the dataset is complete.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Version of the format.
    pub format_version: u32,
    /// The dataset: SHA-256 of its `meta/info.json`.
    pub dataset_id: String,
    /// Sum over all shards.
    pub totals: Counts,
    /// Every shard, in order.
    pub shards: Vec<ShardSummary>,
}

impl Manifest {
    /// The manifest of these shards.
    #[must_use]
    pub fn new(info: &DatasetInfo, dataset_id: String, shards: Vec<ShardSummary>) -> Self {
        let totals = totals(&shards);
        Self { format_version: info.format_version, dataset_id, totals, shards }
    }

    /// Bytes of a table over all shards.
    #[must_use]
    pub fn bytes(&self, table: Table) -> u64 {
        sum(self.shards.iter().map(|s| s.file(table).bytes))
    }

    /// Contradictions to the dataset or within itself, one message each.
    #[must_use]
    pub fn problems(&self, info: &DatasetInfo, dataset_id: &str) -> Vec<String> {
        let mut problems = Vec::new();
        if self.dataset_id != dataset_id {
            problems.push(format!(
                "dataset_id must be {dataset_id}, the SHA-256 of meta/info.json, got {}; one of the two was edited",
                self.dataset_id
            ));
            return problems;
        }
        if self.format_version != info.format_version {
            problems.push("format_version must be that of meta/info.json".to_owned());
        }
        if !self.shards.iter().map(|s| s.shard).eq(0..info.shard_count) {
            problems.push(format!("shards must be 0 to {} in order", info.shard_count - 1));
            return problems;
        }
        for shard in &self.shards {
            problems
                .extend(shard.problems(info, dataset_id).into_iter().map(|p| format!("shard {}: {p}", shard.shard)));
        }
        if totals(&self.shards) != self.totals {
            problems.push("totals must be the sum of the shards".to_owned());
        }
        problems
    }
}

fn totals(shards: &[ShardSummary]) -> Counts {
    shards.iter().fold(Counts::zero(), |mut sum, shard| {
        sum.add(&shard.counts);
        sum
    })
}
