//! The curves of a run: loss (the paper's Fig. 3) and accuracy (Fig. 4) by epoch, as SVG. They are drawn from
//! `metrics.jsonl` alone, so a run that was stopped and resumed has the very pictures of one that was not.

use std::path::Path;

use program::{ExitCode, Failure, write};
use report::figure::{BLUE, Figure, GREEN, Line, ORANGE, Scale};
use serde_json::{Deserializer, Value};
use trainer::run_folder::{METRICS, read_metrics};

/// Draws `loss.svg` and `accuracy.svg` in a run's folder, in place of what is there. Nothing but `metrics.jsonl` is
/// read.
///
/// # Errors
/// If the metrics are damaged or cannot be read; if a picture cannot be drawn or written.
pub(crate) fn draw_curves(run: &Path) -> Result<(), Failure> {
    let damaged =
        |error| Failure::new(ExitCode::Data, format!("damaged metrics: {error}: {}", run.join(METRICS).display()));
    let text = read_metrics(run)?;
    let lines = Deserializer::from_str(&text).into_iter::<Value>();
    let epochs: Vec<Value> = lines.collect::<Result<_, _>>().map_err(damaged)?;
    write(&run.join("loss.svg"), figure(&epochs, "loss (Eq. 5)", "loss").svg())?;
    write(&run.join("accuracy.svg"), figure(&epochs, "accuracy (Eq. 6)", "accuracy").svg())
}

/// A number of each set by epoch; beside accuracies, dashes are those of always answering "failure".
fn figure(epochs: &[Value], label: &str, key: &str) -> Figure {
    let line = |name: &'static str, colour: &'static str, set: &str, key: &str| {
        // What is no number is `null`.
        let points = epochs.iter().filter_map(|epoch| Some([epoch["epoch"].as_f64()?, epoch[set][key].as_f64()?]));
        Line { name, colour, is_dashed: key == "baseline_accuracy", points: points.collect() }
    };
    let mut lines = vec![
        line("train", BLUE, "train", key),
        line("test attempts", ORANGE, "test_attempts", key),
        line("test scenes", GREEN, "test_scenes", key),
    ];
    if key == "accuracy" {
        lines.push(line("always \"failure\"", ORANGE, "test_attempts", "baseline_accuracy"));
        lines.push(line("", GREEN, "test_scenes", "baseline_accuracy"));
    }
    let values = || lines.iter().flat_map(|line| &line.points).map(|point| point[1]);
    let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
    let ends = if low <= high { [low, high] } else { [0.0, 1.0] };
    let x = Scale::around("epoch", [0.0, epochs.len() as f64], 1.0);
    Figure { x, y: Scale::around(label, ends, 0.0), lines }
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
    fn damaged_metrics_are_told() {
        let run = tempfile::tempdir().unwrap();
        fs::write(run.path().join(METRICS), line(1) + "{\"epoch\": 2").unwrap();
        let error = draw_curves(run.path()).unwrap_err();
        assert!(error.to_string().contains("line 2"), "{error}");
        assert_eq!(error.exit_code(), ExitCode::Data);
        fs::write(run.path().join(METRICS), b"\xff\xfe").unwrap();
        assert_eq!(draw_curves(run.path()).unwrap_err().exit_code(), ExitCode::Data);
    }
}
