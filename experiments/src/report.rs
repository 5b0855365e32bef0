//! An experiment as it is read: a page, the numbers, a figure, and several experiments side by side.
//!
//! A success rate without its protocol is a rumour: every table and every section says whose numbers it holds. All of
//! it is text in, text out; the caller writes the files.

mod figure;

use std::collections::BTreeMap;
use std::fmt::Write as _;

use schema::Outcome;
use serde::{Deserialize, Serialize};

pub use figure::{FigureError, svg};
pub(crate) use figure::{Row, svg_for_page};

use crate::statistics::{DRAWS, GroupResults, Interval, Percentiles, Rates, Results};

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

/// What the JSON holds.
#[derive(Serialize)]
struct Page<'a> {
    results: &'a Results,
    about: &'a About,
}

const HEADLINE: &str = "\
| protocol | rounds | attempts | GSR (95 %) | % cleared (95 %) | rounds cleared (95 %) | planning ms, p50 / p90 / p99 |
|---|---:|---:|---:|---:|---:|---:|
";

/// The results as JSON, over several lines.
#[must_use]
pub fn json(results: &Results, about: &About) -> String {
    serde_json::to_string_pretty(&Page { results, about }).unwrap_or_default() + "\n" // numbers and names: cannot fail
}

/// The results in a JSON that [`json`] wrote.
///
/// # Errors
/// If it is another text.
pub fn read(text: &str) -> Result<Results, serde_json::Error> {
    #[derive(Deserialize)]
    struct Read {
        results: Results,
    }
    serde_json::from_str::<Read>(text).map(|read| read.results)
}

/// The results in a JSON that [`json`] wrote, and where they come from.
///
/// # Errors
/// If it is another text.
pub fn read_whole(text: &str) -> Result<(Results, About), serde_json::Error> {
    #[derive(Deserialize)]
    struct Read {
        results: Results,
        about: About,
    }
    serde_json::from_str::<Read>(text).map(|read| (read.results, read.about))
}

/// The results as a page.
#[must_use]
pub fn markdown(results: &Results, about: &About) -> String {
    let protocol = cell(&results.protocol);
    let mut text = format!("# Experiment {protocol}\n\n{HEADLINE}{}\n{}", headline(results), legend());
    let by_target = results.by_target.iter().map(|target| target.success_rate);
    let groups = results.by_group.iter().chain(&results.by_seed).flat_map(|group| group_rates(&group.rates));
    if is_any_point(headline_rates(results).into_iter().chain(by_target).chain(groups)) {
        text += POINT_NOTE;
    }
    let (observe, planned) = (times(results.observe_ms), mean(results.planned_per_trial_mean));
    let times = format!("Rendering the views took {observe} ms (p50 / p90 / p99)");
    let _ = write!(text, "\n{protocol}: {} of {} attempts held, ", results.held, results.attempts);
    let _ = writeln!(text, "{} of {} objects were removed.", results.removed, results.objects);
    let _ = writeln!(text, "{times}; a plan gave {planned} grasps on average.");
    let _ = write!(text, "\n## Failures by outcome, {protocol}\n\n{}", failures(results));
    let _ = write!(text, "\n## Endings of rounds, {protocol}\n\n{}", endings(results));
    for (title, groups) in [("By scene", &results.by_group), ("By seed", &results.by_seed)] {
        if groups.len() > 1 {
            let _ = write!(text, "\n## {title}, {protocol}\n\n{}", group_table(groups));
        }
    }
    if results.by_seed.len() > 1 {
        let _ = writeln!(text, "\n{}", over_seeds(&results.by_seed));
    }
    let _ = write!(text, "\n## By what was to be held, {protocol}\n\n{}", targets(results));
    let _ = write!(text, "\n## How {protocol} was run\n\n{}", origin(about));
    text
}

