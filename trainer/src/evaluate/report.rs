//! An evaluation as a folder that can be shown: a page, the numbers, two figures.

use std::fmt::Write as _;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use program::publish;
use program::{Exit, ExitCode};

use super::Evaluation;
use crate::curves::FigureError;
use crate::metrics::Summary;
use crate::scores::{BINS, Spread};
use report::figure::{BLUE, Figure, GREY, Line, ORANGE, Scale, Stroke};

/// Why a report cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The library failed.
    #[error(transparent)]
    Figure(#[from] FigureError),
    /// The disk refused.
    #[error("failed to write the report: {source}: {}", .path.display())]
    Io {
        /// On what.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

impl Exit for ReportError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::Figure(_) => ExitCode::Internal,
            Self::Io { .. } => ExitCode::TryAgain,
        }
    }
}

/// Writes `evaluation.md`, `evaluation.json`, and `precision_recall` and `calibration` as SVG and PNG into a folder,
/// which is made if it is not there, in place of what these files held.
///
/// # Errors
/// [`ReportError`].
pub fn write_report(evaluation: &Evaluation, folder: &Path) -> Result<(), ReportError> {
    let io = |path: &Path| {
        let path = path.to_owned();
        move |source| ReportError::Io { path, source }
    };
    fs::create_dir_all(folder).map_err(io(folder))?;
    let json = serde_json::to_string_pretty(evaluation).unwrap_or_default() + "\n"; // numbers and names: cannot fail
    let mut files = vec![("evaluation.md", page(evaluation).into_bytes()), ("evaluation.json", json.into_bytes())];
    let (curve, shares) = (precision_recall(evaluation), calibration(evaluation));
    files.extend([("precision_recall.svg", curve.svg()?.into_bytes()), ("precision_recall.png", curve.png()?)]);
    files.extend([("calibration.svg", shares.svg()?.into_bytes()), ("calibration.png", shares.png()?)]);
    for (name, bytes) in files {
        let path = folder.join(name);
        publish(&path, &bytes).map_err(io(&path))?;
    }
    Ok(())
}

pub(crate) fn precision_recall(evaluation: &Evaluation) -> Figure {
    let points = &evaluation.ranking.precision_recall;
    let mut curve: Vec<(f64, f64)> = points.iter().map(|point| (point.recall, point.precision)).collect();
    if let Some((_, precision)) = curve.first().copied() {
        curve.insert(0, (0.0, precision)); // above the highest quality nothing is predicted
    }
    let counts = evaluation.all.confusion;
    let held = (counts.true_positive + counts.false_negative) as f64 / counts.count().max(1) as f64;
    let average = number(evaluation.ranking.average_precision);
    let mut lines = vec![
        Line::new(&format!("network (average precision {average})"), BLUE, Stroke::Solid, curve),
        Line::new(&format!("share that held, {held:.3}"), GREY, Stroke::Dashed, vec![(0.0, held), (1.0, held)]),
    ];
    if let (Some(recall), Some(precision)) = (evaluation.all.recall, evaluation.all.precision) {
        let point = vec![(recall, precision)];
        lines.insert(1, Line::new("quality ½", ORANGE, Stroke::Dotted, point));
    }
    Figure {
        title: "Precision and recall".to_owned(),
        x: Scale::around("recall (share of held grasps that were predicted)", 0.0, 1.0),
        y: Scale::around("precision (share of predicted that held)", 0.0, 1.0),
        lines,
        bars: Vec::new(),
    }
}

pub(crate) fn calibration(evaluation: &Evaluation) -> Figure {
    let bins = &evaluation.calibration.bins;
    let points = bins.iter().filter_map(|bin| Some((bin.predicted?, bin.observed?))).collect();
    let name = format!("network (95 % of each bin; expected error {:.3})", evaluation.calibration.expected_error);
    let mut line = Line::new(&name, BLUE, Stroke::Dotted, points);
    line.intervals = bins
        .iter()
        .filter_map(|bin| bin.predicted.map(|predicted| (predicted, bin.observed_95.0, bin.observed_95.1)))
        .collect();
    Figure {
        title: "Calibration of the grasp quality".to_owned(),
        x: Scale::around("predicted quality (mean of the bin)", 0.0, 1.0),
        y: Scale::around("observed share that held", 0.0, 1.0),
        lines: vec![line, Line::new("perfect", GREY, Stroke::Dashed, vec![(0.0, 0.0), (1.0, 1.0)])],
        bars: Vec::new(),
    }
}

