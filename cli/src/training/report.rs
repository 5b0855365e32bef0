//! An evaluation as a folder that can be shown: a page, the numbers, two figures.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use program::{Context, Failure, json, write};
use report::document::{Block, Cell, Document, Picture, Table};
use report::figure::{BLUE, Bars, Figure, GREEN, GREY, Line, ORANGE, Scale, Stroke};
use trainer::evaluate::Evaluation;
use trainer::judge::scores::{HandScores, RobustnessScores, Scores};
use trainer::metrics::Summary;
use trainer::scores::{BINS, Spread};

/// Writes `evaluation.md`, `evaluation.json`, and `precision_recall.svg` and `calibration.svg` into a folder,
/// which is made if it is not there, in place of what these files held.
///
/// # Errors
/// If a file cannot be written, or a figure cannot be drawn.
pub(crate) fn write_report(evaluation: &Evaluation, folder: &Path) -> Result<(), Failure> {
    fs::create_dir_all(folder).context(format_args!("failed to make {}", folder.display()))?;
    let (curve, honesty) = (precision_recall(evaluation), calibration(evaluation));
    for (name, bytes) in [
        ("evaluation.md", document(evaluation).markdown().into_bytes()),
        ("evaluation.json", json(evaluation)?.into_bytes()),
        ("precision_recall.svg", curve.svg()?.into_bytes()),
        ("calibration.svg", honesty.svg()?.into_bytes()),
    ] {
        write(&folder.join(name), bytes)?;
    }
    Ok(())
}

