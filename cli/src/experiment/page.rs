//! Experiments that were run as one description, which becomes a page and a terminal's text: rates with their
//! intervals, why attempts failed, and how it was run. Several experiments are more rows of the same tables.
//!
//! A success rate without its protocol is a rumour: every row says whose numbers it holds.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use experiments::config::Config;
use experiments::failures::failures;
use experiments::offer::Plans;
use experiments::record::{Ending, Round};
use experiments::report::{About, Report, finish};
use experiments::run::run;
use experiments::statistics::{GroupResults, Interval, Percentiles, Rates, Results};
use inspect::failure_page;
use program::text::{grouped, percent};
use program::{Failure, FolderLock, write};
use report::document::{Block, Cell, Document, Table};
use schema::Outcome;

const LEAD: &str = "Grasp success rate, GSR: attempts that held, of all attempts. Declutter rate, DR: objects removed, \
                    of those at the beginning. Intervals: 95 %, by bootstrap over whole rounds, because grasps of one \
                    round fail together. Times: p50 / p90 / p99.";
const HEAD: [&str; 9] =
    ["experiment", "rounds", "objects", "attempts", "held", "GSR (95 %)", "DR (95 %)", "rounds cleared", "ms a plan"];
/// The page in an experiment's folder.
pub(crate) const PAGE: &str = "report.html";
/// Failures that have a page, 50 to 150 kB each, spread over all.
const REPLAYS_MAX: usize = 24;
/// Of fewer rounds a bootstrap says little.
const ROUNDS_MIN: u64 = 30;

/// An experiment that was run, and what it is called.
#[derive(Debug)]
struct Played {
    name: String,
    report: Report,
}

/// The experiments in these folders, called by their protocols; where two have the same, by their folders too. The same
/// folders give the same document.
///
/// # Errors
/// If there is no experiment that is done, or its `report.json` cannot be read or is not what a run writes.
pub fn document(folders: &[PathBuf]) -> Result<Document, Failure> {
    let reports = folders.iter().map(|folder| Report::read(folder)).collect::<Result<Vec<_>, _>>()?;
    let named = |(folder, report): (&PathBuf, &Report)| {
        let protocol = &report.results.protocol;
        let is_alone = reports.iter().filter(|other| other.results.protocol == *protocol).count() == 1;
        let name = if is_alone { protocol.clone() } else { format!("{protocol} ({})", folder.display()) };
        Played { name, report: report.clone() }
    };
    Ok(described(&folders.iter().zip(&reports).map(named).collect::<Vec<_>>()))
}

/// Plays the rounds of an experiment that are missing, and writes its results and their page into its folder; `command`
/// is what the report names. Its rates with their protocol in a few lines, or nothing if it was stopped.
///
/// # Errors
/// If the folder is in use or holds another experiment, a round fails, or a file cannot be written.
pub fn play(
    config: &Config,
    planner: &dyn Plans,
    command: String,
    threads: usize,
    folder: &Path,
    stop: &AtomicBool,
    on_round: &(dyn Fn(&Round) + Sync),
) -> Result<Option<String>, Failure> {
    let _lock = FolderLock::take(folder)?;
    let rounds = run(config, planner, threads, folder, stop, on_round)?;
    if (rounds.len() as u64) < config.round_count() {
        return Ok(None);
    }
    let results = finish(config, command, planner.id(), &rounds, folder)?;
    let mut page = document(&[folder.to_owned()])?;
    page.blocks.extend(replays(config, &rounds, folder)?);
    write(&folder.join(PAGE), page.html())?;
    Ok(Some(in_short(&results)))
}

/// Grasps that failed, executed again: their pages beside this one, and links to them.
fn replays(config: &Config, rounds: &[Round], folder: &Path) -> Result<Vec<Block>, Failure> {
    let (info, failed) = failures(config, rounds, REPLAYS_MAX);
    if failed.is_empty() {
        return Ok(Vec::new());
    }
    let mut links = Vec::new();
    for (name, rows) in failed {
        let file = format!("failure-{name}.html");
        write(&folder.join(&file), failure_page(&info, &rows)?)?;
        links.push((name, file));
    }
    let text = "Some of the grasps that failed, executed again: round, attempt, and how it ended.";
    Ok(vec![Block::Heading("Failures".to_owned()), Block::Text(text.to_owned()), Block::Links(links)])
}

fn in_short(results: &Results) -> String {
    let Results { protocol, objects, attempts, held, removed, plan_ms, .. } = results;
    let [success, cleared, _] = results.rates.all().map(share);
    format!(
        "{protocol}\n\n\
         {success} of the grasps held (GSR): {held} of {attempts}\n\
         {cleared} of the objects removed (DR): {removed} of {objects}\n\
         {} ms a plan (p50 / p90 / p99)\n{}",
        times(*plan_ms),
        unanswered(results).map_or(String::new(), |told| told + "\n")
    )
}

/// What is said of rounds in which the planner gave no answer, if there are some.
fn unanswered(Results { rounds, endings, .. }: &Results) -> Option<String> {
    let silent = endings.get(&Ending::NoAnswer)?;
    Some(format!("{silent} of {rounds} rounds ended because the planner gave no answer; journal.jsonl says why."))
}

