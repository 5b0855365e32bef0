//! An experiment as it is read: described once, with its figure, and as JSON; several experiments side by side.
//!
//! A success rate without its protocol is a rumour: every table and every section says whose numbers it holds. The
//! caller writes the files.

use std::collections::BTreeMap;
use std::path::Path;

use program::Failure;
use report::document::{Block, Cell, Document, Table};
use report::figure::{Intervals, Rate, Row};
use schema::Outcome;
use serde::{Deserialize, Serialize};

use crate::files::json;
use crate::record::Ending;
use crate::statistics::{DRAWS, GroupResults, Interval, Percentiles, Rates, Results, TargetResults};

/// Where results come from: what it takes to find them again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// The command that was given.
    pub command: String,
    /// The configuration as resolved, TOML.
    pub config: String,
    /// SHA-256 of the network's weights.
    pub model_id: String,
    /// Versions of what took part, by name.
    pub versions: BTreeMap<String, String>,
}

/// An experiment's results and where they come from: `report.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// The results.
    pub results: Results,
    /// Where they come from.
    pub about: About,
}

impl Report {
    /// Reads the report in the folder of an experiment that is done.
    ///
    /// # Errors
    /// If it cannot be read or is damaged.
    pub fn read(folder: &Path) -> Result<Self, Failure> {
        json(&folder.join("report.json"))
    }
}

/// The success rate and the cleared share of experiments.
#[must_use]
pub fn figure(results: &[Results]) -> Intervals {
    let name = |of: &Results| format!("{} ({} rounds, {} attempts)", of.protocol, of.rounds, of.attempts);
    rates_figure(results.iter().map(|of| (name(of), of.rates)))
}

/// The same of anything that has rates.
pub(crate) fn rates_figure(rows: impl IntoIterator<Item = (String, Rates)>) -> Intervals {
    let rate = |name, rate: Option<Interval>| Rate {
        name,
        share: rate.map(|Interval { value, low, high }| [value, low, high]),
        text: share(rate),
    };
    let row = |(name, rates): (String, Rates)| Row {
        name,
        rates: [rate("GSR", rates.success_rate), rate("cleared", rates.cleared_share)],
    };
    Intervals {
        title: "Grasp success rate (GSR) and share of objects cleared".to_owned(),
        axis: "share, with its 95 % bootstrap interval over rounds".to_owned(),
        rows: rows.into_iter().map(row).collect(),
    }
}

/// An experiment.
#[must_use]
pub fn document(Report { results, about }: &Report) -> Document {
    let by_target = results.by_target.iter().map(|target| target.success_rate);
    let groups = results.by_group.iter().chain(&results.by_seed).flat_map(|group| group_rates(&group.rates));
    let has_point = is_any_point(headline_rates(results).into_iter().chain(by_target).chain(groups));
    let names = std::slice::from_ref(&results.protocol);
    let mut blocks = headline(std::slice::from_ref(results), names, has_point).to_vec();
    blocks.extend(details(results, false));
    blocks.extend(origin(&results.protocol, about));
    Document { title: format!("Experiment {}", results.protocol), blocks, footer: String::new() }
}

/// An experiment's result in a few lines: its rates with their protocol, as they are read last in a terminal.
#[must_use]
pub fn in_short(results: &Results) -> String {
    let [success, cleared, rounds] = headline_rates(results).map(share);
    let row = |what: &str, value: String, of: String| vec![what.into(), Cell::Number(value), of.into()];
    let rows = [
        row("grasps that held (GSR)", success, format!("{} of {}", results.held, results.attempts)),
        row("objects cleared", cleared, format!("{} of {}", results.removed, results.objects)),
        row("rounds cleared", rounds, format!("of {}", results.rounds)),
        row("a plan, ms", times(results.plan_ms), "p50 / p90 / p99".to_owned()),
    ];
    let title = format!("{}, {} rounds; rates with 95 % intervals", results.protocol, results.rounds);
    Document { title, blocks: vec![Block::Table(Table::new(["", "", ""], rows))], footer: String::new() }.text()
}

