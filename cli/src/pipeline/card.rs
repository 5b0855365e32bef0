//! The card of a pipeline's weights.

use std::path::Path;

use experiments::report::Report;
use network::checkpoint;
use program::{Context, ExitCode, Failure, read};
use report::document::{Block, Cell, Document as Page, Table as PageTable};
use serde::Deserialize;
use shards::Dataset;

use super::action::{Action, Step};
use super::steps::{Pipeline, ROUNDS};
use crate::experiment::page::share;

/// Largest report of a step, in bytes.
const REPORT_BYTES_MAX: u64 = 64 << 20;

/// The card of the weights: what they learned from, and how they fare.
///
/// # Errors
/// If a result of a step cannot be read.
pub(crate) fn card(pipeline: &Pipeline, steps: &[Step]) -> Result<String, Failure> {
    let row = |key: &str, value: String| vec![Cell::from(key), Cell::from(value)];
    let digest = checkpoint::read_digested(&pipeline.weights())?.1;
    let mut rows = vec![
        row("hand", pipeline.hand.clone()),
        row("seen from", pipeline.views.name().to_owned()),
        row("SHA-256 of judge.safetensors", digest),
    ];
    let named = |folder: &Path| folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    for folder in
        steps.iter().filter_map(|step| if let Action::Generate { out, .. } = &step.action { Some(out) } else { None })
    {
        let (dataset, name) = (Dataset::open(folder.as_path())?, named(folder));
        rows.push(row(&name, format!("{} attempts, {}", dataset.info().attempt_count, dataset.id())));
    }
    let mut scores = PageTable::new(["set", "accuracy", "average precision", "calibration error"], []);
    let mut rounds = PageTable::new(["experiment", "grasps that held", "cleared"], []);
    for step in steps {
        match &step.action {
            Action::Generate { .. } | Action::Fit { .. } => {}
            Action::Evaluate { report, .. } => {
                let found = evaluated(&report.join("evaluation.json"))?.hands.table_free;
                let values = [Some(found.all.accuracy), found.average_precision, Some(found.calibration_error)];
                let number = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.3}"));
                scores.rows.push([named(report)].into_iter().chain(values.map(number)).map(Cell::from).collect());
            }
            Action::Experiment { out, .. } => {
                let rates = Report::read(out)?.results.rates;
                let rates = [rates.success_rate, rates.cleared_share].map(share);
                rounds.rows.push([named(out)].into_iter().chain(rates).map(Cell::from).collect());
            }
        }
    }
    let commands = steps.iter().map(|step| step.action.command() + "\n");
    let blocks = vec![
        Block::Text("Weights of a judge: they say of a hand in a scene how the attempt would end.".to_owned()),
        Block::Table(PageTable::new(["", ""], rows)),
        Block::Heading("On attempts that it never saw".to_owned()),
        Block::Text("Of hands that do not hit the table; 1,000 scenes of another seed.".to_owned()),
        Block::Table(scores),
        Block::Heading("In simulated rounds".to_owned()),
        Block::Text(format!("{ROUNDS} rounds each, with 95 % intervals by bootstrap over rounds.")),
        Block::Table(rounds),
        Block::Heading("Made by".to_owned()),
        Block::Code("bash", commands.collect()),
    ];
    Ok(Page { title: "A judge of hands".to_owned(), blocks, ..Page::default() }.markdown())
}

/// What the card quotes of an evaluation.
#[derive(Deserialize)]
struct Evaluated {
    hands: EvaluatedHands,
}

#[derive(Deserialize)]
struct EvaluatedHands {
    table_free: EvaluatedScores,
}

#[derive(Deserialize)]
struct EvaluatedScores {
    all: EvaluatedSummary,
    average_precision: Option<f64>,
    calibration_error: f64,
}

#[derive(Deserialize)]
struct EvaluatedSummary {
    accuracy: f64,
}

fn evaluated(path: &Path) -> Result<Evaluated, Failure> {
    let text = read(path, REPORT_BYTES_MAX).context(format_args!("failed to read {}", path.display()))?;
    serde_json::from_slice(&text)
        .map_err(|e| Failure::new(ExitCode::Data, format!("damaged results: {e}: {}", path.display())))
}
