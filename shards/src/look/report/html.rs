//! The report as a page: one file with everything in it.

use std::time::Duration;

use program::text::{bytes, grouped, percent, ratio};
use program::{Exit, ExitCode};
use report::figure::{BLUE, Bars, Colour, Figure, FigureError, GREEN, GREY, Line, ORANGE, Scale, Stroke};
use report::page::{Block, Cell, Page, Picture, Section, Table};
use schema::Outcome;
use serde_json::Value;

use super::coverage::{AZIMUTHS, HEIGHTS};
use super::fit::Fit;
use super::scenes::gallery;
use super::{Bin, Group, Report};
use crate::{Dataset, ReadError, Tally};

/// Scenes that are shown.
const SCENES_SHOWN: u64 = 12;

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum HtmlError {
    /// A scene could not be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The library that draws failed.
    #[error(transparent)]
    Figure(#[from] FigureError),
}

impl Exit for HtmlError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::Read(error) => error.exit_code(),
            Self::Figure(_) => ExitCode::Internal,
        }
    }
}

/// The report as a page with pictures of scenes from the dataset. `written_over`: from the first to the last of its
/// files, if they have times.
///
/// # Errors
/// [`HtmlError`].
pub fn html(report: &Report, dataset: &Dataset, written_over: Option<Duration>) -> Result<String, HtmlError> {
    let page = Page {
        title: "Grasp attempts in simulation".to_owned(),
        lead: format!(
            "{} attempts on {} objects in {} scenes, executed in physics with the hand “{}” and labelled by how they ended.",
            grouped(report.labels.attempts),
            grouped(report.objects),
            grouped(report.scenes),
            dataset.info().gripper.name,
        ),
        tiles: tiles(report, written_over),
        warnings: report.warnings(),
        sections: vec![
            outcomes(report),
            positives(report)?,
            hand(report)?,
            laws(report)?,
            orientations(report)?,
            scenes(dataset)?,
            sizes(report),
            provenance(dataset),
        ],
        footer: format!("shards report --html, Graspmill {}; dataset {}", env!("CARGO_PKG_VERSION"), report.dataset_id),
    };
    Ok(page.html())
}

fn tiles(report: &Report, written_over: Option<Duration>) -> Vec<(String, String)> {
    let tile = |value: String, what: &str| (value, what.to_owned());
    let sum: u64 = report.tables.iter().map(|table| table.bytes).sum();
    let each = sum as f64 / report.labels.attempts.max(1) as f64;
    let mut tiles = vec![
        tile(grouped(report.labels.attempts), "attempts"),
        tile(ratio(report.labels.positives, report.labels.negatives()), "positives : negatives"),
        tile(percent(report.labels.positive_share()), "held the object"),
        tile(grouped(report.scenes), "scenes"),
        tile(bytes(sum), "on disk"),
        tile(format!("{each:.0} B"), "an attempt, grids and all"),
    ];
    if let Some(span) = written_over.filter(|span| span.as_secs_f64() >= 1.0) {
        let rate = report.labels.attempts as f64 / span.as_secs_f64();
        let what = format!("attempts a second, by the files' times: first to last {:.0} s", span.as_secs_f64());
        tiles.push((grouped(rate.round() as u64), what));
    }
    tiles
}

fn outcomes(report: &Report) -> Section {
    let share = |count: u64| count as f64 / report.labels.attempts.max(1) as f64;
    let rows = report.outcomes.iter().map(|group| {
        let hits: Vec<String> = group.hits.iter().map(|(hit, count)| format!("{hit} {}", grouped(*count))).collect();
        let meaning = Outcome::from_name(&group.outcome).map_or("", meaning);
        vec![
            Cell::Code(group.outcome.clone()),
            Cell::Number(grouped(group.attempts)),
            Cell::Bar(share(group.attempts), percent(share(group.attempts))),
            Cell::Text(hits.join(", ")),
            Cell::Text(meaning.to_owned()),
        ]
    });
    let table = Table { head: vec!["outcome", "attempts", "share", "what was hit", "meaning"], rows: rows.collect() };
    Section {
        title: "How attempts ended".to_owned(),
        text: "Every attempt ends in one of six ways, decided in this order; only the last is a positive label."
            .to_owned(),
        blocks: vec![Block::Table(table)],
    }
}

fn meaning(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::PregraspCollision => "the open hand touches something before it approaches",
        Outcome::ApproachCollision => "it touches something on its straight way",
        Outcome::Empty => "the jaws met on nothing",
        Outcome::Slipped => "the object did not come along or fell",
        Outcome::HitOther => "something else was pushed or lifted by more than is allowed",
        Outcome::Held => "lifted and still held",
    }
}

