//! Experiments that were run as a page: rates with their intervals, why attempts failed, pictures of scenes with the
//! grasps that were executed; several of them side by side.

mod differences;
mod pictures;
mod warnings;

use std::path::{Path, PathBuf};

use program::text::{grouped, percent};
use program::{ExitCode, Failure};
use report::document::{Block, Cell, Document, Drawing, Picture, Table, below};

use crate::files::json_if_there;
use crate::record::Round;
use crate::report::{Report, details, headline, headline_rates, is_any_point, origin, rates_figure, side_by_side};
use crate::run::journalled;
use crate::statistics::{DRAWS, Interval, Results};

use pictures::Stage;

/// An experiment that was run, as its folder tells of it.
#[derive(Debug)]
pub struct Played {
    folder: PathBuf,
    report: Report,
    /// None where the journal was not kept.
    rounds: Option<Vec<Round>>,
    /// `None` where `run.json` was not kept.
    stage: Option<Stage>,
}

impl Played {
    /// Reads the folder of an experiment: `report.json` and, for the pictures, `journal.jsonl`, `run.json` and
    /// `bodies.json`.
    ///
    /// # Errors
    /// If there is no experiment that is done, or a file cannot be read or is not what a run writes.
    pub fn read(folder: &Path) -> Result<Self, Failure> {
        let missing = || {
            let text = "no experiment that is done here, report.json comes after the last round";
            Failure::new(ExitCode::Config, format!("{text}: {}", folder.display()))
        };
        let report: Report = json_if_there(&folder.join("report.json"))?.ok_or_else(missing)?;
        // A run that was made shorter keeps the rounds that it does not count any more.
        let counted = |rounds: Vec<Round>| rounds.into_iter().filter(|r| r.round < report.results.rounds).collect();
        let rounds = journalled(folder)?.map(counted);
        let stage = Stage::read(folder)?;
        Ok(Self { folder: folder.to_owned(), report, rounds, stage })
    }
}

/// One or several experiments as a page. The same folders give the same document.
#[must_use]
pub fn document(all: &[Played]) -> Document {
    let names = names(all);
    let results: Vec<Results> = all.iter().map(|one| one.report.results.clone()).collect();
    let warnings = Block::Warnings(warnings::warnings(all, &names));
    let (title, mut blocks) = if let [one] = results.as_slice() {
        let lead = format!(
            "{} rounds: observe, plan, grasp; repeat until the table is empty or a stop rule applies. {} grasps were executed in \
             physics.",
            grouped(one.rounds),
            grouped(one.attempts)
        );
        (format!("Experiment: {}", one.protocol), vec![Block::Text(lead), Block::Tiles(tiles(one))])
    } else {
        let attempts: u64 = results.iter().map(|one| one.attempts).sum();
        let lead = format!("{} experiments, {} grasps executed in physics.", all.len(), grouped(attempts));
        ("Experiments side by side".to_owned(), vec![Block::Text(lead)])
    };
    blocks.extend(rates(&results, &names));
    let has_point = is_any_point(results.iter().flat_map(headline_rates));
    blocks.extend(headline(&results, &names, has_point));
    blocks.push(warnings);
    if all.len() > 1 {
        let text = "Which success rates are apart, and what was different: a rate without its protocol is a rumour.";
        blocks.extend([Block::Heading("Side by side".to_owned()), Block::Text(text.to_owned())]);
        blocks.extend(side_by_side(&results, &names));
        blocks.extend(differences::blocks(all, &names));
    }
    for (one, name) in all.iter().zip(&names) {
        let mut own = details(&one.report.results, true);
        own.extend(pictures::section(one));
        own.extend(whole_origin(one));
        if all.len() > 1 { blocks.extend(below(name, own)) } else { blocks.extend(own) }
    }
    Document { title, blocks, footer: format!("graspmill experiment report, Graspmill {}", env!("CARGO_PKG_VERSION")) }
}

/// What experiments are called: by their protocols; where two have the same, by their folders too.
fn names(all: &[Played]) -> Vec<String> {
    let name = |one: &Played| {
        let protocol = &one.report.results.protocol;
        if all.iter().filter(|other| other.report.results.protocol == *protocol).count() > 1 {
            format!("{protocol} ({})", one.folder.display())
        } else {
            protocol.clone()
        }
    };
    all.iter().map(name).collect()
}

/// What a reader wants first.
fn tiles(results: &Results) -> Vec<(String, String)> {
    let tile = |rate: Option<Interval>, what: &str| {
        let value = rate.map_or("–".to_owned(), |rate| percent(rate.value));
        let range = |rate: Interval| format!(", 95 %: {:.1} to {:.1}", 100.0 * rate.low, 100.0 * rate.high);
        (value, format!("{what}{}", rate.map(range).unwrap_or_default()))
    };
    let rates = &results.rates;
    let mut tiles = vec![
        tile(rates.success_rate, "of the grasps held (GSR)"),
        tile(rates.cleared_share, "of the objects removed"),
        tile(rates.rounds_cleared_share, "of the rounds cleared"),
        (grouped(results.attempts), format!("grasps in {} rounds", grouped(results.rounds))),
    ];
    if let Some(times) = results.plan_ms {
        tiles.push((format!("{} ms", grouped(times.p50.round() as u64)), "a plan, half took no longer".to_owned()));
    }
    tiles
}

fn rates(results: &[Results], names: &[String]) -> [Block; 3] {
    let whole = rates_figure(results.iter().zip(names).map(|(one, name)| (name.clone(), one.rates)));
    let title = whole.title.clone();
    let caption = "Disc: attempts that held, of all attempts. Ring: objects removed, of those at the beginning.";
    let mut pictures = vec![Picture::new(Drawing::Intervals(whole), title, caption)];
    if let [one] = results {
        for (title, groups) in [("By scene", &one.by_group), ("By seed", &one.by_seed)] {
            if groups.len() > 1 {
                let parts = rates_figure(groups.iter().map(|group| (group.name.clone(), group.rates)));
                let caption = "The same for parts of the rounds; their intervals are wider, for they are fewer.";
                pictures.push(Picture::new(Drawing::Intervals(parts), title, caption));
            }
        }
    }
    let text = format!(
        "Lines are 95 % intervals by bootstrap over whole rounds ({DRAWS} draws), for grasps of one round fail together. Where two \
         lines do not overlap, the difference is hardly chance."
    );
    [Block::Heading("Rates".to_owned()), Block::Text(text), Block::Figures(pictures)]
}

/// How it was run, with every key.
fn whole_origin(one: &Played) -> Vec<Block> {
    let row = |key: &str, value: String| vec![Cell::code(key), Cell::Code(value)];
    let told = one.stage.iter().flat_map(Stage::told).map(|(key, value)| row(&key, value));
    let keys = differences::keys(&one.report.about.config).into_iter().map(|(key, value)| row(&key, value));
    let rows = [row("folder", one.folder.display().to_string())].into_iter().chain(told).chain(keys);
    let text = "From these the rounds can be played again: the same scenes, grasps and outcomes.";
    let mut blocks = origin(&one.report.results.protocol, &one.report.about).to_vec();
    blocks.extend([Block::Text(text.to_owned()), Block::Table(Table::new(["key", "value"], rows))]);
    blocks
}
