//! The numbers of an experiment as tables.

use program::text::{grouped, percent};
use report::page::{Block, Cell, Section, Table};
use schema::Outcome;

use super::{Played, differences, pictures};
use crate::report::{mean, over_seeds, percent_of, share};
use crate::statistics::{GroupResults, Interval, Percentiles, Results};

/// What a reader wants first.
pub(super) fn tiles(results: &Results) -> Vec<(String, String)> {
    let rate = |rate: Option<Interval>| rate.map_or("–".to_owned(), |rate| percent(rate.value));
    let range = |rate: Option<Interval>| {
        rate.map_or_else(String::new, |rate| format!(", 95 %: {:.1} to {:.1}", 100.0 * rate.low, 100.0 * rate.high))
    };
    let rates = &results.rates;
    let mut tiles = vec![
        (rate(rates.success_rate), format!("of the grasps held (GSR){}", range(rates.success_rate))),
        (rate(rates.cleared_share), format!("of the objects removed{}", range(rates.cleared_share))),
        (rate(rates.rounds_cleared_share), format!("of the rounds cleared{}", range(rates.rounds_cleared_share))),
        (grouped(results.attempts), format!("grasps in {} rounds", grouped(results.rounds))),
    ];
    if let Some(times) = results.plan_ms {
        tiles.push((format!("{} ms", grouped(times.p50.round() as u64)), "a plan, half took no longer".to_owned()));
    }
    tiles
}

fn bar(rate: Option<Interval>) -> Cell {
    Cell::Bar(rate.map_or(0.0, |rate| rate.value), share(rate))
}

/// A row for each experiment.
pub(super) fn headline(all: &[Played], names: &[String]) -> Table {
    let row = |(one, name): (&Played, &String)| {
        let results = &one.results;
        let (rates, number) = (&results.rates, |count: u64| Cell::Number(grouped(count)));
        vec![
            Cell::Text(name.clone()),
            number(results.rounds),
            Cell::Number(format!("{} of {}", grouped(results.held), grouped(results.attempts))),
            Cell::Number(share(rates.success_rate)),
            Cell::Number(format!("{} of {}", grouped(results.removed), grouped(results.objects))),
            Cell::Number(share(rates.cleared_share)),
            Cell::Number(share(rates.rounds_cleared_share)),
        ]
    };
    Table {
        head: vec!["experiment", "rounds", "held", "GSR (95 %)", "removed", "objects cleared", "rounds cleared"],
        rows: all.iter().zip(names).map(row).collect(),
    }
}

/// For kinds of scenes that are in all experiments, the rate of each.
pub(super) fn by_scene_side_by_side(all: &[Played], names: &[String]) -> Option<Block> {
    let (first, others) = all.split_first()?;
    let of = |one: &Played, name: &str| one.results.by_group.iter().find(|group| group.name == name).cloned();
    let groups = first.results.by_group.iter().filter(|group| others.iter().all(|o| of(o, &group.name).is_some()));
    let scenes: Vec<&str> = groups.map(|group| group.name.as_str()).collect();
    if scenes.len() < 2 {
        return None;
    }
    let mut rows = Vec::new();
    for name in scenes {
        for (one, experiment) in all.iter().zip(names) {
            let Some(group) = of(one, name) else { continue };
            let held = Cell::Number(format!("{} of {}", group.held, group.attempts));
            let experiment = Cell::Text(experiment.clone());
            rows.push(vec![Cell::Text(name.to_owned()), experiment, held, bar(group.rates.success_rate)]);
        }
    }
    Some(Block::Table(Table { head: vec!["scene", "experiment", "held", "GSR (95 %)"], rows }))
}

/// All that is told of one experiment.
pub(super) fn of(one: &Played) -> Vec<Section> {
    let results = &one.results;
    let mut sections = vec![endings(results)];
    let parts: Vec<Block> = [("scene", &results.by_group), ("seed", &results.by_seed)]
        .into_iter()
        .filter(|(_, groups)| groups.len() > 1)
        .map(|(title, groups)| Block::Table(group_table(title, groups)))
        .collect();
    if !parts.is_empty() {
        let seeds = if results.by_seed.len() > 1 { over_seeds(&results.by_seed) } else { String::new() };
        sections.push(Section { title: "By scene and by seed".to_owned(), text: seeds, blocks: parts });
    }
    sections.push(targets(results));
    sections.extend(pictures::section(one));
    sections.push(times(results));
    sections.push(origin(one));
    sections
}

/// The same as one section, for pages that tell of several experiments.
pub(super) fn folded(name: &str, sections: Vec<Section>) -> Section {
    let mut blocks = Vec::new();
    for Section { title, text, blocks: inner } in sections {
        let stop = if text.is_empty() { "" } else { ". " };
        blocks.push(Block::Text(format!("{title}{stop}{text}")));
        blocks.extend(inner);
    }
    Section { title: name.to_owned(), text: String::new(), blocks }
}