/// Several experiments in a table, and which success rates are apart.
#[must_use]
pub fn comparison(results: &[Results]) -> Document {
    let names: Vec<String> = results.iter().map(|one| one.protocol.clone()).collect();
    let has_point = is_any_point(results.iter().flat_map(headline_rates));
    let mut blocks = headline(results, &names, has_point).to_vec();
    blocks.extend(side_by_side(results, &names));
    Document { blocks, ..Document::default() }
}

/// For kinds of scenes that are in all experiments, the attempts and the rate of each experiment: the form of the
/// paper's Table 4; then the success rates that are apart.
pub(crate) fn side_by_side(results: &[Results], names: &[String]) -> Vec<Block> {
    let groups = |name: &str| -> Option<Vec<&GroupResults>> {
        results.iter().map(|one| one.by_group.iter().find(|group| group.name == name)).collect()
    };
    let cells = |group: &GroupResults| {
        [Cell::Number(format!("{} of {}", group.held, group.attempts)), bar(group.rates.success_rate)]
    };
    let scenes = results.first().map(|one| one.by_group.as_slice()).unwrap_or_default().iter();
    let rows: Vec<Vec<Cell>> = scenes
        .filter_map(|scene| Some((&scene.name, groups(&scene.name)?)))
        .map(|(name, groups)| [name.as_str().into()].into_iter().chain(groups.into_iter().flat_map(cells)).collect())
        .collect();
    let mut blocks = Vec::new();
    if rows.len() > 1 && results.len() > 1 {
        let heads = names.iter().flat_map(|name| [format!("{name}: held of attempts"), "GSR (95 %)".to_owned()]);
        blocks.push(Block::Table(Table::new(["scene".to_owned()].into_iter().chain(heads), rows)));
    }
    let rates: Vec<_> = names.iter().zip(results.iter().map(|one| one.rates.success_rate)).collect();
    let apart: Vec<String> = rates
        .iter()
        .flat_map(|high| rates.iter().map(move |low| (high, low)))
        .filter(|(high, low)| high.1.zip(low.1).is_some_and(|(high, low)| high.is_above(&low)))
        .map(|(high, low)| format!("{}, {}, is above {}, {}", high.0, share(high.1), low.0, share(low.1)))
        .collect();
    if apart.is_empty() {
        blocks.push(Block::Text("No GSR interval is above another.".to_owned()));
    } else {
        blocks.extend([Block::Text("GSR intervals that do not overlap:".to_owned()), Block::List(apart)]);
    }
    blocks
}

/// A row for each experiment, and what the rates mean.
pub(crate) fn headline(results: &[Results], names: &[String], has_point: bool) -> [Block; 2] {
    let row = |(results, name): (&Results, &String)| {
        let start = [name.as_str().into(), Cell::Count(results.rounds), Cell::Count(results.attempts)];
        let rates = headline_rates(results).map(|rate| Cell::Number(share(rate)));
        start.into_iter().chain(rates).chain([Cell::Number(times(results.plan_ms))]).collect()
    };
    let head = [
        "protocol",
        "rounds",
        "attempts",
        "GSR (95 %)",
        "% cleared (95 %)",
        "rounds cleared (95 %)",
        "planning ms, p50 / p90 / p99",
    ];
    let note = if has_point { POINT_NOTE } else { "" };
    let legend = format!(
        "GSR, the grasp success rate: attempts that held, of all attempts. % cleared, also called DR: objects removed, \
         of those at the beginning. Intervals: 95 %, bootstrap over rounds, {DRAWS} draws.{note}"
    );
    [Block::Table(Table::new(head, results.iter().zip(names).map(row))), Block::Text(legend)]
}

const POINT_NOTE: &str = "\nAn interval without width means that all rounds ended alike, not that the rate is certain.";

pub(crate) fn headline_rates(results: &Results) -> [Option<Interval>; 3] {
    let rates = &results.rates;
    [rates.success_rate, rates.cleared_share, rates.rounds_cleared_share]
}

pub(crate) fn is_any_point(rates: impl IntoIterator<Item = Option<Interval>>) -> bool {
    rates.into_iter().flatten().any(|interval| interval.is_point())
}

fn group_rates(rates: &Rates) -> [Option<Interval>; 2] {
    [rates.success_rate, rates.cleared_share]
}