/// Several experiments in a table, and which success rates are apart.
#[must_use]
pub fn comparison(results: &[Results]) -> String {
    let rows: String = results.iter().map(headline).collect();
    let mut text = format!("{HEADLINE}{rows}\n{}", legend());
    if is_any_point(results.iter().flat_map(headline_rates)) {
        text += POINT_NOTE;
    }
    text += &side_by_side(results);
    let apart = apart(results);
    if apart.is_empty() {
        text += "\nNo GSR interval is above another.\n";
    } else {
        let _ = write!(text, "\nGSR intervals that do not overlap:\n\n{apart}");
    }
    text
}

/// For each kind of scene a row, for each experiment its attempts and rate: the form of the paper's Table 4. Nothing if
/// no kind of scene is in all of them, or only one is.
fn side_by_side(results: &[Results]) -> String {
    let Some((first, others)) = results.split_first() else { return String::new() };
    let in_all = |group: &&GroupResults| others.iter().all(|r| r.by_group.iter().any(|g| g.name == group.name));
    let names: Vec<&str> = first.by_group.iter().filter(in_all).map(|group| group.name.as_str()).collect();
    if names.len() < 2 || others.is_empty() {
        return String::new();
    }
    let protocols: String =
        results.iter().map(|r| format!(" {0}: held of attempts | GSR (95 %) |", cell(&r.protocol))).collect();
    let mut text = format!("\n| scene |{protocols}\n|---|{}\n", "---:|---:|".repeat(results.len()));
    for name in names {
        let _ = write!(text, "| {} |", cell(name));
        for group in results.iter().filter_map(|r| r.by_group.iter().find(|group| group.name == name)) {
            let _ = write!(text, " {} of {} | {} |", group.held, group.attempts, share(group.rates.success_rate));
        }
        text.push('\n');
    }
    text
}

fn headline(results: &Results) -> String {
    let protocol = cell(&results.protocol);
    let rates = headline_rates(results).map(share).join(" | ");
    let (rounds, attempts, planning) = (results.rounds, results.attempts, times(results.plan_ms));
    format!("| {protocol} | {rounds} | {attempts} | {rates} | {planning} |\n")
}

fn legend() -> String {
    format!(
        "GSR, the grasp success rate: attempts that held, of all attempts. % cleared, also called DR: objects removed, \
         of those at the beginning. Intervals: 95 %, bootstrap over rounds, {DRAWS} draws.\n"
    )
}

const POINT_NOTE: &str = "An interval without width means that all rounds ended alike, not that the rate is certain.\n";

pub(crate) fn headline_rates(results: &Results) -> [Option<Interval>; 3] {
    let rates = &results.rates;
    [rates.success_rate, rates.cleared_share, rates.rounds_cleared_share]
}

pub(crate) fn is_any_point(rates: impl IntoIterator<Item = Option<Interval>>) -> bool {
    rates.into_iter().flatten().any(|interval| interval.is_point())
}

/// A line for every ordered pair whose first is above its second.
fn apart(results: &[Results]) -> String {
    let rates: Vec<_> = results.iter().map(|one| one.rates.success_rate).collect();
    let mut lines = String::new();
    for (better, worse) in comparison_of_rates(&rates) {
        let [high, low] = [better, worse].map(|at| format!("{}, {}", cell(&results[at].protocol), share(rates[at])));
        let _ = writeln!(lines, "- {high}, is above {low}");
    }
    lines
}

/// The ordered pairs, by number, whose first is above its second.
pub(crate) fn comparison_of_rates(rates: &[Option<Interval>]) -> Vec<(usize, usize)> {
    let is_above = |(better, worse): &(usize, usize)| match (rates[*better], rates[*worse]) {
        (Some(high), Some(low)) => high.is_above(&low),
        _ => false,
    };
    let pairs = (0..rates.len()).flat_map(|better| (0..rates.len()).map(move |worse| (better, worse)));
    pairs.filter(is_above).collect()
}

fn failures(results: &Results) -> String {
    let failed: Vec<_> = results.outcomes.iter().filter(|(outcome, _)| *outcome != Outcome::Held).collect();
    let failed_count: u64 = failed.iter().map(|(_, count)| count).sum();
    if failed.is_empty() {
        return "None.\n".to_owned();
    }
    let mut text = "| outcome | attempts | of failures | of all attempts |\n|---|---:|---:|---:|\n".to_owned();
    for (outcome, count) in failed {
        let (of_failures, of_all) = (percent_of(*count, failed_count), percent_of(*count, results.attempts));
        let _ = writeln!(text, "| {} | {count} | {of_failures} | {of_all} |", outcome.name());
    }
    text
}

