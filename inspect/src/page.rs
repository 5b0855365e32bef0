//! The report as a document: what a terminal shows, and what a page shows besides.

use program::Failure;
use program::text::{bytes, grouped, percent, ratio, setting};
use report::document::{Block, Cell, Document, Picture, Table};
use report::figure::{Bars, Figure, GREEN, ORANGE, Scale};
use schema::Outcome;
use serde_json::Value;
use settings::flattened;
use shards::{Dataset, DatasetInfo, Tally};

use crate::pictures::{picture, spread};
use crate::statistics::{Bin, Group, Report};

/// Scenes that are shown.
const SCENES_SHOWN: usize = 12;

impl Report {
    /// The report, for a terminal.
    #[must_use]
    pub fn document(&self, info: &DatasetInfo) -> Document {
        let mut blocks =
            vec![Block::Text(lead(self, info)), Block::Tiles(tiles(self)), Block::Warnings(self.warnings())];
        let sections = [outcomes(self), positives(self), hand(self), sizes(self)];
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

    /// The report as a page shows it: with pictures of scenes first, and the dataset's origin last. The pictures are
    /// links if the scenes are `browsed`: if they have pages in the report's folder.
    ///
    /// # Errors
    /// [`Failure`] if a scene cannot be read.
    pub fn page(&self, dataset: &Dataset, browsed: Option<&[u64]>) -> Result<Document, Failure> {
        let info = dataset.info();
        let mut page = self.document(info);
        page.title = format!("{}: {} grasp attempts", dataset.location().name(), grouped(self.labels.attempts));
        let heading = |title: &str, text: &str| [Block::Heading(title.to_owned()), Block::Text(text.to_owned())];
        let how = if browsed.is_some() {
            "A picture leads to its scene, which can be turned; a grasp there leads to its replay."
        } else {
            "\"graspmill dataset browse DIR\" shows scenes that can be turned, with replays."
        };
        let shown = match browsed {
            Some(scenes) => spread(scenes, SCENES_SHOWN),
            None => spread(&(0..info.scene_count).collect::<Vec<_>>(), SCENES_SHOWN),
        };
        let text =
            format!("Evenly spread over the dataset. A fork is a hand, which names its attempt under the mouse. {how}");
        let shown =
            shown.into_iter().map(|scene| Ok(picture(info, &dataset.read_scene(scene)?, true, browsed.is_some())));
        let mut scenes = heading("Scenes", &text).to_vec();
        scenes.push(Block::Legend(Outcome::ALL.to_vec()));
        scenes.push(Block::Gallery(shown.collect::<Result<_, Failure>>()?));
        let first = page.blocks.iter().position(|block| matches!(block, Block::Heading(_)));
        let first = first.unwrap_or(page.blocks.len());
        page.blocks.splice(first..first, scenes);
        page.blocks.extend(heading(
            "Provenance",
            "From meta/info.json, which is shown here, the dataset can be made again, byte for byte.",
        ));
        page.blocks.push(Block::Table(provenance(dataset)));
        Ok(page)
    }
}

fn lead(report: &Report, info: &DatasetInfo) -> String {
    format!(
        "{} attempts on {} objects in {} scenes, executed in physics with {} and labelled by how they ended.\n\
         Dataset {}, {} {}, code {}, seed {}.",
        grouped(report.labels.attempts),
        grouped(report.objects),
        grouped(report.scenes),
        hands(info),
        &report.dataset_id[..12],
        grouped(report.shards.into()),
        if report.shards == 1 { "shard" } else { "shards" },
        report.code_version,
        report.seed,
    )
}

/// The hand or the number of hands in words.
fn hands(info: &DatasetInfo) -> String {
    match info.hands() {
        [hand] => format!("the hand \"{}\"", hand.name),
        hands => format!("{} hands, from {} to {}", hands.len(), hands[0].name, hands[hands.len() - 1].name),
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
        let hits: Vec<String> = group.hits.iter().map(|(hit, count)| format!("{hit} {}", grouped(*count))).collect();
        vec![
            Outcome::from_name(&group.outcome).map_or_else(|| Cell::code(&group.outcome), Cell::Outcome),
            Cell::Count(group.attempts),
            share(group.attempts, report.labels.attempts),
            hits.join(", ").into(),
            Cell::note(Outcome::from_name(&group.outcome).map_or("", Outcome::meaning)),
        ]
    });
    let text = "Every attempt ends in one of six ways, decided in this order; only the last is a positive label.";
    let table = Table::new(["outcome", "attempts", "share", "what was hit", "meaning"], rows);
    ("How attempts ended", text.to_owned(), vec![Block::Table(table)])
}

fn positives(report: &Report) -> Section {
    let distances = Scale::steps("nearest other object's centre, cm", 0.0, 18.0, 2.0);
    let neighbours = histogram(
        shares_of_bins("Held, by distance to the next object", distances, &report.neighbour_m, 100.0),
        "Clutter: distance between centres. The last bar also holds what is further, and lone objects.",
        bin_table("nearest object, cm", &report.neighbour_m, 100.0),
    );
    let degrees = Scale::steps("degrees from straight down", 0.0, 180.0, 30.0);
    let angles = histogram(
        shares_of_bins("Held, by angle of the approach", degrees, &report.approach_deg, 1.0),
        "0 is a grasp from above, 90 one from the side.",
        bin_table("degrees off vertical", &report.approach_deg, 1.0),
    );
    let text = "Which attempts held: by the target's shape, by the rule that drew the grasp, by clutter and by direction. Bars \
                show the share that held.";
    let blocks = vec![
        groups("shape", &report.shapes),
        groups("rule", &report.rules),
        groups("objects in scene", &report.object_counts),
        Block::Figures(vec![neighbours, angles]),
    ];
    ("Positives", text.to_owned(), blocks)
}

