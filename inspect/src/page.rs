//! The report as a document: what a terminal shows, and what a page shows besides.

use program::Failure;
use program::text::{bytes, grouped, percent, ratio, setting};
use report::document::{Block, Cell, Document, Picture, Table};
use report::figure::{BLUE, Bars, Colour, Figure, GREEN, GREY, Line, ORANGE, Scale, Stroke};
use schema::Outcome;
use serde_json::Value;
use settings::flattened;
use shards::{Dataset, DatasetInfo, Tally};

use crate::pictures::{picture, spread};
use crate::statistics::coverage::{AZIMUTHS, HEIGHTS};
use crate::statistics::{Bin, Fit, Group, Law, Report};

/// Scenes that are shown.
const SCENES_SHOWN: usize = 12;

impl Report {
    /// The report, for a terminal.
    #[must_use]
    pub fn document(&self, info: &DatasetInfo) -> Document {
        let mut blocks =
            vec![Block::Text(lead(self, info)), Block::Tiles(tiles(self)), Block::Warnings(self.warnings())];
        let sections = [outcomes(self), positives(self), hand(self), laws(self), orientations(self), sizes(self)];
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
            "\"graspmill dataset view DIR --scene N\" shows a scene that can be turned, \"graspmill dataset browse DIR\" many that lead to each other."
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
    let depths = histogram(
        counts_of_bins("Depth of the tips", "behind the near face, mm", &report.tip_depth_m, 1000.0),
        "As drawn by the rules of Appendix A: d_z + l_z / 2; green held.",
        bin_table("depth of the tips, mm", &report.tip_depth_m, 1000.0),
    );
    let mut pictures = vec![widths];
    pictures.extend((most(&report.tip_depth_m) > 0).then_some(depths));
    let text = "The opening of the hand, and how far its tips reached behind the near face.".to_owned();
    ("Widths and depths", text, vec![Block::Figures(pictures)])
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

fn laws(report: &Report) -> Section {
    let mut pictures = Vec::new();
    let mut rows = Vec::new();
    for fit in &report.fits {
        let test = fit.chi_square();
        let told = test.map_or_else(
            || "too few draws to say".to_owned(),
            |test| format!("χ² = {:.1}, {} degrees of freedom, p = {:.3}", test.statistic, test.degrees, test.p),
        );
        let selected = if fit.complete { "" } else { ". Objects that fell off the table are not in the data" };
        pictures.push(Picture::figure(law(fit), &format!("{} draws; {told}{selected}.", grouped(fit.total()))));
        rows.push(vec![
            fit.name.into(),
            law_in_words(fit).into(),
            Cell::Count(fit.total()),
            Cell::Number(test.map_or("–".to_owned(), |t| format!("{:.1} / {}", t.statistic, t.degrees))),
            Cell::Number(test.map_or("–".to_owned(), |t| format!("{:.3}", t.p))),
        ]);
    }
    let title = "Draws against their laws";
    if rows.is_empty() {
        return (title, "No attempt was drawn by a rule of Appendix A.".to_owned(), Vec::new());
    }
    let text = "What was drawn beside the laws of the paper's Appendix A and of the config. p is the probability that a sample of the law is \
                as far off or further: small values now and then are chance, tiny ones are not.";
    let table = Table::new(["what was drawn", "law", "draws", "χ² / degrees", "p"], rows);
    (title, text.to_owned(), vec![Block::Figures(pictures), Block::Table(table)])
}

fn law_in_words(fit: &Fit) -> String {
    match fit.law {
        Law::Uniform => format!("uniform, {:.0} to {:.0} {}", fit.range[0], fit.range[1], fit.unit),
        Law::StandardNormal => "normal".to_owned(),
        Law::Weights => "the config's weights".to_owned(),
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

fn orientations(report: &Report) -> Section {
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
    let text = format!(
        "Directions of the approach on {} patches of the sphere, all of one size: from {} of them something was tried, from {} \
         something held. Blank patches are empty.",
        coverage.patches.len(),
        percent(coverage.tried()),
        percent(coverage.held())
    );
    let pictures = vec![
        Picture::figure(map("Tried", |patch| patch.attempts), "All attempts."),
        Picture::figure(map("Held", |patch| patch.positives), "Attempts that held."),
    ];
    ("Coverage of orientations", text, vec![Block::Figures(pictures)])
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