/// The counts and times of an experiment. A page has room for the attempts that held too, and shows the hardest
/// objects first.
pub(crate) fn details(results: &Results, is_page: bool) -> Vec<Block> {
    let protocol = &results.protocol;
    let heading = |text: &str| Block::Heading(format!("{text}, {protocol}"));
    let (observe, planned) = (times(results.observe_ms), mean(results.planned_per_trial_mean));
    let mut blocks = vec![
        Block::Text(format!(
            "{protocol}: {} of {} attempts held, {} of {} objects were removed.\n\
             Rendering the views took {observe} ms (p50 / p90 / p99); a plan gave {planned} grasps on average.",
            results.held, results.attempts, results.removed, results.objects
        )),
        heading("Failures by outcome"),
        outcomes(results, is_page),
        heading("Endings of rounds"),
        endings(results),
    ];
    for (title, groups) in [("By scene", &results.by_group), ("By seed", &results.by_seed)] {
        if groups.len() > 1 {
            blocks.extend([heading(title), group_table(groups)]);
        }
    }
    if results.by_seed.len() > 1 {
        blocks.push(Block::Text(over_seeds(&results.by_seed)));
    }
    blocks.extend([heading("By what was to be held"), targets(results, is_page)]);
    blocks
}

fn table_or_none(head: &[&str], rows: Vec<Vec<Cell>>) -> Block {
    if rows.is_empty() { Block::Text("None.".to_owned()) } else { Block::Table(Table::new(head.iter().copied(), rows)) }
}

fn outcomes(results: &Results, with_held: bool) -> Block {
    let is_failed = |(outcome, _): &(&Outcome, &u64)| **outcome != Outcome::Held;
    let failed: u64 = results.outcomes.iter().filter(is_failed).map(|(_, count)| count).sum();
    let shown = results.outcomes.iter().filter(|one| with_held || is_failed(one));
    let row = |(outcome, count): (&Outcome, &u64)| {
        let of_failures = if *outcome == Outcome::Held { "–".to_owned() } else { percent_of(*count, failed) };
        vec![
            Cell::Outcome(*outcome),
            Cell::Count(*count),
            Cell::Number(of_failures),
            part(*count, results.attempts),
            Cell::note(outcome.meaning()),
        ]
    };
    table_or_none(&["outcome", "attempts", "of failures", "of all attempts", "meaning"], shown.map(row).collect())
}

fn endings(results: &Results) -> Block {
    let row = |(ending, count): (&Ending, &u64)| {
        vec![Cell::code(ending.name()), Cell::Count(*count), part(*count, results.rounds), Cell::note(ending.meaning())]
    };
    table_or_none(&["ending", "rounds", "of all rounds", "meaning"], results.endings.iter().map(row).collect())
}

/// A row each; placements that were drawn anew have a column if there are any.
fn group_table(groups: &[GroupResults]) -> Block {
    let mut head =
        vec!["what", "rounds", "not viable", "objects", "attempts", "held", "GSR (95 %)", "% cleared (95 %)"];
    let row = |group: &GroupResults| {
        let counts = [group.rounds, group.unviable, group.objects, group.attempts, group.held].map(Cell::Count);
        let name = Cell::from(group.name.as_str());
        [name].into_iter().chain(counts).chain(group_rates(&group.rates).map(bar)).collect()
    };
    let mut rows: Vec<Vec<Cell>> = groups.iter().map(row).collect();
    if groups.iter().all(|group| group.unviable == 0) {
        head.remove(2);
        rows.iter_mut().for_each(|row| drop(row.remove(2)));
    }
    Block::Table(Table::new(head, rows))
}

/// Mean and standard deviation over seeds, as GIGA reports its rates.
fn over_seeds(seeds: &[GroupResults]) -> String {
    let told = |rate: fn(&Rates) -> Option<Interval>| {
        let rates: Vec<f64> =
            seeds.iter().filter_map(|seed| rate(&seed.rates)).map(|rate| 100.0 * rate.value).collect();
        let mean = rates.iter().sum::<f64>() / rates.len() as f64;
        let variance = rates.iter().map(|rate| (rate - mean) * (rate - mean)).sum::<f64>() / rates.len() as f64;
        if rates.is_empty() { "–".to_owned() } else { format!("{mean:.1} ± {:.1} %", variance.sqrt()) }
    };
    let (success, cleared) = (told(|rates| rates.success_rate), told(|rates| rates.cleared_share));
    format!("Mean and standard deviation over {} seeds: GSR {success}, % cleared {cleared}.", seeds.len())
}