fn positives(report: &Report) -> Result<Section, FigureError> {
    let neighbours = shares_of_bins(
        "Held, by distance to the next object",
        Scale::steps("nearest other object's centre, cm", 0.0, 18.0, 2.0),
        &report.neighbour_m,
        100.0,
    );
    let angles = shares_of_bins(
        "Held, by angle of the approach",
        Scale::steps("degrees from straight down", 0.0, 180.0, 30.0),
        &report.approach_deg,
        1.0,
    );
    let tried = |groups: &[Group]| groups.iter().filter(|group| group.attempts > 0).cloned().collect::<Vec<_>>();
    Ok(Section {
        title: "Positives".to_owned(),
        text: "Which attempts held: by the target's shape, by the rule that drew the grasp, by clutter and by direction. Bars \
               show the share that held."
            .to_owned(),
        blocks: vec![
            Block::Table(groups("shape", &tried(&report.shapes))),
            Block::Table(groups("rule", &tried(&report.rules))),
            Block::Table(groups("objects in scene", &report.object_counts)),
            Block::Figures(vec![
                Picture::of(&neighbours, "Clutter: distance between centres. The last bar also holds what is further, and lone objects.")?,
                Picture::of(&angles, "0 is a grasp from above, 90 one from the side.")?,
            ]),
        ],
    })
}

fn groups(title: &'static str, groups: &[Group]) -> Table {
    let row = |group: &Group| {
        let tally = group.tally();
        vec![
            Cell::Code(group.name.clone()),
            Cell::Number(grouped(tally.attempts)),
            Cell::Number(grouped(tally.positives)),
            Cell::Bar(tally.positive_share(), percent(tally.positive_share())),
        ]
    };
    Table { head: vec![title, "attempts", "held", "share"], rows: groups.iter().map(row).collect() }
}

/// The share of positives of each bar; ranges times `factor`.
fn shares_of_bins(title: &str, x: Scale, bins: &[Bin], factor: f64) -> Figure {
    let bars = bins.iter().filter(|bin| bin.attempts > 0);
    let share = |bin: &Bin| bin.positives as f64 / bin.attempts as f64;
    let bars: Vec<[f64; 4]> = bars.map(|bin| [bin.low * factor, bin.high * factor, 0.0, share(bin)]).collect();
    let most = bars.iter().map(|bar| bar[3]).fold(0.0, f64::max);
    Figure {
        title: title.to_owned(),
        x,
        y: Scale::around("share that held", 0.0, most.max(0.05)),
        lines: Vec::new(),
        bars: vec![Bars { name: String::new(), colour: GREEN, bars }],
    }
}

fn around(label: &str, bins: &[Bin], factor: f64) -> Scale {
    let low = bins.first().map_or(0.0, |bin| bin.low * factor);
    let high = bins.last().map_or(1.0, |bin| bin.high * factor);
    Scale::around(label, low, high)
}

fn hand(report: &Report) -> Result<Section, FigureError> {
    let mut pictures = vec![Picture::of(
        &counts_of_bins("Opening of the hand", "opening, mm", &report.width_m, 1000.0),
        "Attempts that closed it: at the end of the hold if held, else when closing stopped. Below the smallest extent it met nothing.",
    )?];
    if report.tip_depth_m.iter().any(|bin| bin.attempts > 0) {
        pictures.push(Picture::of(
            &counts_of_bins("Depth of the tips", "behind the near face, mm", &report.tip_depth_m, 1000.0),
            "As drawn by the rules of Appendix A: d_z + l_z / 2.",
        )?);
    }
    Ok(Section {
        title: "Widths and depths".to_owned(),
        text: "Attempts that held stand in green below those that failed.".to_owned(),
        blocks: vec![Block::Figures(pictures)],
    })
}

/// Attempts by bar, those that held below those that failed.
fn counts_of_bins(title: &str, label: &str, bins: &[Bin], factor: f64) -> Figure {
    let most = bins.iter().map(|bin| bin.attempts).max().unwrap_or_default() as f64;
    let thousands = most >= 10_000.0;
    let unit = if thousands { 1000.0 } else { 1.0 };
    let bar =
        |bin: &Bin, low: u64, high: u64| [bin.low * factor, bin.high * factor, low as f64 / unit, high as f64 / unit];
    let held = bins.iter().map(|bin| bar(bin, 0, bin.positives)).collect();
    let failed = bins.iter().map(|bin| bar(bin, bin.positives, bin.attempts)).collect();
    Figure {
        title: title.to_owned(),
        x: around(label, bins, factor),
        y: Scale::around(if thousands { "attempts, thousands" } else { "attempts" }, 0.0, (most / unit).max(1.0)),
        lines: Vec::new(),
        bars: vec![
            Bars { name: "held".to_owned(), colour: GREEN, bars: held },
            Bars { name: "failed".to_owned(), colour: ORANGE, bars: failed },
        ],
    }
}

