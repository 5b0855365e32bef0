//! The report as a document: what a terminal shows, and what a page shows besides.

use program::text::{bytes, grouped, percent, ratio};
use report::document::{Block, Cell, Document, Table};
use serde_json::Value;
use shards::{Dataset, DatasetInfo, Tally};

use crate::statistics::{Bin, Group, Report};

impl Report {
    /// The report, for a terminal.
    #[must_use]
    pub fn document(&self, info: &DatasetInfo) -> Document {
        let mut blocks = vec![Block::Text(lead(self, info)), Block::Tiles(tiles(self))];
        let sections = [outcomes(self), positives(self), sizes(self)];
        for (title, text, shown) in sections {
            blocks.extend([Block::Heading(title.to_owned()), Block::Text(text)]);
            blocks.extend(shown);
        }
        let footer = format!(
            "graspmill dataset report --html, Graspmill {}; dataset {}",
            env!("CARGO_PKG_VERSION"),
            self.dataset_id
        );
        Document { title: "Grasp attempts in simulation".to_owned(), blocks, footer }
    }

    /// The report as a page shows it: with the dataset's origin last.
    #[must_use]
    pub fn page(&self, dataset: &Dataset) -> Document {
        let info = dataset.info();
        let mut page = self.document(info);
        page.title = format!("{}: {} grasp attempts", dataset.location().name(), grouped(self.labels.attempts));
        let text = "From meta/info.json, which is shown here, the dataset can be made again, byte for byte.";
        page.blocks.extend([Block::Heading("Provenance".to_owned()), Block::Text(text.to_owned()), provenance(info)]);
        page
    }
}

fn lead(report: &Report, info: &DatasetInfo) -> String {
    format!(
        "{} attempts on {} objects in {} scenes, executed in physics with {} and labelled by how they ended.\n\
         Dataset {}, {} {}, code {}, seed {}.",
        grouped(report.labels.attempts),
        grouped(report.objects),
        grouped(report.scenes),
        grippers(info),
        &report.dataset_id[..12],
        grouped(report.shards.into()),
        if report.shards == 1 { "shard" } else { "shards" },
        report.code_version,
        report.seed,
    )
}

/// The gripper or the number of grippers in words.
fn grippers(info: &DatasetInfo) -> String {
    match info.grippers() {
        [gripper] => format!("the gripper \"{}\"", gripper.name),
        grippers => {
            format!("{} grippers, from {} to {}", grippers.len(), grippers[0].name, grippers[grippers.len() - 1].name)
        }
    }
}

fn tiles(report: &Report) -> Vec<(String, String)> {
    let tile = |value: String, what: &str| (value, what.to_owned());
    let sum: u64 = report.tables.iter().map(|table| table.bytes).sum();
    let each = sum as f64 / report.labels.attempts.max(1) as f64;
    vec![
        tile(grouped(report.labels.attempts), "attempts"),
        tile(ratio(report.labels.positives, report.labels.negatives()), "positives : negatives"),
        tile(percent(report.labels.positive_share()), "held the object"),
        tile(grouped(report.scenes), "scenes"),
        tile(bytes(sum), "on disk"),
        tile(format!("{each:.0} B"), "an attempt, grids and all"),
    ]
}

/// A heading, what is shown and how to read it, and what it shows.
type Section = (&'static str, String, Vec<Block>);

fn share(part: u64, whole: u64) -> Cell {
    let share = part as f64 / whole.max(1) as f64;
    Cell::Bar(share, percent(share))
}

fn outcomes(report: &Report) -> Section {
    let rows = report.outcomes.iter().map(|group| {
        let hits: Vec<String> =
            group.hits.iter().map(|(hit, count)| format!("{} {}", hit.name(), grouped(*count))).collect();
        vec![
            Cell::Outcome(group.outcome),
            Cell::Count(group.attempts),
            share(group.attempts, report.labels.attempts),
            hits.join(", ").into(),
            Cell::note(group.outcome.meaning()),
        ]
    });
    let text = "Every attempt ends in one of six ways, decided in this order; only the last is a positive label.";
    let table = Table::new(["outcome", "attempts", "share", "what was hit", "meaning"], rows);
    ("How attempts ended", text.to_owned(), vec![Block::Table(table)])
}

fn positives(report: &Report) -> Section {
    let text = "Which attempts held: by the target's shape, by the rule that drew the grasp, by clutter, by direction, and by the opening of \
                fingers that closed, at the end of the hold if held, else when closing stopped. The share is of those that held.";
    let blocks = vec![
        groups("shape", &report.shapes),
        groups("rule", &report.rules),
        groups("objects in scene", &report.object_counts),
        bins("approach, degrees off vertical", &report.approach_deg, 1.0),
        bins("opening, mm", &report.width_m, 1000.0),
    ];
    ("Positives", text.to_owned(), blocks)
}

/// Groups of which there is anything.
fn groups(title: &str, groups: &[Group]) -> Block {
    let row = |group: &Group| {
        let Tally { attempts, positives } = group.labels;
        vec![Cell::code(&group.name), Cell::Count(attempts), Cell::Count(positives), share(positives, attempts)]
    };
    let tried = groups.iter().filter(|group| group.labels.attempts > 0);
    Block::Table(Table::new([title, "attempts", "held", "share"], tried.map(row)))
}

/// A histogram as such a table; its ends times `factor`.
fn bins(title: &str, bins: &[Bin], factor: f64) -> Block {
    let edge = |at: f64| (at * factor * 100.0).round() / 100.0;
    let group = |bin: &Bin| Group { name: format!("{} to {}", edge(bin.low), edge(bin.high)), labels: bin.labels };
    groups(title, &bins.iter().map(group).collect::<Vec<_>>())
}

fn sizes(report: &Report) -> Section {
    let rows = report.tables.iter().map(|table| {
        vec![
            Cell::code(&table.table),
            Cell::Count(table.rows),
            Cell::Number(bytes(table.bytes)),
            Cell::Number(format!("{:.1}", table.bytes_per_attempt)),
        ]
    });
    let table = Table::new(["table", "rows", "on disk", "bytes an attempt"], rows);
    let (rejected, outside) = (&report.rejections, report.outside_grid);
    let text = format!(
        "{} scenes were thrown away on the way ({} did not come to rest, {} lost every object, {} broke the physics); {} grasps ({}) \
         lie outside the grid, {} of them positive.",
        grouped(rejected.total()),
        grouped(rejected.unsettled),
        grouped(rejected.empty),
        grouped(rejected.unstable),
        grouped(outside.attempts),
        percent(outside.attempts as f64 / report.labels.attempts.max(1) as f64),
        grouped(outside.positives),
    );
    ("Size", text, vec![Block::Table(table)])
}

fn provenance(info: &DatasetInfo) -> Block {
    // What is said of frames and units is the same for all; the corners of models are too many.
    let mut told: serde_json::Map<String, Value> = serde_json::from_str(&info.to_json()).unwrap_or_default();
    told.retain(|key, _| !["about", "facets", "frames", "units", "models"].contains(&key.as_str()));
    Block::Code("json", format!("{:#}", Value::Object(told)))
}