fn endings(results: &Results) -> String {
    if results.endings.is_empty() {
        return "None.\n".to_owned();
    }
    let mut text = "| ending | rounds | of all rounds |\n|---|---:|---:|\n".to_owned();
    for (ending, count) in &results.endings {
        let _ = writeln!(text, "| {} | {count} | {} |", ending.name(), percent_of(*count, results.rounds));
    }
    text
}

fn group_rates(rates: &Rates) -> [Option<Interval>; 2] {
    [rates.success_rate, rates.cleared_share]
}

/// A row each; placements that were drawn anew have a column if there are any.
fn group_table(groups: &[GroupResults]) -> String {
    let has_unviable = groups.iter().any(|group| group.unviable > 0);
    let (head, line) = if has_unviable { (" not viable |", "---:|") } else { ("", "") };
    let mut text = format!(
        "| what | rounds |{head} objects | attempts | held | GSR (95 %) | % cleared (95 %) |\n|---|---:|{line}---:|---:|---:|---:|---:|\n"
    );
    for group in groups {
        let unviable = if has_unviable { format!(" {} |", group.unviable) } else { String::new() };
        let rates = group_rates(&group.rates).map(share).join(" | ");
        let (name, GroupResults { rounds, objects, attempts, held, .. }) = (cell(&group.name), group);
        let _ = writeln!(text, "| {name} | {rounds} |{unviable} {objects} | {attempts} | {held} | {rates} |");
    }
    text
}

