//! What a dataset holds, in numbers: computed from its rows in one pass, never from what the manifest says.

mod bins;
mod warnings;

pub use bins::Bin;

use std::collections::BTreeMap;

use program::Failure;
use schema::{AttemptRecord, HitKind, ObjectRecord, Outcome, Rule, SceneRows, Shape, Vec3};
use serde::Serialize;
use shards::{Dataset, RejectionCounts, Table, Tally};

use self::bins::{bin, bins};

/// The statistics of a dataset.
#[derive(Debug, Clone, PartialEq, Serialize)]
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
    /// Opening of the hand in metres, of attempts that closed it.
    pub width_m: Vec<Bin>,
    /// Angle between the grasp's approach and straight down, in degrees.
    pub approach_deg: Vec<Bin>,
    /// From the target's centre to the nearest other object's, in metres; attempts on lone objects count in the last
    /// bar.
    pub neighbour_m: Vec<Bin>,
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
    pub outcome: String,
    /// Attempts.
    pub attempts: u64,
    /// What was hit, for outcomes that hit something.
    pub hits: BTreeMap<String, u64>,
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
    /// Bytes over scenes.
    pub bytes_per_scene: f64,
    /// Bytes over attempts.
    pub bytes_per_attempt: f64,
}

/// Bars of the widths' histogram, from 0 to the hand's opening.
const WIDTH_BINS: usize = 8;
/// Degrees of a bar of the angles' histogram; twelve bars make 180°.
const ANGLE_BIN_DEG: f64 = 15.0;
/// Metres of a bar of the neighbours' histogram; the last of nine holds what is further, and lone objects.
const NEIGHBOUR_BIN_M: f64 = 0.02;

/// Reads all attempts and scene heads of a dataset and counts them.
///
/// # Errors
/// [`Failure`] if a shard is damaged.
pub fn report(dataset: &Dataset) -> Result<Report, Failure> {
    let mut counting = Counting::new(dataset);
    for shard in 0..dataset.shard_count() {
        for rows in dataset.rows(shard, false)? {
            counting.count_scene(&rows?);
        }
    }
    Ok(counting.finish())
}

struct Counting<'a> {
    dataset: &'a Dataset,
    labels: Tally,
    shapes: BTreeMap<Shape, Tally>,
    rules: BTreeMap<Rule, Tally>,
    object_counts: BTreeMap<u32, Tally>,
    outcomes: BTreeMap<Outcome, (u64, BTreeMap<HitKind, u64>)>,
    widths: [Tally; WIDTH_BINS],
    angles: [Tally; 12],
    neighbours: [Tally; 9],
    outside_grid: Tally,
    rejections: RejectionCounts,
}

impl<'a> Counting<'a> {
    fn new(dataset: &'a Dataset) -> Self {
        let models = &dataset.info().models;
        let rules = if models.is_empty() { Rule::of_the_paper().to_vec() } else { Vec::new() };
        Self {
            dataset,
            labels: Tally::default(),
            shapes: Shape::all(models).into_iter().map(|shape| (shape, Tally::default())).collect(),
            rules: rules.into_iter().map(|rule| (rule, Tally::default())).collect(),
            object_counts: BTreeMap::new(),
            outcomes: Outcome::ALL.into_iter().map(|outcome| (outcome, Default::default())).collect(),
            widths: Default::default(),
            angles: Default::default(),
            neighbours: Default::default(),
            outside_grid: Tally::default(),
            rejections: RejectionCounts::default(),
        }
    }

    fn count_scene(&mut self, rows: &SceneRows) {
        self.rejections.count(rows.scene.rejections);
        for attempt in &rows.attempts {
            self.object_counts.entry(rows.scene.object_count).or_default().count(attempt);
            self.count(attempt);
            self.count_neighbour(attempt, &rows.objects);
        }
    }

    fn count(&mut self, attempt: &AttemptRecord) {
        self.labels.count(attempt);
        self.shapes.entry(attempt.rule.shape).or_default().count(attempt);
        self.rules.entry(attempt.rule.named()).or_default().count(attempt);
        let (count, hits) = self.outcomes.entry(attempt.outcome).or_default();
        *count += 1;
        if let Some(hit) = attempt.hit {
            *hits.entry(hit).or_default() += 1;
        }
        let info = self.dataset.info();
        if let Some(width_m) = attempt.width_m {
            let share = width_m / info.opening_m_max();
            self.widths[bin(f64::from(share) * WIDTH_BINS as f64, WIDTH_BINS)].count(attempt);
        }
        self.angles[bin(approach_angle_deg(attempt) / ANGLE_BIN_DEG, self.angles.len())].count(attempt);
        if info.grid.voxel_at(attempt.workspace_from_grasp.translation).is_none() {
            self.outside_grid.count(attempt);
        }
    }

    /// Counts what takes the target's neighbours to know.
    fn count_neighbour(&mut self, attempt: &AttemptRecord, objects: &[ObjectRecord]) {
        let Some(target) = objects.get(attempt.object_id as usize) else { return };
        let centre = |object: &ObjectRecord| object.workspace_from_object.translation;
        let others = objects.iter().filter(|object| object.object_id != attempt.object_id);
        let nearest_m = others.map(|other| (centre(other) - centre(target)).length()).fold(f32::INFINITY, f32::min);
        self.neighbours[bin(f64::from(nearest_m) / NEIGHBOUR_BIN_M, self.neighbours.len())].count(attempt);
    }

    fn finish(self) -> Report {
        let (info, manifest) = (self.dataset.info(), self.dataset.manifest());
        let width_step = f64::from(info.opening_m_max()) / WIDTH_BINS as f64;
        let shapes = self.shapes.into_iter().map(|(shape, tally)| group(shape.name(&info.models), tally));
        let outcomes = self.outcomes.into_iter().map(|(outcome, (attempts, hits))| OutcomeGroup {
            outcome: outcome.name().to_owned(),
            attempts,
            hits: hits.into_iter().map(|(hit, count)| (hit.name().to_owned(), count)).collect(),
        });
        Report {
            dataset_id: manifest.dataset_id.clone(),
            code_version: info.code_version.clone(),
            seed: info.seed,
            shards: info.shard_count,
            scenes: info.scene_count,
            objects: manifest.totals.objects,
            labels: self.labels,
            shapes: shapes.collect(),
            rules: self.rules.into_iter().map(|(rule, tally)| group(rule.name(), tally)).collect(),
            object_counts: self.object_counts.into_iter().map(|(count, t)| group(&count.to_string(), t)).collect(),
            outcomes: outcomes.collect(),
            width_m: bins(&self.widths, width_step),
            approach_deg: bins(&self.angles, ANGLE_BIN_DEG),
            neighbour_m: bins(&self.neighbours, NEIGHBOUR_BIN_M),
            outside_grid: self.outside_grid,
            rejections: self.rejections,
            tables: Table::ALL.map(|table| size(self.dataset, table)).to_vec(),
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
        bytes_per_scene: bytes as f64 / dataset.info().scene_count as f64,
        bytes_per_attempt: bytes as f64 / dataset.info().attempt_count as f64,
    }
}