fn targets(results: &Results, hardest_first: bool) -> Block {
    let mut targets: Vec<_> = results.by_target.iter().collect();
    if hardest_first {
        let rate = |of: &TargetResults| of.held as f64 / of.attempts.max(1) as f64;
        targets.sort_by(|a, b| rate(a).total_cmp(&rate(b)).then_with(|| a.name.cmp(&b.name)));
    }
    let row = |of: &TargetResults| {
        vec![Cell::code(&of.name), Cell::Count(of.attempts), Cell::Count(of.held), bar(of.success_rate)]
    };
    table_or_none(&["object", "attempts", "held", "GSR (95 %)"], targets.into_iter().map(row).collect())
}

/// What it takes to run an experiment again.
pub(crate) fn origin(protocol: &str, about: &About) -> [Block; 4] {
    let row = |what: &str, value: &str| vec![Cell::code(what), Cell::code(value)];
    let versions = about.versions.iter().map(|(name, version)| row(name, version));
    let rows = [row("model", &about.model_id)].into_iter().chain(versions);
    [
        Block::Heading(format!("How {protocol} was run")),
        Block::Table(Table::new(["what", "value"], rows)),
        Block::Code("sh", about.command.clone()),
        Block::Code("toml", about.config.clone()),
    ]
}

fn bar(rate: Option<Interval>) -> Cell {
    Cell::Bar(rate.map_or(0.0, |rate| rate.value), share(rate))
}

fn part(part: u64, whole: u64) -> Cell {
    Cell::Bar(part as f64 / whole.max(1) as f64, percent_of(part, whole))
}

pub(crate) fn share(interval: Option<Interval>) -> String {
    let Some(Interval { value, low, high }) = interval else { return "–".to_owned() };
    format!("{:.1} % ({:.1} to {:.1})", 100.0 * value, 100.0 * low, 100.0 * high)
}

fn percent_of(part: u64, whole: u64) -> String {
    if whole == 0 { "–".to_owned() } else { format!("{:.1} %", 100.0 * part as f64 / whole as f64) }
}

fn times(percentiles: Option<Percentiles>) -> String {
    let Some(Percentiles { p50, p90, p99 }) = percentiles else { return "–".to_owned() };
    format!("{p50:.1} / {p90:.1} / {p99:.1}")
}

fn mean(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.1}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::results;

    fn interval(value: f64, low: f64, high: f64) -> Option<Interval> {
        Some(Interval { value, low, high })
    }

    fn group(name: &str, held: u64, unviable: u64) -> GroupResults {
        let rates = Rates {
            success_rate: interval(0.5, 0.25, 0.75),
            cleared_share: interval(0.75, 0.5, 1.0),
            rounds_cleared_share: None,
        };
        GroupResults { name: name.to_owned(), rounds: 2, unviable, objects: 4, attempts: 5, held, rates }
    }

    /// Made by hand, so that the text does not depend on how intervals are drawn.
    fn small(protocol: &str) -> Results {
        Results {
            protocol: protocol.to_owned(),
            rounds: 4,
            objects: 8,
            attempts: 10,
            held: 6,
            removed: 6,
            rates: Rates {
                success_rate: interval(0.6, 0.412, 0.75),
                cleared_share: interval(0.75, 0.5, 1.0),
                rounds_cleared_share: interval(0.5, 0.0, 1.0),
            },
            endings: [(Ending::Cleared, 2), (Ending::Failures, 2)].into(),
            outcomes: [(Outcome::Empty, 1), (Outcome::Slipped, 3), (Outcome::Held, 6)].into(),
            by_group: vec![group("hard", 2, 1), group("easy", 2, 0)],
            by_seed: Vec::new(),
            by_target: vec![
                TargetResults {
                    name: "cuboid".to_owned(),
                    attempts: 8,
                    held: 4,
                    success_rate: interval(0.5, 0.25, 0.687),
                },
                TargetResults {
                    name: "cylinder".to_owned(),
                    attempts: 2,
                    held: 2,
                    success_rate: interval(1.0, 1.0, 1.0),
                },
            ],
            plan_ms: Some(Percentiles { p50: 20.5, p90: 31.5, p99: 40.0 }),
            observe_ms: Some(Percentiles { p50: 50.0, p90: 60.0, p99: 70.5 }),
            planned_per_trial_mean: Some(12.5),
        }
    }

    fn about() -> About {
        let versions = [("experiments", "0.2.0"), ("rapier3d", "0.36.1")];
        About {
            command: "graspmill experiment run configs/experiment/pile.toml".to_owned(),
            config: "seed = 1\nname = \"```\"\n".to_owned(),
            model_id: "c0ffee".to_owned(),
            versions: versions.map(|(name, version)| (name.to_owned(), version.to_owned())).into(),
        }
    }

    fn report(results: Results) -> Report {
        Report { results, about: about() }
    }

    const PAGE: &str = r#"# Experiment pile