fn page(evaluation: &Evaluation) -> String {
    let Evaluation { all, calibration, ranking, errors, .. } = evaluation;
    let counts = all.confusion;
    let other = if evaluation.trained_on == evaluation.dataset_id { "the same" } else { "another" };
    let mut text = String::new();
    let mut line = |line: std::fmt::Arguments<'_>| {
        let _ = writeln!(text, "{line}"); // to a string: cannot fail
    };
    line(format_args!("# Evaluation\n"));
    line(format_args!("| what | value |\n|---|---|"));
    line(format_args!("| checkpoint | epoch {}, step {} |", evaluation.epoch, evaluation.step));
    line(format_args!("| dataset | `{}` |", evaluation.dataset_id));
    line(format_args!("| trained on | `{}`, {other} |", evaluation.trained_on));
    let (set, samples, scenes) = (evaluation.split.description(), all.samples, evaluation.scenes);
    line(format_args!("| set | {set}: {samples} samples of {scenes} scenes |"));
    line(format_args!("| loss (Eq. 5) | {:.4} |", all.loss));
    line(format_args!("| accuracy (Eq. 6) | {} |", number(all.accuracy)));
    line(format_args!("| 95 % interval, samples drawn (Wilson) | {} |", range(Some(all.accuracy_95))));
    line(format_args!("| 95 % interval, scenes drawn (bootstrap) | {} |", range(evaluation.accuracy_95_by_scene)));
    line(format_args!("| accuracy of always \"failure\" | {} |", number(all.baseline_accuracy)));
    line(format_args!("| precision, recall at ½ | {}, {} |", number(all.precision), number(all.recall)));
    line(format_args!("| average precision | {} |", number(ranking.average_precision)));
    line(format_args!("| area under the ROC curve | {} |", number(ranking.roc_auc)));
    line(format_args!("| expected calibration error, {BINS} bins | {:.3} |", calibration.expected_error));
    line(format_args!("| Brier score | {:.3} |", calibration.brier));
    line(format_args!(
        "| error of rotation, {} held attempts | {} |",
        errors.samples,
        spread(errors.rotation_deg, "°")
    ));
    line(format_args!("| error of width, the same | {} |", spread(errors.width_mm, " mm")));

    line(format_args!("\n## Confusion at ½\n"));
    line(format_args!("| | predicted held | predicted failed |\n|---|---:|---:|"));
    line(format_args!("| held | {} | {} |", counts.true_positive, counts.false_negative));
    line(format_args!("| failed | {} | {} |", counts.false_positive, counts.true_negative));

    for (title, column, summaries) in
        [("By shape", "shape", &evaluation.by_shape), ("By rule", "rule", &evaluation.by_rule)]
    {
        line(format_args!("\n## {title}\n"));
        line(format_args!("| {column} | samples | accuracy | 95 % | always \"failure\" | precision | recall |"));
        line(format_args!("|---|---:|---:|---:|---:|---:|---:|"));
        for (name, summary) in summaries {
            let Summary { samples, accuracy, accuracy_95, baseline_accuracy, precision, recall, .. } = summary;
            let shares = [*accuracy, *baseline_accuracy, *precision, *recall].map(number);
            let [accuracy, baseline, precision, recall] = shares;
            let range = range(Some(*accuracy_95));
            line(format_args!("| {name} | {samples} | {accuracy} | {range} | {baseline} | {precision} | {recall} |"));
        }
    }

    line(format_args!("\n## Precision and recall\n\n![precision and recall](precision_recall.svg)"));
    line(format_args!("\n## Calibration\n\n![calibration](calibration.svg)\n"));
    line(format_args!("| quality | samples | mean predicted | observed | 95 % |\n|---|---:|---:|---:|---:|"));
    for bin in &calibration.bins {
        let (from, to, samples) = (bin.from, bin.from + 1.0 / BINS as f64, bin.samples);
        let (predicted, observed) = (number(bin.predicted), number(bin.observed));
        let range = range(Some(bin.observed_95));
        line(format_args!("| {from:.1} to {to:.1} | {samples} | {predicted} | {observed} | {range} |"));
    }
    text
}

pub(crate) fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.3}"))
}

pub(crate) fn range(range: Option<(f64, f64)>) -> String {
    range.map_or_else(|| "–".to_owned(), |(low, high)| format!("{low:.3} to {high:.3}"))
}

fn spread(spread: Option<Spread>, unit: &str) -> String {
    let Some(Spread { mean, median, p90 }) = spread else { return "–".to_owned() };
    format!("mean {mean:.1}{unit}, median {median:.1}{unit}, nine of ten below {p90:.1}{unit}")
}
