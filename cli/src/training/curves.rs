//! The curves of a run: loss (the paper's Fig. 3) and accuracy (Fig. 4) by epoch, as SVG. They are drawn from
//! `metrics.jsonl` alone, so a run that was stopped and resumed has the very pictures of one that was not.

use std::path::Path;

use program::{ExitCode, Failure, write};
use report::figure::{BLUE, Figure, GREEN, GREY, Line, ORANGE, Scale, Stroke};
use serde::Deserialize;
use trainer::run_folder::{METRICS, read_metrics};

/// What is shown of a line of `metrics.jsonl`.
#[derive(Debug, Deserialize)]
struct Epoch {
    epoch: u32,
    train: Set,
    test_attempts: Set,
    test_scenes: Set,
}

/// A set of samples after an epoch. What is no number is `null` in JSON, and `None` here.
#[derive(Debug, Deserialize)]
struct Set {
    loss: Option<f64>,
    accuracy: Option<f64>,
    baseline_accuracy: Option<f64>,
}

/// Draws `loss.svg` and `accuracy.svg` in a run's folder, in place of what is there. Nothing but `metrics.jsonl` is
/// read.
///
/// # Errors
/// If the metrics are missing, damaged or cannot be read; if a picture cannot be drawn or written.
pub(crate) fn draw_curves(run: &Path) -> Result<(), Failure> {
    let epochs = read(run)?;
    write(&run.join("loss.svg"), loss(&epochs).svg()?)?;
    write(&run.join("accuracy.svg"), accuracy(&epochs).svg()?)
}

/// The epochs of a run, at least one.
fn read(run: &Path) -> Result<Vec<Epoch>, Failure> {
    let failed = |code, text: &str| Failure::new(code, format!("{text}: {}", run.join(METRICS).display()));
    let text = read_metrics(run)?;
    let lines = text.lines().enumerate().map(|(at, line)| {
        serde_json::from_str(line)
            .map_err(|error| failed(ExitCode::Data, &format!("damaged metrics in line {}: {error}", at + 1)))
    });
    let epochs: Vec<Epoch> = lines.collect::<Result<_, _>>()?;
    if epochs.is_empty() {
        return Err(failed(ExitCode::Config, "no metrics here, a run has them after its first epoch"));
    }
    Ok(epochs)
}

/// The losses.
fn loss(epochs: &[Epoch]) -> Figure {
    figure(epochs, "Loss by epoch", "loss (Eq. 5, mean of the samples)", |set| set.loss, Vec::new())
}

/// The accuracies and those of always answering "failure".
fn accuracy(epochs: &[Epoch]) -> Figure {
    let label = "accuracy (Eq. 6, share of right predictions)";
    // Each test set has its baseline, in its colour; one grey entry in the legend says what the dashes are.
    let baseline = |colour, set: fn(&Epoch) -> &Set| {
        Line::new("", colour, Stroke::Dashed, points(epochs, set, |set| set.baseline_accuracy))
    };
    let baselines = vec![
        Line::new("always \"failure\"", GREY, Stroke::Dashed, Vec::new()),
        baseline(ORANGE, |epoch| &epoch.test_attempts),
        baseline(GREEN, |epoch| &epoch.test_scenes),
    ];
    figure(epochs, "Accuracy by epoch", label, |set| set.accuracy, baselines)
}

fn figure(epochs: &[Epoch], title: &str, label: &str, value: fn(&Set) -> Option<f64>, more: Vec<Line>) -> Figure {
    let stroke = if epochs.len() <= 60 { Stroke::Dotted } else { Stroke::Solid };
    let mut lines = vec![
        Line::new("train", BLUE, stroke, points(epochs, |epoch| &epoch.train, value)),
        Line::new("test attempts", ORANGE, stroke, points(epochs, |epoch| &epoch.test_attempts, value)),
        Line::new("test scenes", GREEN, stroke, points(epochs, |epoch| &epoch.test_scenes, value)),
    ];
    lines.extend(more);
    let (low, high) = range(&lines);
    Figure {
        title: title.to_owned(),
        x: Scale::whole("epoch", epochs.last().map_or(1, |epoch| epoch.epoch)),
        y: Scale::around(label, low, high),
        lines,
        bars: Vec::new(),
    }
}

/// The least and the greatest value of some lines; 0 to 1 if they have none.
fn range(lines: &[Line]) -> (f64, f64) {
    let values = || lines.iter().flat_map(|line| &line.points).map(|point| point.1);
    let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
    if low <= high { (low, high) } else { (0.0, 1.0) }
}

/// The value of a set by epoch, where it is a number.
fn points(epochs: &[Epoch], set: fn(&Epoch) -> &Set, value: fn(&Set) -> Option<f64>) -> Vec<(f64, f64)> {
    let points = epochs.iter().filter_map(|epoch| Some((f64::from(epoch.epoch), value(set(epoch))?)));
    points.filter(|(_, y)| y.is_finite()).collect()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn line(epoch: u32) -> String {
        let set = |loss: f64| {
            format!(
                "{{\"loss\": {loss}, \"accuracy\": {}, \"baseline_accuracy\": 0.74, \"more\": 1}}",
                1.0 - loss / 2.0
            )
        };
        let fall = 1.0 / f64::from(epoch);
        let [a, b, c] = [0.2 + 0.5 * fall, 0.3 + 0.45 * fall, 0.35 + 0.4 * fall].map(set);
        format!("{{\"epoch\": {epoch}, \"train\": {a}, \"test_attempts\": {b}, \"test_scenes\": {c}, \"later\": []}}\n")
    }

    #[test]
    fn curves_are_drawn_again_from_the_metrics_alone() {
        let run = tempfile::tempdir().unwrap();
        fs::write(run.path().join(METRICS), (1..=30).map(line).collect::<String>()).unwrap();
        draw_curves(run.path()).unwrap();
        let drawn = || ["loss.svg", "accuracy.svg"].map(|name| fs::read(run.path().join(name)).unwrap());
        let before = drawn();
        draw_curves(run.path()).unwrap();
        assert!(drawn() == before);
        let svg = fs::read_to_string(run.path().join("accuracy.svg")).unwrap();
        for words in ["train", "test attempts", "test scenes", "always", "epoch", "accuracy"] {
            assert!(svg.contains(words), "{words}");
        }
    }

    #[test]
    fn one_epoch_and_sets_without_samples_can_be_drawn() {
        let nothing = "{\"loss\": 0.0, \"accuracy\": null, \"baseline_accuracy\": null}";
        let text =
            format!("{{\"epoch\":1,\"train\":{nothing},\"test_attempts\":{nothing},\"test_scenes\":{nothing}}}\n");
        let run = tempfile::tempdir().unwrap();
        fs::write(run.path().join(METRICS), text).unwrap();
        draw_curves(run.path()).unwrap();
    }

    #[test]
    fn no_metrics_and_damaged_metrics_are_told() {
        let run = tempfile::tempdir().unwrap();
        let error = draw_curves(run.path()).unwrap_err();
        assert_eq!(error.exit_code(), ExitCode::Config);
        fs::write(run.path().join(METRICS), line(1) + "{\"epoch\": 2").unwrap();
        let error = draw_curves(run.path()).unwrap_err();
        assert!(error.to_string().contains("line 2"), "{error}");
        assert_eq!(error.exit_code(), ExitCode::Data);
        fs::write(run.path().join(METRICS), b"\xff\xfe").unwrap();
        assert_eq!(draw_curves(run.path()).unwrap_err().exit_code(), ExitCode::Data);
    }
}
