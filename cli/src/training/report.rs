//! An evaluation as tables: what a terminal and `evaluation.html` show. `evaluation.json` has all of its numbers.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use program::{Context, Failure, json, write};
use report::document::{Block, Cell, Document, Table};
use trainer::evaluate::Evaluation;
use trainer::judge::scores::JudgeScores;
use trainer::metrics::Summary;
use trainer::scores::BINS;

/// Writes `evaluation.html` and `evaluation.json` into a folder, which is made if it is not there, in place of what
/// these files held.
///
/// # Errors
/// If a file cannot be written.
pub(crate) fn write_report(evaluation: &Evaluation, folder: &Path) -> Result<(), Failure> {
    fs::create_dir_all(folder).context(format_args!("failed to make {}", folder.display()))?;
    write(&folder.join("evaluation.html"), document(evaluation).html())?;
    write(&folder.join("evaluation.json"), json(evaluation)?)
}

/// The evaluation's tables.
pub(crate) fn document(evaluation: &Evaluation) -> Document {
    let mut blocks = vec![Block::Table(numbers(evaluation))];
    let mut add = |title: &str, table| blocks.extend([Block::Heading(title.to_owned()), Block::Table(table)]);
    if let Some(scores) = &evaluation.grippers {
        add("By outcome", kinds("outcome", &scores.by_outcome));
    }
    add("By shape", kinds("shape", &evaluation.by_shape));
    add("Calibration", bins(evaluation));
    Document { title: "Evaluation".to_owned(), blocks, ..Document::default() }
}

fn numbers(evaluation: &Evaluation) -> Table {
    let Evaluation { all, calibration, ranking, dataset_id, trained_on, split, scenes, .. } = evaluation;
    let (other, counts) = (if trained_on == dataset_id { "the same" } else { "another" }, all.confusion);
    let mut rows = vec![
        row("checkpoint", format!("epoch {}, step {}", evaluation.epoch, evaluation.step)),
        row("dataset", dataset_id),
        row("trained on", format!("{trained_on}, {other}")),
        row("set", format!("{}: {} samples of {scenes} scenes", split.name(), all.samples)),
        row("loss (Eq. 5)", format!("{:.4}", all.loss)),
        row("accuracy (Eq. 6)", number(all.accuracy)),
        row("95 % interval, scenes drawn (bootstrap)", range(evaluation.accuracy_95_by_scene)),
        row("accuracy of always \"failure\"", number(all.baseline_accuracy)),
        row("precision, recall at ½", format!("{}, {}", number(all.precision), number(all.recall))),
        row("held: predicted held, failed", format!("{}, {}", counts.true_positive, counts.false_negative)),
        row("failed: predicted held, failed", format!("{}, {}", counts.false_positive, counts.true_negative)),
        row("average precision", number(ranking.average_precision)),
        row("area under the ROC curve", number(ranking.roc_auc)),
        row(format!("expected calibration error, {BINS} bins"), number(Some(calibration.expected_error))),
        row("Brier score", number(Some(calibration.brier))),
    ];
    if let Some(scores) = &evaluation.grippers {
        rows.extend(of_judge(scores));
    }
    Table::new(["what", "value"], rows)
}

/// What only a judge's evaluation has.
fn of_judge(scores: &JudgeScores) -> Vec<Vec<Cell>> {
    let JudgeScores { table_free: free, scenes_with_held, best_held, best_held_95, robustness, .. } = scores;
    let mut rows = vec![
        row(format!("accuracy, {} attempts that do not hit the table", free.all.samples), number(free.all.accuracy)),
        row("average precision, the same", number(free.average_precision)),
        row("95 % interval, scenes drawn (bootstrap)", range(scores.average_precision_95_by_scene)),
        row(format!("best grasp of a scene holds, {scenes_with_held} scenes"), number(*best_held)),
        row("95 % interval (Wilson)", range(*best_held_95)),
    ];
    if let Some(robust) = robustness {
        let what = format!("robustness: mean error, {} attempts that were repeated", robust.attempts);
        let [error, of_mean] = [robust.mean_error, robust.mean_error_of_mean].map(|error| number(Some(error)));
        rows.push(row(what, format!("{error}; of the mean for all {of_mean}")));
    }
    rows
}

fn kinds(title: &str, summaries: &BTreeMap<&'static str, Summary>) -> Table {
    let head = [title, "samples", "accuracy", "95 %", "always \"failure\"", "precision", "recall"];
    let rows = summaries.iter().map(|(name, summary)| {
        let Summary { samples, accuracy, accuracy_95, baseline_accuracy, precision, recall, .. } = *summary;
        let [accuracy, baseline, precision, recall] = [accuracy, baseline_accuracy, precision, recall].map(number);
        counted(*name, samples, [accuracy, range(Some(accuracy_95)), baseline, precision, recall])
    });
    Table::new(head, rows)
}

fn bins(evaluation: &Evaluation) -> Table {
    let rows = evaluation.calibration.bins.iter().map(|bin| {
        let qualities = format!("{:.1} to {:.1}", bin.from, bin.from + 1.0 / BINS as f64);
        counted(qualities, bin.samples, [number(bin.predicted), number(bin.observed), range(Some(bin.observed_95))])
    });
    Table::new(["quality", "samples", "mean predicted", "observed", "95 %"], rows)
}

fn row(what: impl Into<String>, value: impl Into<String>) -> Vec<Cell> {
    vec![Cell::Text(what.into()), Cell::Text(value.into())]
}

/// A row of so many samples.
fn counted<const N: usize>(what: impl Into<String>, samples: u64, numbers: [String; N]) -> Vec<Cell> {
    [Cell::Text(what.into()), Cell::Count(samples)].into_iter().chain(numbers.map(Cell::Number)).collect()
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.3}"))
}

fn range(range: Option<(f64, f64)>) -> String {
    range.map_or_else(|| "–".to_owned(), |(low, high)| format!("{low:.3} to {high:.3}"))
}