| protocol | rounds | attempts | GSR (95 %) | % cleared (95 %) | rounds cleared (95 %) | planning ms, p50 / p90 / p99 |
|---|---:|---:|---:|---:|---:|---:|
| pile | 4 | 10 | 60.0 % (41.2 to 75.0) | 75.0 % (50.0 to 100.0) | 50.0 % (0.0 to 100.0) | 20.5 / 31.5 / 40.0 |

GSR, the grasp success rate: attempts that held, of all attempts. % cleared, also called DR: objects removed, of those at the beginning. Intervals: 95 %, bootstrap over rounds, 2000 draws.
An interval without width means that all rounds ended alike, not that the rate is certain.

pile: 6 of 10 attempts held, 6 of 8 objects were removed.
Rendering the views took 50.0 / 60.0 / 70.5 ms (p50 / p90 / p99); a plan gave 12.5 grasps on average.

## Failures by outcome, pile

| outcome | attempts | of failures | of all attempts |
|---|---:|---:|---:|
| empty | 1 | 25.0 % | 10.0 % |
| slipped | 3 | 75.0 % | 30.0 % |

## Endings of rounds, pile

| ending | rounds | of all rounds |
|---|---:|---:|
| cleared | 2 | 50.0 % |
| failures | 2 | 50.0 % |

## By scene, pile

| what | rounds | not viable | objects | attempts | held | GSR (95 %) | % cleared (95 %) |
|---|---:|---:|---:|---:|---:|---:|---:|
| hard | 2 | 1 | 4 | 5 | 2 | 50.0 % (25.0 to 75.0) | 75.0 % (50.0 to 100.0) |
| easy | 2 | 0 | 4 | 5 | 2 | 50.0 % (25.0 to 75.0) | 75.0 % (50.0 to 100.0) |

## By what was to be held, pile

| object | attempts | held | GSR (95 %) |
|---|---:|---:|---:|
| cuboid | 8 | 4 | 50.0 % (25.0 to 68.7) |
| cylinder | 2 | 2 | 100.0 % (100.0 to 100.0) |

## How pile was run

| what | value |
|---|---|
| model | c0ffee |
| experiments | 0.2.0 |
| rapier3d | 0.36.1 |

```sh
graspmill experiment run configs/experiment/pile.toml
```