fn laws(report: &Report) -> Result<Section, FigureError> {
    let mut pictures = Vec::new();
    let mut rows = Vec::new();
    for fit in &report.fits {
        let told = fit.chi_square().map_or_else(
            || "too few draws to say".to_owned(),
            |test| format!("χ² = {:.1}, {} degrees of freedom, p = {:.3}", test.statistic, test.degrees, test.p),
        );
        let selected = if fit.complete { "" } else { ". Objects that fell off the table are not in the data" };
        pictures.push(Picture::of(&law(fit), &format!("{} draws; {told}{selected}.", grouped(fit.total())))?);
        let test = fit.chi_square();
        rows.push(vec![
            Cell::Text(fit.name.to_owned()),
            Cell::Text(law_in_words(fit)),
            Cell::Number(grouped(fit.total())),
            Cell::Number(test.map_or("–".to_owned(), |t| format!("{:.1} / {}", t.statistic, t.degrees))),
            Cell::Number(test.map_or("–".to_owned(), |t| format!("{:.3}", t.p))),
        ]);
    }
    let table = Table { head: vec!["what was drawn", "law", "draws", "χ² / degrees", "p"], rows };
    Ok(Section {
        title: "Draws against their laws".to_owned(),
        text: if pictures.is_empty() {
            "No attempt was drawn by a rule of Appendix A.".to_owned()
        } else {
            "What was drawn beside the laws of the paper's Appendix A and of the config. p is how often a sample of the law is as far \
             off or further: small values now and then are chance, tiny ones are not."
                .to_owned()
        },
        blocks: if table.rows.is_empty() { Vec::new() } else { vec![Block::Figures(pictures), Block::Table(table)] },
    })
}

fn law_in_words(fit: &Fit) -> String {
    match fit.law {
        super::fit::Law::Uniform => format!("uniform, {:.0} to {:.0} {}", fit.range[0], fit.range[1], fit.unit),
        super::fit::Law::StandardNormal => "normal".to_owned(),
    }
}

fn law(fit: &Fit) -> Figure {
    let total = fit.total().max(1) as f64;
    let shares: Vec<f64> = fit.counts.iter().map(|count| 100.0 * *count as f64 / total).collect();
    let step = (fit.range[1] - fit.range[0]) / fit.counts.len() as f64;
    let expected = fit.expected.iter().enumerate();
    let line = expected.map(|(at, share)| (fit.range[0] + (at as f64 + 0.5) * step, 100.0 * share)).collect();
    let most =
        shares.iter().chain(&[100.0 * fit.expected.iter().copied().fold(0.0, f64::max)]).copied().fold(0.0, f64::max);
    Figure {
        title: capital(fit.name),
        x: Scale::around(fit.unit, fit.range[0], fit.range[1]),
        y: Scale::around("draws, %", 0.0, most),
        lines: vec![Line::new("law", ORANGE, Stroke::Solid, line)],
        bars: vec![Bars::standing("drawn", BLUE, fit.range[0], step, &shares)],
    }
}

fn capital(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map(|first| first.to_uppercase().collect::<String>() + letters.as_str()).unwrap_or_default()
}

/// Blues from light to dark, and the share of the fullest patch from which each begins.
const SHADES: [([u8; 3], f64, &str); 5] = [
    ([222, 235, 247], 0.0, "some"),
    ([158, 202, 225], 0.125, "⅛ of the most"),
    ([107, 174, 214], 0.25, "¼"),
    ([49, 130, 189], 0.5, "½"),
    ([8, 69, 148], 0.75, "¾"),
];

