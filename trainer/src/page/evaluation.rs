//! What the best checkpoint is worth: the numbers of `evaluation.json`, as tables and figures.

use program::text::{grouped, percent};
use report::figure::{Bars, Figure, FigureError, GREEN, ORANGE, Scale};
use report::page::{Block, Cell, Picture, Section, Table};

use crate::evaluate::Evaluation;
use crate::evaluate::report::{calibration, number, precision_recall, range};
use crate::metrics::Summary;
use crate::scores::{BINS, Spread};

/// The evaluation's numbers that a reader wants first.
pub(super) fn tiles(evaluation: &Evaluation) -> Vec<(String, String)> {
    let all = &evaluation.all;
    let set = evaluation.split.description();
    vec![
        (number(all.accuracy), format!("accuracy on {set}; always “failure” {}", number(all.baseline_accuracy))),
        (number(evaluation.ranking.roc_auc), "area under the ROC curve".to_owned()),
        (format!("{:.3}", evaluation.calibration.expected_error), "expected calibration error".to_owned()),
    ]
}

pub(super) fn section(evaluation: &Evaluation) -> Result<Section, FigureError> {
    let Evaluation { all, ranking, calibration: honesty, errors, .. } = evaluation;
    let row = |what: &str, value: String, range: String| {
        vec![Cell::Text(what.to_owned()), Cell::Number(value), Cell::Text(range)]
    };
    let interval = |name: &str, found| format!("{} if {name} were drawn", range(found));
    let numbers = Table {
        head: vec!["what", "value", "95 % interval, or what it means"],
        rows: vec![
            row("loss (Eq. 5)", format!("{:.4}", all.loss), String::new()),
            row(
                "accuracy (Eq. 6)",
                number(all.accuracy),
                format!(
                    "{}, {}",
                    interval("attempts", Some(all.accuracy_95)),
                    interval("scenes", evaluation.accuracy_95_by_scene)
                ),
            ),
            row("accuracy of always “failure”", number(all.baseline_accuracy), "the share that failed".to_owned()),
            row("precision at ½", number(all.precision), "held, of those predicted to hold".to_owned()),
            row("recall at ½", number(all.recall), "predicted to hold, of those that held".to_owned()),
            row(
                "average precision",
                number(ranking.average_precision),
                "1 is perfect, the share that held is chance".to_owned(),
            ),
            row("area under the ROC curve", number(ranking.roc_auc), "1 is perfect, 0.5 is chance".to_owned()),
            row(
                "expected calibration error",
                format!("{:.3}", honesty.expected_error),
                format!("mean distance of quality and share that held, {BINS} bins"),
            ),
            row(
                "Brier score",
                format!("{:.3}", honesty.brier),
                "mean squared distance of quality and label".to_owned(),
            ),
        ],
    };
    let counts = all.confusion;
    let confusion = |what: &str, counts: [u64; 2]| {
        let [held, failed] = counts.map(|count| Cell::Number(grouped(count)));
        vec![Cell::Text(what.to_owned()), held, failed]
    };
    let confusion = Table {
        head: vec!["what happened", "predicted to hold", "predicted to fail"],
        rows: vec![
            confusion("held", [counts.true_positive, counts.false_negative]),
            confusion("failed", [counts.false_positive, counts.true_negative]),
        ],
    };
    let mut blocks = vec![Block::Table(numbers), Block::Figures(figures(evaluation)?), Block::Table(confusion)];
    blocks.push(Block::Text(format!(
        "Errors of the predicted grasps, over the {} attempts that held, for a failed one has no right grasp:",
        grouped(errors.samples as u64)
    )));
    let spread = |what: &str, spread: Option<Spread>| {
        let told =
            |value: fn(&Spread) -> f64| spread.as_ref().map_or("–".to_owned(), |of| format!("{:.1}", value(of)));
        let values = [told(|of| of.mean), told(|of| of.median), told(|of| of.p90)];
        [vec![Cell::Text(what.to_owned())], values.map(Cell::Number).to_vec()].concat()
    };
    blocks.push(Block::Table(Table {
        head: vec!["error", "mean", "median", "nine of ten below"],
        rows: vec![spread("rotation, degrees", errors.rotation_deg), spread("width, mm", errors.width_mm)],
    }));
    Ok(Section {
        title: "Evaluation".to_owned(),
        text: format!(
            "The best checkpoint (epoch {}, step {}) on {}: {} samples of {} scenes{}. A grasp is predicted to hold where its quality \
             is above ½.",
            evaluation.epoch,
            grouped(evaluation.step),
            evaluation.split.description(),
            grouped(all.samples),
            grouped(evaluation.scenes as u64),
            if evaluation.trained_on == evaluation.dataset_id {
                ""
            } else {
                " of a dataset that it was not trained on"
            },
        ),
        blocks,
    })
}

