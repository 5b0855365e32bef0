//! What a dataset holds, in numbers: computed from its rows in one pass, never from what the manifest says.

mod bins;

use std::collections::BTreeMap;

use program::Failure;
use schema::{AttemptRecord, HitKind, Outcome, Rule, Shape, Vec3};
use serde::Serialize;
use shards::{Dataset, DatasetInfo, RejectionCounts, Table, Tally};

pub use self::bins::Bin;
use self::bins::{bar, bars};

/// The statistics of a dataset.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Report {
    /// SHA-256 of `meta/info.json`.
    pub dataset_id: String,
    /// Version of the code that made it.
    pub code_version: String,
    /// Seed.
    pub seed: u64,
    /// Shards.
    pub shards: u32,
    /// Scenes.
    pub scenes: u64,
    /// Objects.
    pub objects: u64,
    /// All attempts.
    pub labels: Tally,
    /// By shape of the target, or by its model.
    pub shapes: Vec<Group>,
    /// By row of Appendix A.
    pub rules: Vec<Group>,
    /// By number of objects in the scene.
    pub object_counts: Vec<Group>,
    /// How attempts ended.
    pub outcomes: Vec<OutcomeGroup>,
    /// Opening of the gripper in metres, of attempts that closed it.
    pub width_m: Vec<Bin>,
    /// Angle between the grasp's approach and straight down, in degrees.
    pub approach_deg: Vec<Bin>,
    /// Attempts whose grasp lies outside the grid; no voxel can learn from them.
    pub outside_grid: Tally,
    /// Scenes thrown away.
    pub rejections: RejectionCounts,
    /// Size on disk.
    pub tables: Vec<TableSize>,
}

/// Attempts that share something.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Group {
    /// What they share.
    pub name: String,
    /// How many they are.
    #[serde(flatten)]
    pub labels: Tally,
}

/// Attempts with an outcome.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OutcomeGroup {
    /// The outcome.
    pub outcome: Outcome,
    /// Attempts.
    pub attempts: u64,
    /// What was hit, for outcomes that hit something.
    pub hits: BTreeMap<HitKind, u64>,
}

/// A table's size on disk.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TableSize {
    /// The table.
    pub table: String,
    /// Rows.
    pub rows: u64,
    /// Bytes.
    pub bytes: u64,
    /// Bytes over attempts.
    pub bytes_per_attempt: f64,
}

/// Bars of the widths' histogram, from 0 to the gripper's opening.
const WIDTH_BINS: usize = 8;
/// Degrees of a bar of the angles' histogram; twelve bars make 180°.
const ANGLE_BIN_DEG: f64 = 15.0;

/// Reads all attempts and scene heads of a dataset and counts them.
///
/// # Errors
/// [`Failure`] if a shard is damaged.
pub fn report(dataset: &Dataset) -> Result<Report, Failure> {
    let mut report = nothing(dataset);
    let models = &dataset.info().models;
    let paper = if models.is_empty() { Rule::of_the_paper().to_vec() } else { Vec::new() };
    let mut rules: BTreeMap<Rule, Tally> = paper.into_iter().map(|rule| (rule, Tally::default())).collect();
    let mut shapes: BTreeMap<Shape, Tally> =
        Shape::all(models).into_iter().map(|shape| (shape, Tally::default())).collect();
    let mut object_counts: BTreeMap<u32, Tally> = BTreeMap::new();
    for shard in 0..dataset.shard_count() {
        for rows in dataset.rows(shard, false)? {
            let rows = rows?;
            report.rejections.count(rows.scene.rejections);
            for attempt in &rows.attempts {
                shapes.entry(attempt.rule.shape).or_default().count(attempt);
                rules.entry(attempt.rule.named()).or_default().count(attempt);
                object_counts.entry(rows.scene.object_count).or_default().count(attempt);
                report.count(dataset.info(), attempt);
            }
        }
    }
    report.shapes = shapes.into_iter().map(|(shape, labels)| group(shape.name(models), labels)).collect();
    report.rules = rules.into_iter().map(|(rule, labels)| group(rule.name(), labels)).collect();
    report.object_counts = object_counts.into_iter().map(|(count, labels)| group(&count.to_string(), labels)).collect();
    Ok(report)
}

/// What is known before an attempt is counted.
fn nothing(dataset: &Dataset) -> Report {
    let (info, manifest) = (dataset.info(), dataset.manifest());
    Report {
        dataset_id: manifest.dataset_id.clone(),
        code_version: info.code_version.clone(),
        seed: info.seed,
        shards: info.shard_count,
        scenes: info.scene_count,
        objects: manifest.totals.objects,
        outcomes: Outcome::ALL.map(|outcome| OutcomeGroup { outcome, attempts: 0, hits: BTreeMap::new() }).into(),
        width_m: bars(WIDTH_BINS, f64::from(info.opening_m_max()) / WIDTH_BINS as f64),
        approach_deg: bars(12, ANGLE_BIN_DEG),
        tables: Table::ALL.map(|table| size(dataset, table)).into(),
        ..Report::default()
    }
}

impl Report {
    /// Counts an attempt on one of these objects.
    fn count(&mut self, info: &DatasetInfo, attempt: &AttemptRecord) {
        self.labels.count(attempt);
        let outcome = &mut self.outcomes[attempt.outcome as usize];
        outcome.attempts += 1;
        if let Some(hit) = attempt.hit {
            *outcome.hits.entry(hit).or_default() += 1;
        }
        if let Some(width_m) = attempt.width_m {
            let share = width_m / info.opening_m_max();
            bar(&mut self.width_m, f64::from(share) * WIDTH_BINS as f64).count(attempt);
        }
        bar(&mut self.approach_deg, approach_angle_deg(attempt) / ANGLE_BIN_DEG).count(attempt);
        if info.grid.voxel_at(attempt.workspace_from_grasp.translation).is_none() {
            self.outside_grid.count(attempt);
        }
    }
}

/// Angle between the grasp's +z and straight down, in degrees.
fn approach_angle_deg(attempt: &AttemptRecord) -> f64 {
    let approach = attempt.workspace_from_grasp.rotation * Vec3::Z;
    libm::acos(f64::from(-approach.z).clamp(-1.0, 1.0)).to_degrees()
}

fn group(name: &str, labels: Tally) -> Group {
    Group { name: name.to_owned(), labels }
}

fn size(dataset: &Dataset, table: Table) -> TableSize {
    let bytes = dataset.manifest().bytes(table);
    TableSize {
        table: table.name().to_owned(),
        rows: dataset.manifest().shards.iter().map(|s| s.file(table).rows).sum(),
        bytes,
        bytes_per_attempt: bytes as f64 / dataset.info().attempt_count as f64,
    }
}