fn orientations(report: &Report) -> Result<Section, FigureError> {
    let coverage = &report.coverage;
    let map = |title: &str, count: fn(&Tally) -> u64| {
        let most = coverage.patches.iter().map(count).max().unwrap_or_default().max(1) as f64;
        let shade = |at: usize| {
            let ([r, g, b], from, name) = SHADES[at];
            let to = SHADES.get(at + 1).map_or(f64::INFINITY, |next| next.1);
            let is_of = |patch: &Tally| count(patch) > 0 && (from..to).contains(&(count(patch) as f64 / most));
            let place = |at: usize| {
                let (row, column) = ((at / AZIMUTHS) as f64, (at % AZIMUTHS) as f64);
                let (wide, high) = (360.0 / AZIMUTHS as f64, 2.0 / HEIGHTS as f64);
                [column * wide, (column + 1.0) * wide, -1.0 + row * high, -1.0 + (row + 1.0) * high]
            };
            let bars = coverage.patches.iter().enumerate().filter(|(_, patch)| is_of(patch)).map(|(at, _)| place(at));
            Bars { name: name.to_owned(), colour: Colour(r, g, b), bars: bars.collect() }
        };
        Figure {
            title: title.to_owned(),
            x: Scale::steps("azimuth of the approach, degrees", 0.0, 360.0, 60.0),
            y: Scale::steps("its z: −1 straight down", -1.0, 1.0, 0.5),
            lines: vec![Line::new("", GREY, Stroke::Dashed, vec![(0.0, 0.0), (360.0, 0.0)])],
            bars: (0..SHADES.len()).map(shade).collect(),
        }
    };
    Ok(Section {
        title: "Coverage of orientations".to_owned(),
        text: format!(
            "Directions of the approach on {} patches of the sphere, all of one size: from {} of them something was tried, from {} \
             something held. Blank patches are empty.",
            coverage.patches.len(),
            percent(coverage.tried()),
            percent(coverage.held())
        ),
        blocks: vec![Block::Figures(vec![
            Picture::of(&map("Tried", |patch| patch.attempts), "All attempts.")?,
            Picture::of(&map("Held", |patch| patch.positives), "Attempts that held.")?,
        ])],
    })
}

fn scenes(dataset: &Dataset) -> Result<Section, ReadError> {
    Ok(Section {
        title: "Scenes".to_owned(),
        text: "Evenly spread over the dataset. A fork is a hand: green held, red failed. \"shards view DIR --scene N\" shows one that can \
               be turned about."
            .to_owned(),
        blocks: vec![Block::Gallery(gallery(dataset, SCENES_SHOWN)?)],
    })
}

fn sizes(report: &Report) -> Section {
    let row = |table: &super::TableSize| {
        vec![
            Cell::Code(table.table.clone()),
            Cell::Number(grouped(table.rows)),
            Cell::Number(bytes(table.bytes)),
            Cell::Number(grouped(table.bytes_per_scene.round() as u64)), // a size, from 0
            Cell::Number(format!("{:.1}", table.bytes_per_attempt)),
        ]
    };
    let table = Table {
        head: vec!["table", "rows", "on disk", "bytes a scene", "bytes an attempt"],
        rows: report.tables.iter().map(row).collect(),
    };
    let rejected = &report.rejections;
    Section {
        title: "Size".to_owned(),
        text: format!(
            "{} scenes were thrown away on the way ({} did not come to rest, {} lost every object, {} broke the physics); {} grasps \
             lie outside the grid.",
            grouped(rejected.total()),
            grouped(rejected.unsettled),
            grouped(rejected.empty),
            grouped(rejected.unstable),
            grouped(report.outside_grid.attempts),
        ),
        blocks: vec![Block::Table(table)],
    }
}

fn provenance(dataset: &Dataset) -> Section {
    let info = dataset.info();
    let mut rows = vec![[Cell::Code("dataset".to_owned()), Cell::Code(dataset.id().to_owned())]];
    // What is said of frames and units is the same for all; the corners of models are told by the pictures.
    let mut told: Value = serde_json::from_str(&info.to_json()).unwrap_or_default();
    if let Value::Object(map) = &mut told {
        map.retain(|key, _| !["about", "facets", "frames", "units", "models"].contains(&key.as_str()));
    }
    let mut flat = Vec::new();
    flatten("", &told, &mut flat);
    rows.extend(flat.into_iter().map(|(key, value)| [Cell::Code(key), Cell::Code(value)]));
    let table = Table { head: vec!["key", "value"], rows: rows.into_iter().map(Vec::from).collect() };
    Section {
        title: "Provenance".to_owned(),
        text: "From meta/info.json, which is told here, the dataset can be made again, byte for byte.".to_owned(),
        blocks: vec![Block::Table(table)],
    }
}

/// A config's keys and values, tables as `table.key`.
fn flatten(prefix: &str, value: &Value, into: &mut Vec<(String, String)>) {
    match value {
        Value::Object(map) => {
            for (key, inner) in map {
                let name = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
                flatten(&name, inner, into);
            }
        }
        Value::String(text) => into.push((prefix.to_owned(), text.clone())),
        other => into.push((prefix.to_owned(), other.to_string())),
    }
}