fn endings(results: &Results) -> Section {
    let failed: u64 =
        results.outcomes.iter().filter(|(outcome, _)| *outcome != Outcome::Held).map(|(_, count)| count).sum();
    let part = |count: u64, whole: u64| Cell::Bar(count as f64 / whole.max(1) as f64, percent_of(count, whole));
    let outcome = |(outcome, count): &(Outcome, u64)| {
        let of_failures = if *outcome == Outcome::Held { "–".to_owned() } else { percent_of(*count, failed) };
        vec![
            Cell::Code(outcome.name().to_owned()),
            Cell::Number(grouped(*count)),
            part(*count, results.attempts),
            Cell::Number(of_failures),
            Cell::Text(meaning(*outcome).to_owned()),
        ]
    };
    let ending = |(ending, count): &(crate::record::Ending, u64)| {
        vec![
            Cell::Code(ending.name().to_owned()),
            Cell::Number(grouped(*count)),
            part(*count, results.rounds),
            Cell::Text(ending.meaning().to_owned()),
        ]
    };
    Section {
        title: "Why attempts failed and rounds ended".to_owned(),
        text: format!(
            "{} of {} grasps failed. A round that is not cleared ended early.",
            grouped(failed),
            grouped(results.attempts)
        ),
        blocks: vec![
            Block::Table(Table {
                head: vec!["outcome", "grasps", "of all grasps", "of failures", "meaning"],
                rows: results.outcomes.iter().map(outcome).collect(),
            }),
            Block::Table(Table {
                head: vec!["ending", "rounds", "of all rounds", "meaning"],
                rows: results.endings.iter().map(ending).collect(),
            }),
        ],
    }
}

fn meaning(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::PregraspCollision => "the open hand would have touched something before it approached",
        Outcome::ApproachCollision => "it touched something on its straight way",
        Outcome::Empty => "the fingers met on nothing",
        Outcome::Slipped => "the object stayed behind, or fell",
        Outcome::HitOther => "another object, or the table, was driven",
        Outcome::Held => "lifted, and still between the fingers",
    }
}

fn group_table(title: &'static str, groups: &[GroupResults]) -> Table {
    let row = |group: &GroupResults| {
        let number = |count: u64| Cell::Number(grouped(count));
        vec![
            Cell::Text(group.name.clone()),
            number(group.rounds),
            number(group.objects),
            number(group.attempts),
            number(group.held),
            bar(group.rates.success_rate),
            bar(group.rates.cleared_share),
            number(group.unviable),
        ]
    };
    let mut head =
        vec![title, "rounds", "objects", "grasps", "held", "GSR (95 %)", "objects cleared", "scenes drawn anew"];
    let mut rows: Vec<Vec<Cell>> = groups.iter().map(row).collect();
    if groups.iter().all(|group| group.unviable == 0) {
        head.pop();
        rows.iter_mut().for_each(|row| drop(row.pop()));
    }
    Table { head, rows }
}

fn targets(results: &Results) -> Section {
    let mut targets: Vec<_> = results.by_target.iter().collect();
    let rate = |target: &crate::statistics::TargetResults| target.held as f64 / target.attempts.max(1) as f64;
    targets.sort_by(|a, b| rate(a).total_cmp(&rate(b)).then_with(|| a.name.cmp(&b.name)));
    let rows = targets.into_iter().map(|target| {
        let failed = Cell::Number(grouped(target.attempts - target.held));
        let [name, attempts] = [Cell::Code(target.name.clone()), Cell::Number(grouped(target.attempts))];
        vec![name, attempts, failed, bar(target.success_rate)]
    });
    Section {
        title: "What was to be held".to_owned(),
        text: "By the object that was nearest to the grasp; the hardest first.".to_owned(),
        blocks: vec![Block::Table(Table {
            head: vec!["object", "grasps", "failed", "GSR (95 %)"],
            rows: rows.collect(),
        })],
    }
}

fn times(results: &Results) -> Section {
    let row = |what: &str, times: Option<Percentiles>| {
        let told = |value: fn(&Percentiles) -> f32| {
            Cell::Number(times.as_ref().map_or("–".to_owned(), |times| format!("{:.1}", value(times))))
        };
        vec![Cell::Text(what.to_owned()), told(|t| t.p50), told(|t| t.p90), told(|t| t.p99)]
    };
    Section {
        title: "Times".to_owned(),
        text: format!(
            "Milliseconds on one thread of the machine that ran it; half, nine of ten and 99 of 100 took no longer. A plan gave {} grasps on \
             average.",
            mean(results.planned_per_trial_mean)
        ),
        blocks: vec![Block::Table(Table {
            head: vec!["what", "p50", "p90", "p99"],
            rows: vec![
                row("depth images to ranked grasps", results.plan_ms),
                row("rendering the views", results.observe_ms),
            ],
        })],
    }
}

fn origin(one: &Played) -> Section {
    let row = |key: &str, value: String| vec![Cell::Code(key.to_owned()), Cell::Code(value)];
    let about = &one.about;
    let mut rows = vec![
        row("folder", one.folder.display().to_string()),
        row("command", about.command.clone()),
        row("network", about.model_id.clone()),
    ];
    rows.extend(about.versions.iter().map(|(name, version)| row(name, version.clone())));
    rows.extend(one.stage.iter().flat_map(|stage| &stage.told).map(|(key, value)| row(key, value.clone())));
    rows.extend(differences::keys(&about.config).into_iter().map(|(key, value)| row(&key, value)));
    Section {
        title: "How it was run".to_owned(),
        text: "From these the rounds can be played again: the same scenes, grasps and outcomes.".to_owned(),
        blocks: vec![Block::Table(Table { head: vec!["key", "value"], rows })],
    }
}