fn figures(evaluation: &Evaluation) -> Result<Vec<Picture>, FigureError> {
    let mut curve = precision_recall(evaluation);
    // On a page there is room for a word beside an axis, and the caption has the numbers.
    curve.x = Scale::around("recall", 0.0, 1.0);
    curve.y = Scale::around("precision", 0.0, 1.0);
    rename(&mut curve, &["network", "quality ½", "share that held"]);
    let mut honesty = calibration(evaluation);
    honesty.x = Scale::around("predicted quality", 0.0, 1.0);
    honesty.y = Scale::around("share that held", 0.0, 1.0);
    rename(&mut honesty, &["network", "perfect"]);
    Ok(vec![
        Picture::of(
            &curve,
            &format!(
                "From the surest grasps (left) to all of them (right). Average precision {}; the dashes are what chance gives.",
                number(evaluation.ranking.average_precision)
            ),
        )?,
        Picture::of(
            &honesty,
            &format!(
                "Dots on the dashes: the quality is the chance to hold. Below: too sure of itself. Bars: 95 % of each bin. Expected \
                 error {:.3}.",
                evaluation.calibration.expected_error
            ),
        )?,
        Picture::of(
            &qualities(evaluation),
            "How many attempts got which quality, those that held below those that failed.",
        )?,
    ])
}

/// Shorter names in the legend, in the order of the lines; a missing line (there is no point at ½ if nothing was
/// predicted) is known by its name.
fn rename(figure: &mut Figure, names: &[&str]) {
    for line in &mut figure.lines {
        if let Some(name) = names.iter().find(|name| line.name.starts_with(**name)) {
            line.name = (*name).to_owned();
        }
    }
}

fn qualities(evaluation: &Evaluation) -> Figure {
    let bins = &evaluation.calibration.bins;
    let bar = |at: usize, low: f64, high: f64| [at as f64 / BINS as f64, (at + 1) as f64 / BINS as f64, low, high];
    let held = |at: usize| bins[at].observed.unwrap_or(0.0) * bins[at].samples as f64;
    let most = bins.iter().map(|bin| bin.samples).max().unwrap_or_default();
    let bars = |name: &str, colour, bars: Vec<[f64; 4]>| Bars { name: name.to_owned(), colour, bars };
    Figure {
        title: "Qualities".to_owned(),
        x: Scale::around("predicted quality", 0.0, 1.0),
        y: Scale::around("attempts", 0.0, most.max(1) as f64),
        lines: Vec::new(),
        bars: vec![
            bars("held", GREEN, (0..bins.len()).map(|at| bar(at, 0.0, held(at))).collect()),
            bars("failed", ORANGE, (0..bins.len()).map(|at| bar(at, held(at), bins[at].samples as f64)).collect()),
        ],
    }
}

/// By shape and by rule.
pub(super) fn kinds(evaluation: &Evaluation) -> Section {
    let table = |title: &'static str, summaries: &std::collections::BTreeMap<&'static str, Summary>| {
        let row = |(name, summary): (&&'static str, &Summary)| {
            let Summary { samples, accuracy, accuracy_95, baseline_accuracy, precision, recall, .. } = summary;
            vec![
                Cell::Code((*name).to_owned()),
                Cell::Number(grouped(*samples)),
                Cell::Number(percent(1.0 - baseline_accuracy.unwrap_or(1.0))),
                Cell::Bar(accuracy.unwrap_or(0.0), number(*accuracy)),
                Cell::Number(range(Some(*accuracy_95))),
                Cell::Number(number(*baseline_accuracy)),
                Cell::Number(number(*precision)),
                Cell::Number(number(*recall)),
            ]
        };
        Table {
            head: vec![title, "samples", "held", "accuracy", "95 %", "always “failure”", "precision", "recall"],
            rows: summaries.iter().map(row).collect(),
        }
    };
    Section {
        title: "By shape and by rule".to_owned(),
        text: "Where the network is right. A bar is worth something beyond the column “always failure” only. A rule is the shape that was \
               aimed at and the object's axis of the approach."
            .to_owned(),
        blocks: vec![
            Block::Table(table("shape", &evaluation.by_shape)),
            Block::Table(table("rule", &evaluation.by_rule)),
        ],
    }
}
