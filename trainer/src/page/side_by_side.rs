//! Several runs in one chart, their best epochs in a table, and the settings in which they differ.

use std::collections::{BTreeMap, BTreeSet};

use program::text::grouped;
use report::document::{Block, Cell, Document, Picture, Table};
use report::figure::{BLUE, Colour, Figure, GREEN, GREY, Line, ORANGE, Stroke};

use super::TrainedRun;
use super::training::{best, duration, set_name, test};
use crate::curves::{Epoch, Set, by_epoch, points, range};
use crate::evaluate::report::number;
use crate::run_folder::keys;

/// Colours of runs, which stay apart for the colour-blind (Okabe and Ito, 2008); more runs take turns.
const COLOURS: [Colour; 6] = [BLUE, ORANGE, GREEN, Colour(204, 121, 167), Colour(230, 159, 0), Colour(86, 180, 233)];

/// At least two runs side by side. The same runs give the same document.
#[must_use]
pub fn comparison(runs: &[TrainedRun]) -> Document {
    let names = names(runs);
    let caption = "On the held-out attempts or scenes that chose the run's best epoch.";
    let losses = chart("Loss by epoch", "loss, held out", runs, &names, |set| set.loss);
    let accuracies = chart("Accuracy by epoch", "accuracy, held out", runs, &names, |set| set.accuracy);
    let figures = vec![
        Picture::figure(losses, &format!("Eq. 5, mean of the samples. {caption}")),
        Picture::figure(accuracies, &format!("Eq. 6, share of right predictions. {caption}")),
    ];
    let mut blocks = vec![
        Block::Text(format!("{} runs, {}.", runs.len(), names.join(", "))),
        Block::Heading("Curves".to_owned()),
        Block::Figures(figures),
        Block::Heading("Best epochs".to_owned()),
        Block::Table(table(runs, &names)),
    ];
    let datasets: BTreeSet<Option<&str>> = runs.iter().map(|run| run.trained_on.as_deref()).collect();
    if datasets.len() > 1 {
        let warning = "The runs were trained on different datasets: their held-out samples differ, too.";
        blocks.push(Block::Warnings(vec![warning.to_owned()]));
    }
    blocks.push(Block::Heading("Settings that differ".to_owned()));
    blocks.push(differences(runs, &names));
    Document {
        title: format!("Training runs: {}", names.join(", ")),
        blocks,
        footer: format!("graspmill fit-report, Graspmill {}", env!("CARGO_PKG_VERSION")),
    }
}

/// What runs are called: by their folders; where two have the same name, by their paths.
fn names(runs: &[TrainedRun]) -> Vec<String> {
    let all: Vec<String> = runs.iter().map(TrainedRun::name).collect();
    let is_one = |name: &String| all.iter().filter(|other| *other == name).count() == 1;
    let named = |(run, name): (&TrainedRun, &String)| {
        if is_one(name) { name.clone() } else { run.path.display().to_string() }
    };
    runs.iter().zip(&all).map(named).collect()
}

fn chart(title: &str, label: &str, runs: &[TrainedRun], names: &[String], value: fn(&Set) -> Option<f64>) -> Figure {
    let line = |(at, (run, name)): (usize, (&TrainedRun, &String))| {
        let stroke = if run.epochs.len() <= 60 { Stroke::Dotted } else { Stroke::Solid };
        Line::new(name, COLOURS[at % COLOURS.len()], stroke, points(&run.epochs, test, value))
    };
    let mut lines: Vec<Line> = runs.iter().zip(names).enumerate().map(line).collect();
    let (low, high) = range(&lines);
    if low < high {
        let marks = runs.iter().map(|run| (f64::from(best(run).epoch), low, high)).collect();
        lines.push(Line { intervals: marks, ..Line::new("best epochs", GREY, Stroke::Solid, Vec::new()) });
    }
    let last = runs.iter().filter_map(|run| run.epochs.last()).map(|epoch| epoch.epoch).max().unwrap_or(1);
    by_epoch(title, label, lines, last)
}

fn table(runs: &[TrainedRun], names: &[String]) -> Table {
    let row = |(run, name): (&TrainedRun, &String)| {
        let epoch: &Epoch = best(run);
        let set = test(epoch);
        let seconds: f64 = run.epochs.iter().filter_map(|epoch| epoch.seconds).sum();
        let dataset = run.trained_on.as_deref().map_or("–", |id| id.get(..12).unwrap_or(id));
        vec![
            Cell::code(name),
            Cell::Number(number(set.accuracy)),
            Cell::Number(number(set.baseline_accuracy)),
            Cell::Number(set.loss.map_or("–".to_owned(), |loss| format!("{loss:.4}"))),
            Cell::Number(format!("{} of {}", epoch.epoch, grouped(run.epochs.len() as u64))),
            Cell::Number(if seconds > 0.0 { duration(seconds) } else { "–".to_owned() }),
            set_name(epoch).into(),
            Cell::code(dataset),
        ]
    };
    let head = ["run", "accuracy", "always \"failure\"", "loss", "best epoch", "time", "of", "trained on"];
    Table::new(head, runs.iter().zip(names).map(row))
}

/// A row for each setting and run, where runs differ.
fn differences(runs: &[TrainedRun], names: &[String]) -> Block {
    let settings = |run: &TrainedRun| run.config.as_ref().map(keys).unwrap_or_default().into_iter().collect();
    let settings: Vec<BTreeMap<String, String>> = runs.iter().map(settings).collect();
    let every: BTreeSet<&String> = settings.iter().flat_map(BTreeMap::keys).collect();
    let mut rows = Vec::new();
    for key in every.into_iter().filter(|key| settings.iter().any(|one| one.get(*key) != settings[0].get(*key))) {
        let values = settings.iter().map(|one| Cell::Code(one.get(key).map_or_else(|| "–".to_owned(), Clone::clone)));
        rows.push([Cell::code(key)].into_iter().chain(values).collect());
    }
    if rows.is_empty() {
        return Block::Text("None: the recipes are the same.".to_owned());
    }
    Block::Table(Table::new(["setting".to_owned()].into_iter().chain(names.iter().cloned()), rows))
}