````toml
seed = 1
name = "```"
````
"#;

    #[test]
    fn the_page_is_this_one() {
        assert_eq!(document(&report(small("pile"))).markdown(), PAGE);
    }

    #[test]
    fn a_page_of_nothing_has_dashes_and_no_numbers_that_are_none() {
        let page = document(&report(results("pile", &[]))).markdown();
        assert!(page.contains("| pile | 0 | 0 | – | – | – | – |\n"), "{page}");
        assert!(page.contains("## Failures by outcome, pile\n\nNone.\n"), "{page}");
        assert!(!page.contains("NaN") && !page.contains("without width"), "{page}");
    }

    #[test]
    fn the_json_has_these_keys_and_reads_back_as_the_same_numbers() {
        let text = program::json(&report(small("pile"))).unwrap();
        let read: serde_json::Value = serde_json::from_str(&text).unwrap();
        let keys = |at: &str| -> Vec<String> {
            let object = read.pointer(at).and_then(serde_json::Value::as_object).unwrap();
            let mut keys: Vec<String> = object.keys().cloned().collect();
            keys.sort();
            keys
        };
        assert_eq!(keys(""), ["about", "results"]);
        assert_eq!(keys("/about"), ["command", "config", "model_id", "versions"]);
        let wanted = "attempts by_group by_seed by_target endings held objects observe_ms outcomes plan_ms planned_per_trial_mean protocol \
                      rates removed rounds";
        assert_eq!(keys("/results").join(" "), wanted);
        assert_eq!(keys("/results/rates"), ["cleared_share", "rounds_cleared_share", "success_rate"]);
        assert_eq!(keys("/results/endings"), ["cleared", "failures"]);
        assert_eq!(read["results"]["outcomes"]["slipped"], 3);
        assert_eq!(read["results"]["rates"]["success_rate"]["low"], 0.412);
        assert_eq!(read["results"]["by_target"][0]["name"], "cuboid");
        assert_eq!(read["results"]["plan_ms"]["p50"], 20.5);
        assert_eq!(read["about"]["config"], about().config);
        let order = ["\"protocol\"", "\"rates\"", "\"by_target\"", "\"about\""].map(|key| text.find(key).unwrap());
        assert!(order.is_sorted() && text.ends_with("}\n"), "{text}");
    }

    #[test]
    fn a_comparison_names_those_that_are_apart() {
        let mut best = small("ours");
        best.rates.success_rate = interval(0.9, 0.76, 0.97);
        let touching = Results { protocol: "touching".to_owned(), ..small("") };
        let nothing = results("nothing", &[]);
        let text = comparison(&[small("vgn"), best.clone(), touching.clone(), nothing]).markdown();
        let rows: Vec<&str> = text.lines().filter(|line| line.starts_with("| ")).collect();
        assert_eq!(rows.len(), 5, "{text}");
        assert!(rows[2].starts_with("| ours | 4 | 10 | 90.0 % (76.0 to 97.0) | 75.0 %"), "{text}");
        let end = "GSR intervals that do not overlap:\n\n\
                   - ours, 90.0 % (76.0 to 97.0), is above vgn, 60.0 % (41.2 to 75.0)\n\
                   - ours, 90.0 % (76.0 to 97.0), is above touching, 60.0 % (41.2 to 75.0)\n";
        assert!(text.ends_with(end), "{text}");
        best.rates.success_rate = interval(0.9, 0.75, 0.97);
        let end = "\nNo GSR interval is above another.\n";
        assert!(comparison(&[best, touching]).markdown().ends_with(end));
    }

    #[test]
    fn experiments_on_the_same_scenes_stand_side_by_side() {
        let text = comparison(&[small("ours"), small("vgn")]).markdown();
        assert!(
            text.contains("| scene | ours: held of attempts | GSR (95 %) | vgn: held of attempts | GSR (95 %) |"),
            "{text}"
        );
        let row = "| hard | 2 of 5 | 50.0 % (25.0 to 75.0) | 2 of 5 | 50.0 % (25.0 to 75.0) |";
        assert!(text.contains(row), "{text}");
        let other = Results { by_group: vec![group("alone", 1, 0)], ..small("other") };
        assert!(!comparison(&[small("ours"), other]).markdown().contains("| scene |"));
    }

    #[test]
    fn in_short_an_experiment_is_its_rates_with_their_protocol() {
        let text = in_short(&small("pile"));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 6, "{text}");
        assert_eq!(lines[0], "pile, 4 rounds; rates with 95 % intervals");
        assert!(
            lines[2].starts_with("grasps that held (GSR)") && lines[2].ends_with("60.0 % (41.2 to 75.0)  6 of 10"),
            "{text}"
        );
        assert!(lines[3].ends_with("6 of 8") && lines[4].ends_with("of 4"), "{text}");
    }

    #[test]
    fn seeds_are_told_by_mean_and_deviation() {
        let mut seeds = vec![group("seed 0", 1, 0), group("seed 1", 1, 0)];
        seeds[1].rates.success_rate = interval(0.7, 0.5, 0.9);
        let told = "Mean and standard deviation over 2 seeds: GSR 60.0 ± 10.0 %, % cleared 75.0 ± 0.0 %.";
        assert_eq!(over_seeds(&seeds), told);
        let page = document(&report(Results { by_seed: seeds, ..small("pile") })).markdown();
        assert!(page.contains("## By seed, pile") && page.contains(told), "{page}");
    }
}
