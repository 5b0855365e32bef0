//! The card of a pipeline's weights.

use experiments::report::Report;
use network::checkpoint;
use program::Failure;
use report::document::{Block, Cell, Document, Table};
use shards::Dataset;

use super::steps::{Pipeline, ROUNDS, Step};
use crate::experiment::page::share;

/// The card of the weights: what they learned from, and how they fare.
///
/// # Errors
/// If a result of a step cannot be read.
pub(crate) fn card(pipeline: &Pipeline, steps: &[Step]) -> Result<String, Failure> {
    let row = |key: &str, value: String| vec![Cell::from(key), Cell::from(value)];
    let mut about = Table::new(["", ""], [row("gripper", pipeline.gripper.clone())]);
    about.rows.push(row("seen from", pipeline.views.name().to_owned()));
    about.rows.push(row("SHA-256 of judge.safetensors", checkpoint::read_digested(&pipeline.weights())?.1));
    let mut rounds = Table::new(["experiment", "grasps that held", "cleared"], []);
    for step in steps {
        let name = step.out.file_name().unwrap_or_default().to_string_lossy();
        if step.is("generate") {
            let dataset = Dataset::open(step.out.as_path())?;
            about.rows.push(row(&name, format!("{} attempts, {}", dataset.info().attempt_count, dataset.id())));
        } else if step.is("experiment") {
            let rates = Report::read(&step.out)?.results.rates;
            let row = [name.into(), share(rates.success_rate), share(rates.cleared_share)];
            rounds.rows.push(row.map(Cell::from).into());
        }
    }
    let text = "Weights of a judge: they say of a grasp in a scene how the attempt would end. Beside this file are its \
                evaluation on attempts that it never saw, test-report/evaluation.md, and the experiments' pages.";
    let blocks = vec![
        Block::Text(text.to_owned()),
        Block::Table(about),
        Block::Text(format!("{ROUNDS} simulated rounds each, with 95 % intervals by bootstrap over rounds:")),
        Block::Table(rounds),
        Block::Heading("Made by".to_owned()),
        Block::Code("bash", steps.iter().map(|step| step.command() + "\n").collect()),
    ];
    Ok(Document { title: "A judge of grasps".to_owned(), blocks, ..Document::default() }.markdown())
}