fn histogram(figure: Figure, caption: &str, numbers: Table) -> Picture {
    Picture { numbers: Some(numbers), ..Picture::figure(figure, caption) }
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

/// The numbers of a histogram; bars are shares of the fullest.
fn bin_table(title: &str, bins: &[Bin], factor: f64) -> Table {
    let most = most(bins).max(1);
    let rows = bins.iter().map(|bin| {
        let labels = bin.labels;
        let edge = |at: f64| ((at * factor) * 100.0).round() / 100.0;
        vec![
            format!("{} to {}", edge(bin.low), edge(bin.high)).into(),
            Cell::Count(labels.positives),
            Cell::Number(if labels.attempts == 0 { "–".to_owned() } else { percent(labels.positive_share()) }),
            Cell::Bar(labels.attempts as f64 / most as f64, grouped(labels.attempts)),
        ]
    });
    Table::new([title, "held", "share", "attempts"], rows)
}

/// The attempts of the fullest bar.
fn most(bins: &[Bin]) -> u64 {
    bins.iter().map(|bin| bin.labels.attempts).max().unwrap_or_default()
}

/// The share of positives of each bar; ranges times `factor`.
fn shares_of_bins(title: &str, x: Scale, bins: &[Bin], factor: f64) -> Figure {
    let bars = bins.iter().filter(|bin| bin.labels.attempts > 0);
    let bar = |bin: &Bin| [bin.low * factor, bin.high * factor, 0.0, bin.labels.positive_share()];
    let bars: Vec<[f64; 4]> = bars.map(bar).collect();
    let most = bars.iter().map(|bar| bar[3]).fold(0.0, f64::max);
    Figure {
        title: title.to_owned(),
        x,
        y: Scale::around("share that held", 0.0, most.max(0.05)),
        lines: Vec::new(),
        bars: vec![Bars { name: String::new(), colour: GREEN, bars }],
    }
}

fn hand(report: &Report) -> Section {
    let widths = histogram(
        counts_of_bins("Opening of the hand", "opening, mm", &report.width_m, 1000.0),
        "Attempts that closed the hand: at the end of the hold if held, else when closing stopped; green held. Below the smallest extent the \
         hand met nothing.",
        bin_table("width, mm, if closed", &report.width_m, 1000.0),
    );
    ("Widths", "The opening of the hand.".to_owned(), vec![Block::Figures(vec![widths])])
}

/// Attempts by bar, those that held below those that failed.
fn counts_of_bins(title: &str, label: &str, bins: &[Bin], factor: f64) -> Figure {
    let most = most(bins) as f64;
    let thousands = most >= 10_000.0;
    let unit = if thousands { 1000.0 } else { 1.0 };
    let bar =
        |bin: &Bin, low: u64, high: u64| [bin.low * factor, bin.high * factor, low as f64 / unit, high as f64 / unit];
    let held = bins.iter().map(|bin| bar(bin, 0, bin.labels.positives)).collect();
    let failed = bins.iter().map(|bin| bar(bin, bin.labels.positives, bin.labels.attempts)).collect();
    Figure {
        title: title.to_owned(),
        x: Scale::around(label, bins[0].low * factor, bins[bins.len() - 1].high * factor),
        y: Scale::around(if thousands { "attempts, thousands" } else { "attempts" }, 0.0, (most / unit).max(1.0)),
        lines: Vec::new(),
        bars: vec![
            Bars { name: "held".to_owned(), colour: GREEN, bars: held },
            Bars { name: "failed".to_owned(), colour: ORANGE, bars: failed },
        ],
    }
}

fn sizes(report: &Report) -> Section {
    let rows = report.tables.iter().map(|table| {
        vec![
            Cell::code(&table.table),
            Cell::Count(table.rows),
            Cell::Number(bytes(table.bytes)),
            Cell::Count(table.bytes_per_scene.round() as u64), // a size, from 0
            Cell::Number(format!("{:.1}", table.bytes_per_attempt)),
        ]
    });
    let table = Table::new(["table", "rows", "on disk", "bytes a scene", "bytes an attempt"], rows);
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

fn provenance(dataset: &Dataset) -> Table {
    // What is said of frames and units is the same for all; the corners of models are shown by the pictures.
    let text = dataset.info().to_json();
    let mut told: serde_json::Map<String, Value> = serde_json::from_str(&text).unwrap_or_default();
    told.retain(|key, _| !["about", "facets", "frames", "units", "models"].contains(&key.as_str()));
    let row = |key: &str, value: &str| vec![Cell::code(key), Cell::code(value)];
    let keys = flattened(&told, "", Value::as_object).into_iter();
    let rows = keys.map(|(key, value)| row(&key, &setting(value)));
    Table::new(["key", "value"], [row("dataset", dataset.id())].into_iter().chain(rows))
}