fn described(all: &[Played]) -> Document {
    let count = all.len();
    let title = match all {
        [one] if one.report.about.planner.is_empty() => format!("Experiment {}", one.name),
        [one] => format!("Experiment {}, planned by {}", one.name, one.report.about.planner),
        _ => format!("{count} experiments"),
    };
    let heading = |text: &str| Block::Heading(text.to_owned());
    let mut blocks = vec![
        Block::Text(LEAD.to_owned()),
        heading("Rates"),
        Block::Table(Table::new(HEAD, all.iter().flat_map(lines))),
        Block::Warnings(grouped_warnings(all)),
        heading("Why attempts failed"),
        counts(all, |results| &results.outcomes, Outcome::name),
        heading("How rounds ended"),
        counts(all, |results| &results.endings, Ending::name),
    ];
    blocks.extend(all.iter().flat_map(origin));
    Document { title, blocks, footer: format!("graspmill experiment report, Graspmill {}", env!("CARGO_PKG_VERSION")) }
}

/// The warnings, each once, with the experiments that it holds for.
fn grouped_warnings(all: &[Played]) -> Vec<String> {
    let texts: BTreeSet<String> = all.iter().flat_map(warnings).collect();
    let named = |text: String| {
        let names = all.iter().filter(|one| warnings(one).contains(&text)).map(|one| one.name.as_str());
        format!("{}: {text}", names.collect::<Vec<_>>().join("; "))
    };
    texts.into_iter().map(named).collect()
}

/// What would mislead a reader of an experiment's rates.
fn warnings(one: &Played) -> Vec<String> {
    let Results { rounds, rates, .. } = &one.report.results;
    let mut warnings = Vec::new();
    let mut warn = |is_so: bool, text: String| warnings.extend(is_so.then_some(text));
    warn(*rounds < ROUNDS_MIN, format!("only {rounds} rounds do not show what is rare: intervals are too narrow."));
    // The bootstrap cannot draw results that were not seen.
    let is_point = rates.all().into_iter().flatten().any(|rate| rate.low >= rate.high);
    warn(is_point, "an interval has no width: all rounds ended alike, which is not certainty.".to_owned());
    warnings.extend(unanswered(&one.report.results));
    warnings
}

/// The rows of an experiment: its own, and of several kinds of scenes or seeds those of each.
fn lines(one: &Played) -> Vec<Vec<Cell>> {
    let Results { rounds, objects, attempts, held, rates, by_group, by_seed, plan_ms, .. } = &one.report.results;
    let own = line(one.name.clone(), [*rounds, *objects, *attempts, *held], rates, times(*plan_ms));
    let part = |part: &GroupResults| {
        let GroupResults { name, rounds, objects, attempts, held, rates } = part;
        line(format!("– {name}"), [*rounds, *objects, *attempts, *held], rates, String::new())
    };
    let parts = [by_group, by_seed].into_iter().filter(|parts| parts.len() > 1).flatten();
    [own].into_iter().chain(parts.map(part)).collect()
}

/// A row of the table.
fn line(name: String, counts: [u64; 4], rates: &Rates, times: String) -> Vec<Cell> {
    let [success, cleared, whole] = rates.all();
    let bar = Cell::Bar(success.map_or(0.0, |rate| rate.value), share(success));
    let numbers = [share(cleared), share(whole), times].map(Cell::Number);
    [Cell::from(name)].into_iter().chain(counts.map(Cell::Count)).chain([bar]).chain(numbers).collect()
}

/// How often each outcome or ending came: a row for each experiment, a column for each that came.
fn counts<K: Copy + Ord>(all: &[Played], of: fn(&Results) -> &BTreeMap<K, u64>, name: fn(K) -> &'static str) -> Block {
    let found: BTreeSet<K> = all.iter().flat_map(|one| of(&one.report.results).keys().copied()).collect();
    let row = |one: &Played| {
        let counts = of(&one.report.results);
        let whole = counts.values().sum::<u64>().max(1) as f64;
        let cell = |what: &K| {
            let count = counts.get(what).copied().unwrap_or_default();
            Cell::Number(format!("{} ({})", grouped(count), percent(count as f64 / whole)))
        };
        [Cell::from(one.name.as_str())].into_iter().chain(found.iter().map(cell)).collect()
    };
    let head = ["experiment"].into_iter().chain(found.iter().map(|what| name(*what)));
    Block::Table(Table::new(head, all.iter().map(row)))
}

/// What it takes to run an experiment again.
fn origin(one: &Played) -> [Block; 4] {
    let About { command, config, planner, model_id, versions } = &one.report.about;
    let by = if planner.is_empty() { "Model".to_owned() } else { format!("Planned by {planner}, model") };
    let versions: Vec<String> = versions.iter().map(|(name, version)| format!("{name} {version}")).collect();
    [
        Block::Heading(format!("How it was run: {}", one.name)),
        Block::Text(format!("{by} {model_id}; {}.", versions.join(", "))),
        Block::Code("sh", command.clone()),
        Block::Code("toml", config.clone()),
    ]
}

/// A rate with its interval in words.
fn share(interval: Option<Interval>) -> String {
    interval.map_or("–".to_owned(), |Interval { value, low, high }| {
        format!("{} ({:.1} to {:.1})", percent(value), 100.0 * low, 100.0 * high)
    })
}

/// Percentiles of times in words.
fn times(percentiles: Option<Percentiles>) -> String {
    percentiles.map_or("–".to_owned(), |Percentiles { p50, p90, p99 }| format!("{p50:.1} / {p90:.1} / {p99:.1}"))
}

#[cfg(test)]
mod tests;