/// Mean and standard deviation over seeds, as GIGA tells its rates.
pub(crate) fn over_seeds(seeds: &[GroupResults]) -> String {
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

fn targets(results: &Results) -> String {
    if results.by_target.is_empty() {
        return "None.\n".to_owned();
    }
    let mut text = "| object | attempts | held | GSR (95 %) |\n|---|---:|---:|---:|\n".to_owned();
    for target in &results.by_target {
        let (name, rate) = (cell(&target.name), share(target.success_rate));
        let _ = writeln!(text, "| {name} | {} | {} | {rate} |", target.attempts, target.held);
    }
    text
}

fn origin(about: &About) -> String {
    let mut text = format!("| what | value |\n|---|---|\n| model | {} |\n", cell(&about.model_id));
    for (name, version) in &about.versions {
        let _ = writeln!(text, "| {} | {} |", cell(name), cell(version));
    }
    text + "\n" + &block("sh", &about.command) + "\n" + &block("toml", &about.config)
}

/// Text that stands in a table's cell or a heading, whatever it is made of.
fn cell(text: &str) -> String {
    text.replace(char::is_control, " ").replace('|', "\\|")
}

/// A code block, fenced with more backticks than the code has in a row.
fn block(language: &str, code: &str) -> String {
    let longest = code.split(|letter| letter != '`').map(str::len).max().unwrap_or(0);
    let fence = "`".repeat(3.max(longest + 1));
    format!("{fence}{language}\n{}\n{fence}\n", code.trim_end())
}

pub(crate) fn share(interval: Option<Interval>) -> String {
    let Some(Interval { value, low, high }) = interval else { return "–".to_owned() };
    format!("{:.1} % ({:.1} to {:.1})", 100.0 * value, 100.0 * low, 100.0 * high)
}

pub(crate) fn percent_of(part: u64, whole: u64) -> String {
    if whole == 0 { "–".to_owned() } else { format!("{:.1} %", 100.0 * part as f64 / whole as f64) }
}

fn times(percentiles: Option<Percentiles>) -> String {
    let Some(Percentiles { p50, p90, p99 }) = percentiles else { return "–".to_owned() };
    format!("{p50:.1} / {p90:.1} / {p99:.1}")
}

pub(crate) fn mean(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.1}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Ending;
    use crate::statistics::{TargetResults, results};

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
    pub(super) fn small(protocol: &str) -> Results {
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
            endings: vec![(Ending::Cleared, 2), (Ending::Failures, 2)],
            outcomes: vec![(Outcome::Empty, 1), (Outcome::Slipped, 3), (Outcome::Held, 6)],
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
            command: "experiments run configs/experiment/pile.toml".to_owned(),
            config: "seed = 1\nname = \"```\"\n".to_owned(),
            model_id: "c0ffee".to_owned(),
            versions: versions.map(|(name, version)| (name.to_owned(), version.to_owned())).into(),
        }
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
experiments run configs/experiment/pile.toml
```

````toml
seed = 1
name = "```"
````
"#;

    #[test]
    fn the_page_is_this_one() {
        assert_eq!(markdown(&small("pile"), &about()), PAGE);
    }

    #[test]
    fn a_page_of_nothing_has_dashes_and_no_numbers_that_are_none() {
        let page = markdown(&results("pile", &[], &[]), &about());
        assert!(page.contains("| pile | 0 | 0 | – | – | – | – |\n"), "{page}");
        assert!(page.contains("## Failures by outcome, pile\n\nNone.\n"), "{page}");
        assert!(!page.contains("NaN") && !page.contains("without width"), "{page}");
    }

    #[test]
    fn the_json_has_these_keys_and_reads_back_as_the_same_numbers() {
        let text = json(&small("pile"), &about());
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
        let nothing = results("nothing", &[], &[]);
        let text = comparison(&[small("vgn"), best.clone(), touching.clone(), nothing]);
        let rows: Vec<&str> = text.lines().filter(|line| line.starts_with("| ")).collect();
        assert_eq!(rows.len(), 5, "{text}");
        assert!(rows[2].starts_with("| ours | 4 | 10 | 90.0 % (76.0 to 97.0) | 75.0 %"), "{text}");
        let end = "GSR intervals that do not overlap:\n\n\
                   - ours, 90.0 % (76.0 to 97.0), is above vgn, 60.0 % (41.2 to 75.0)\n\
                   - ours, 90.0 % (76.0 to 97.0), is above touching, 60.0 % (41.2 to 75.0)\n";
        assert!(text.ends_with(end), "{text}");
        best.rates.success_rate = interval(0.9, 0.75, 0.97);
        let end = "\nNo GSR interval is above another.\n";
        assert!(comparison(&[best, touching]).ends_with(end));
    }

    #[test]
    fn experiments_on_the_same_scenes_stand_side_by_side() {
        let text = comparison(&[small("ours"), small("vgn")]);
        assert!(
            text.contains("| scene | ours: held of attempts | GSR (95 %) | vgn: held of attempts | GSR (95 %) |"),
            "{text}"
        );
        let row = "| hard | 2 of 5 | 50.0 % (25.0 to 75.0) | 2 of 5 | 50.0 % (25.0 to 75.0) |";
        assert!(text.contains(row), "{text}");
        let other = Results { by_group: vec![group("alone", 1, 0)], ..small("other") };
        assert!(!comparison(&[small("ours"), other]).contains("| scene |"));
    }

    #[test]
    fn seeds_are_told_by_mean_and_deviation() {
        let mut seeds = vec![group("seed 0", 1, 0), group("seed 1", 1, 0)];
        seeds[1].rates.success_rate = interval(0.7, 0.5, 0.9);
        let told = "Mean and standard deviation over 2 seeds: GSR 60.0 ± 10.0 %, % cleared 75.0 ± 0.0 %.";
        assert_eq!(over_seeds(&seeds), told);
        let page = markdown(&Results { by_seed: seeds, ..small("pile") }, &about());
        assert!(page.contains("## By seed, pile") && page.contains(told), "{page}");
    }

    #[test]
    fn names_cannot_break_a_table() {
        assert_eq!(cell("a|b\nc"), "a\\|b c");
        assert_eq!(block("sh", "x"), "```sh\nx\n```\n");
    }
}
