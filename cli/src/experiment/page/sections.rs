//! The sections of an experiment's page: counts with their tables, and how it was run.

use experiments::report::About;
use experiments::statistics::{GroupResults, Interval, Percentiles, Rates, Results, TargetResults};
use program::text::percent;
use report::document::{Block, Cell, Table};

/// The counts and times of an experiment.
pub(super) fn details(results: &Results) -> Vec<Block> {
    let heading = |text: &str| Block::Heading(text.to_owned());
    let planned = results.planned_per_attempt_mean.map_or("–".to_owned(), |mean| format!("{mean:.1}"));
    let mut blocks = vec![
        Block::Text(format!(
            "{} of {} attempts held, {} of {} objects were removed.\n\
             Rendering the views took {} ms (p50 / p90 / p99); a plan gave {planned} grasps on average.",
            results.held,
            results.attempts,
            results.removed,
            results.objects,
            times(results.observe_ms)
        )),
        heading("Attempts by outcome"),
        counts(
            ["outcome", "attempts", "of all attempts", "meaning"],
            results.outcomes.iter().map(|(of, count)| (Cell::Outcome(*of), *count, of.meaning())),
            results.attempts,
        ),
        heading("Endings of rounds"),
        counts(
            ["ending", "rounds", "of all rounds", "meaning"],
            results.endings.iter().map(|(of, count)| (Cell::code(of.name()), *count, of.meaning())),
            results.rounds,
        ),
    ];
    for (title, groups) in parts(results) {
        blocks.extend([heading(title), group_table(groups)]);
    }
    if !results.by_seed.is_empty() {
        blocks.push(Block::Text(over_seeds(&results.by_seed)));
    }
    blocks.extend([heading("By what was to be held"), targets(results)]);
    blocks
}

/// The partitions of an experiment's rounds that have several parts.
pub(super) fn parts(results: &Results) -> impl Iterator<Item = (&'static str, &[GroupResults])> {
    let parts = [("By scene", results.by_group.as_slice()), ("By seed", results.by_seed.as_slice())];
    parts.into_iter().filter(|(_, groups)| groups.len() > 1)
}

fn table_or_none(head: [&str; 4], rows: impl Iterator<Item = Vec<Cell>>) -> Block {
    let table = Table::new(head, rows);
    if table.rows.is_empty() { Block::Text("None.".to_owned()) } else { Block::Table(table) }
}

/// What was counted, each with its share of the whole.
fn counts(head: [&str; 4], counts: impl Iterator<Item = (Cell, u64, &'static str)>, whole: u64) -> Block {
    let row = |(what, count, meaning): (Cell, u64, &'static str)| {
        let share = count as f64 / whole.max(1) as f64;
        vec![what, Cell::Count(count), Cell::Bar(share, percent(share)), Cell::note(meaning)]
    };
    table_or_none(head, counts.map(row))
}

fn group_table(groups: &[GroupResults]) -> Block {
    let head = ["what", "rounds", "not viable", "objects", "attempts", "held", "GSR (95 %)", "% cleared (95 %)"];
    let row = |group: &GroupResults| {
        let counts = [group.rounds, group.unviable, group.objects, group.attempts, group.held].map(Cell::Count);
        let rates = [group.rates.success_rate, group.rates.cleared_share].map(bar);
        [Cell::from(group.name.as_str())].into_iter().chain(counts).chain(rates).collect()
    };
    Block::Table(Table::new(head, groups.iter().map(row)))
}

/// Mean and standard deviation over seeds, as GIGA reports its rates.
fn over_seeds(seeds: &[GroupResults]) -> String {
    let spread = |rate: fn(&Rates) -> Option<Interval>| {
        let rates: Vec<f64> = seeds.iter().filter_map(|seed| rate(&seed.rates)).map(|rate| rate.value).collect();
        let mean = rates.iter().sum::<f64>() / rates.len() as f64;
        let variance = rates.iter().map(|rate| (rate - mean) * (rate - mean)).sum::<f64>() / rates.len() as f64;
        if rates.is_empty() { "–".to_owned() } else { format!("{:.1} ± {}", 100.0 * mean, percent(variance.sqrt())) }
    };
    let (success, cleared) = (spread(|rates| rates.success_rate), spread(|rates| rates.cleared_share));
    format!("Mean and standard deviation over {} seeds: GSR {success}, % cleared {cleared}.", seeds.len())
}

/// The hardest objects first.
fn targets(results: &Results) -> Block {
    let mut targets: Vec<_> = results.by_target.iter().collect();
    let rate = |of: &TargetResults| of.success_rate.map_or(0.0, |rate| rate.value);
    targets.sort_by(|a, b| rate(a).total_cmp(&rate(b)).then_with(|| a.name.cmp(&b.name)));
    let row = |of: &TargetResults| {
        vec![Cell::code(&of.name), Cell::Count(of.attempts), Cell::Count(of.held), bar(of.success_rate)]
    };
    table_or_none(["object", "attempts", "held", "GSR (95 %)"], targets.into_iter().map(row))
}

/// What it takes to run an experiment again.
pub(super) fn origin(about: &About) -> [Block; 4] {
    let row = |what: &str, value: &str| vec![Cell::code(what), Cell::code(value)];
    let versions = about.versions.iter().map(|(name, version)| row(name, version));
    let rows = [row("model", &about.model_id)].into_iter().chain(versions);
    [
        Block::Heading("How it was run".to_owned()),
        Block::Table(Table::new(["what", "value"], rows)),
        Block::Code("sh", about.command.clone()),
        Block::Code("toml", about.config.clone()),
    ]
}

pub(super) fn bar(rate: Option<Interval>) -> Cell {
    Cell::Bar(rate.map_or(0.0, |rate| rate.value), share(rate))
}

/// A rate with its interval in words.
pub(super) fn share(interval: Option<Interval>) -> String {
    interval.map_or("–".to_owned(), |Interval { value, low, high }| {
        format!("{} ({:.1} to {:.1})", percent(value), 100.0 * low, 100.0 * high)
    })
}

/// Percentiles of times in words.
pub(super) fn times(percentiles: Option<Percentiles>) -> String {
    percentiles.map_or("–".to_owned(), |Percentiles { p50, p90, p99 }| format!("{p50:.1} / {p90:.1} / {p99:.1}"))
}
