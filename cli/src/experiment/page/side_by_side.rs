//! Several experiments in tables, and which success rates are apart.

use experiments::statistics::GroupResults;
use report::document::{Block, Cell, Table};

use super::Played;
use super::sections::{bar, share, times};

/// A row for each experiment; for kinds of scenes that are in all experiments, the attempts and the rate of each
/// experiment, the form of the paper's Table 4; then the success rates that are apart.
pub(super) fn blocks(all: &[Played], names: &[String]) -> Vec<Block> {
    let mut blocks = vec![headline(all, names)];
    blocks.extend(by_scene(all, names));
    let rates: Vec<_> = names.iter().zip(all.iter().map(|one| one.results().rates.success_rate)).collect();
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

fn headline(all: &[Played], names: &[String]) -> Block {
    let row = |(one, name): (&Played, &String)| {
        let results = one.results();
        let start = [name.as_str().into(), Cell::Count(results.rounds), Cell::Count(results.attempts)];
        let rates = results.rates.all().map(|rate| Cell::Number(share(rate)));
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
    Block::Table(Table::new(head, all.iter().zip(names).map(row)))
}

fn by_scene(all: &[Played], names: &[String]) -> Option<Block> {
    let groups = |name: &str| -> Option<Vec<&GroupResults>> {
        all.iter().map(|one| one.results().by_group.iter().find(|group| group.name == name)).collect()
    };
    let cells = |group: &GroupResults| {
        [Cell::Number(format!("{} of {}", group.held, group.attempts)), bar(group.rates.success_rate)]
    };
    let rows = all.first()?.results().by_group.iter().filter_map(|scene| {
        let cells = groups(&scene.name)?.into_iter().flat_map(cells);
        Some([scene.name.as_str().into()].into_iter().chain(cells).collect::<Vec<Cell>>())
    });
    let heads = names.iter().flat_map(|name| [format!("{name}: held of attempts"), "GSR (95 %)".to_owned()]);
    let table = Table::new(["scene".to_owned()].into_iter().chain(heads), rows);
    (table.rows.len() > 1 && all.len() > 1).then_some(Block::Table(table))
}