fn precision_recall(evaluation: &Evaluation) -> Figure {
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

fn calibration(evaluation: &Evaluation) -> Figure {
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

/// The evaluation's numbers and figures; `evaluation.md` and a terminal show them.
pub(crate) fn document(evaluation: &Evaluation) -> Document {
    Document { title: "Evaluation".to_owned(), blocks: blocks(evaluation), footer: String::new() }
}

fn blocks(evaluation: &Evaluation) -> Vec<Block> {
    let heading = |text: &str| Block::Heading(text.to_owned());
    let counts = evaluation.all.confusion;
    let confusion = |what: &str, counts: [u64; 2]| [vec![what.into()], counts.map(Cell::Count).to_vec()].concat();
    let confusion = Table::new(
        ["", "predicted held", "predicted failed"],
        [
            confusion("held", [counts.true_positive, counts.false_negative]),
            confusion("failed", [counts.false_positive, counts.true_negative]),
        ],
    );
    let mut curve = Picture::figure(
        precision_recall(evaluation),
        "From the surest grasps (left) to all of them (right). The dashes are what chance gives.",
    );
    curve.file = Some("precision_recall.svg");
    let mut honesty = Picture::figure(
        calibration(evaluation),
        "Dots on the dashes: the quality is the probability of success. Below: overconfident. Bars: 95 % of each bin.",
    );
    (honesty.title, honesty.file) = ("Calibration".to_owned(), Some("calibration.svg"));
    let qualities = Picture::figure(
        qualities(evaluation),
        "The number of attempts by quality, those that held below those that failed.",
    );
    let mut blocks = vec![Block::Table(numbers(evaluation))];
    if let Some(hands) = &evaluation.hands {
        blocks.extend([
            heading("Beside arithmetic"),
            Block::Table(arithmetic(evaluation, hands)),
            heading("By source"),
            Block::Table(groups("source", &hands.by_source)),
            heading("By views"),
            Block::Table(groups("views", &hands.by_views)),
        ]);
    }
    blocks.extend([
        heading("Confusion at ½"),
        Block::Table(confusion),
        heading("By shape"),
        Block::Table(kinds("shape", &evaluation.by_shape)),
        heading("By rule"),
        Block::Table(kinds("rule", &evaluation.by_rule)),
        heading("Precision and recall"),
        Block::Figures(vec![curve]),
        heading("Calibration"),
        Block::Figures(vec![honesty, qualities]),
        Block::Table(bins(evaluation)),
    ]);
    blocks
}

fn numbers(evaluation: &Evaluation) -> Table {
    let Evaluation { all, calibration, ranking, errors, dataset_id, trained_on, .. } = evaluation;
    let other = if trained_on == dataset_id { "the same" } else { "another" };
    let (set, samples, scenes) = (evaluation.split.description(), all.samples, evaluation.scenes);
    let text = |what: &str, value: Cell| vec![what.into(), value, Cell::note("")];
    let row = |what: &str, value: String, meaning: &str| vec![what.into(), Cell::Number(value), Cell::note(meaning)];
    let precision_recall = format!("{}, {}", number(all.precision), number(all.recall));
    let rows = [
        text("checkpoint", format!("epoch {}, step {}", evaluation.epoch, evaluation.step).into()),
        text("dataset", Cell::code(dataset_id)),
        text("trained on", Cell::code(format!("{trained_on}, {other}"))),
        text("set", format!("{set}: {samples} samples of {scenes} scenes").into()),
        row("loss (Eq. 5)", format!("{:.4}", all.loss), ""),
        row("accuracy (Eq. 6)", number(all.accuracy), "the share of right predictions"),
        row("95 % interval, samples drawn (Wilson)", range(Some(all.accuracy_95)), ""),
        row("95 % interval, scenes drawn (bootstrap)", range(evaluation.accuracy_95_by_scene), ""),
        row("accuracy of always \"failure\"", number(all.baseline_accuracy), "the share that failed"),
        row(
            "precision, recall at ½",
            precision_recall,
            "held, of those predicted to hold (quality above ½); predicted to hold, of those that held",
        ),
        row("average precision", number(ranking.average_precision), "1 is perfect, the share that held is chance"),
        row("area under the ROC curve", number(ranking.roc_auc), "1 is perfect, 0.5 is chance"),
        row(
            &format!("expected calibration error, {BINS} bins"),
            format!("{:.3}", calibration.expected_error),
            "mean distance of the quality from the share that held",
        ),
        row("Brier score", format!("{:.3}", calibration.brier), "mean squared distance of the quality from the label"),
    ];
    let grasps = || {
        let sure = &evaluation.errors_of_sure;
        [(errors, "held attempts"), (sure, "held attempts with a quality above 0.9")].into_iter().flat_map(
            |(own, which)| {
                [
                    text(&format!("error of rotation, {} {which}", own.samples), spread(own.rotation_deg, "°").into()),
                    text("… of its approach", spread(own.approach_deg, "°").into()),
                    text("… of its closing direction", spread(own.closing_deg, "°").into()),
                    text("… to the nearest that grips the object", spread(own.nearest_closing_deg, "°").into()),
                    text("error of width, the same", spread(own.width_mm, " mm").into()),
                ]
            },
        )
    };
    let more = evaluation.hands.as_ref().map_or_else(|| grasps().collect(), hand_rows);
    Table::new(["what", "value", "meaning"], rows.into_iter().chain(more))
}

/// What only a judge's evaluation has.
fn hand_rows(hands: &HandScores) -> Vec<Vec<Cell>> {
    let HandScores { table_free, scenes_with_held, best_held, robustness, .. } = hands;
    let (precision_95, best_95) = (range(hands.average_precision_95_by_scene), range(hands.best_held_95));
    let row = |what: &str, value: String, meaning: &str| vec![what.into(), Cell::Number(value), Cell::note(meaning)];
    let [accuracy, auc, precision] =
        [table_free.all.accuracy, table_free.roc_auc, table_free.average_precision].map(number);
    let robust = robustness.map(|robust| {
        let RobustnessScores { attempts, mean, mean_expected, mean_error, mean_error_of_mean } = robust;
        row(
            &format!("robustness: mean error, {attempts} attempts that were repeated"),
            number(Some(mean_error)),
            &format!(
                "mean share of repeats that held {}, expected {}; answering {0} for all, the error is {}",
                number(Some(mean)),
                number(Some(mean_expected)),
                number(Some(mean_error_of_mean))
            ),
        )
    });
    let rows = [
        row(
            &format!("accuracy, {} attempts that do not hit the table", table_free.all.samples),
            accuracy,
            &format!("always \"failure\": {}", number(table_free.all.baseline_accuracy)),
        ),
        row(
            "area under the ROC curve, average precision, the same",
            format!("{auc}, {precision}"),
            &format!("average precision, 95 % interval, scenes drawn (bootstrap): {precision_95}"),
        ),
        row(
            &format!("best hand of a scene holds, {scenes_with_held} scenes"),
            number(*best_held),
            &format!("of the scenes in which some attempt held; 95 % interval {best_95}"),
        ),
    ];
    rows.into_iter().chain(robust).collect()
}

/// The judge beside what arithmetic gives without a network.
fn arithmetic(evaluation: &Evaluation, hands: &HandScores) -> Table {
    let Evaluation { all, ranking, .. } = evaluation;
    let free = &hands.table_free.all;
    let row = |who: &str, values: [Option<f64>; 4]| {
        [vec![who.into()], values.map(|value| Cell::Number(number(value))).to_vec()].concat()
    };
    let judge = [all.accuracy, free.accuracy, ranking.roc_auc, ranking.average_precision];
    let rows = hands
        .arithmetic
        .iter()
        .map(|it| row(it.asked, [it.accuracy, it.accuracy_table_free, it.roc_auc, it.average_precision]));
    let always = row("always \"failure\"", [all.baseline_accuracy, free.baseline_accuracy, None, None]);
    let head = ["who answers", "accuracy", "off the table", "area under ROC", "average precision"];
    Table::new(head, [always].into_iter().chain(rows).chain([row("the judge", judge)]))
}

fn groups(title: &str, groups: &BTreeMap<&'static str, Scores>) -> Table {
    let row = |(name, scores): (&&'static str, &Scores)| {
        let Scores { all, roc_auc, average_precision, calibration_error } = scores;
        vec![
            (*name).into(),
            Cell::Count(all.samples),
            Cell::Number(number(all.baseline_accuracy.map(|failed| 1.0 - failed))),
            Cell::Bar(all.accuracy.unwrap_or(0.0), number(all.accuracy)),
            Cell::Number(number(*roc_auc)),
            Cell::Number(number(*average_precision)),
            Cell::Number(format!("{calibration_error:.3}")),
        ]
    };
    let head = [title, "samples", "held", "accuracy", "area under ROC", "average precision", "calibration error"];
    Table::new(head, groups.iter().map(row))
}

fn kinds(title: &str, summaries: &BTreeMap<&'static str, Summary>) -> Table {
    let row = |(name, summary): (&&'static str, &Summary)| {
        let Summary { samples, accuracy, accuracy_95, baseline_accuracy, precision, recall, .. } = summary;
        vec![
            Cell::code(*name),
            Cell::Count(*samples),
            Cell::Bar(accuracy.unwrap_or(0.0), number(*accuracy)),
            Cell::Number(range(Some(*accuracy_95))),
            Cell::Number(number(*baseline_accuracy)),
            Cell::Number(number(*precision)),
            Cell::Number(number(*recall)),
        ]
    };
    let head = [title, "samples", "accuracy", "95 %", "always \"failure\"", "precision", "recall"];
    Table::new(head, summaries.iter().map(row))
}

fn bins(evaluation: &Evaluation) -> Table {
    let rows = evaluation.calibration.bins.iter().map(|bin| {
        vec![
            format!("{:.1} to {:.1}", bin.from, bin.from + 1.0 / BINS as f64).into(),
            Cell::Count(bin.samples),
            Cell::Number(number(bin.predicted)),
            Cell::Number(number(bin.observed)),
            Cell::Number(range(Some(bin.observed_95))),
        ]
    });
    Table::new(["quality", "samples", "mean predicted", "observed", "95 %"], rows)
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.3}"))
}

fn range(range: Option<(f64, f64)>) -> String {
    range.map_or_else(|| "–".to_owned(), |(low, high)| format!("{low:.3} to {high:.3}"))
}

fn spread(spread: Option<Spread>, unit: &str) -> String {
    let Some(Spread { mean, median, p90 }) = spread else { return "–".to_owned() };
    format!("mean {mean:.1}{unit}, median {median:.1}{unit}, nine of ten below {p90:.1}{unit}")
}
