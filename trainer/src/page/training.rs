//! How training went: curves, and the epochs as a table.

use report::document::{Block, Cell, Picture, Table};
use report::figure::{Figure, GREY, Line, Stroke};

use super::TrainedRun;
use crate::config::SplitBy;
use crate::curves::{self, Epoch, Set};
use crate::evaluate::report::number;

/// Epochs that the table shows at most; of longer runs every second, third … and the best and the last.
const ROWS_MAX: usize = 40;

/// The run's numbers that a reader wants first.
pub(super) fn tiles(run: &TrainedRun) -> Vec<(String, String)> {
    let best = best(run);
    let set = test(best);
    let mut tiles = vec![
        (best.epoch.to_string(), format!("best epoch, of {}", run.epochs.len())),
        (
            number(set.accuracy),
            format!("its accuracy on {}; always \"failure\" {}", set_name(best), number(set.baseline_accuracy)),
        ),
    ];
    let seconds: Vec<f64> = run.epochs.iter().filter_map(|epoch| epoch.seconds).collect();
    if !seconds.is_empty() {
        let sum: f64 = seconds.iter().sum();
        tiles.push((duration(sum / seconds.len() as f64), format!("an epoch on average, {} in all", duration(sum))));
    }
    tiles
}

/// The epoch that chose the best checkpoint: the last that says so, else that of the best accuracy.
pub(super) fn best(run: &TrainedRun) -> &Epoch {
    let by_accuracy = || {
        let better = |best: &Epoch, epoch: &Epoch| test(epoch).accuracy > test(best).accuracy;
        run.epochs.iter().reduce(|best, epoch| if better(best, epoch) { epoch } else { best })
    };
    run.epochs.iter().rev().find(|epoch| epoch.is_best).or_else(by_accuracy).expect("a run has an epoch")
}

/// The test set that counts.
pub(super) fn test(epoch: &Epoch) -> &Set {
    match epoch.split_by {
        Some(SplitBy::Scene) => &epoch.test_scenes,
        Some(SplitBy::Attempt) | None => &epoch.test_attempts,
    }
}

/// Its name.
pub(super) fn set_name(epoch: &Epoch) -> &'static str {
    match epoch.split_by {
        Some(SplitBy::Scene) => "held-out scenes",
        Some(SplitBy::Attempt) | None => "held-out attempts",
    }
}

pub(super) fn section(run: &TrainedRun) -> [Block; 4] {
    let best = best(run);
    let mark = |mut figure: Figure| {
        let values = || figure.lines.iter().flat_map(|line| &line.points).map(|point| point.1);
        let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        if low < high {
            let mut line = Line::new("best epoch", GREY, Stroke::Solid, Vec::new());
            line.intervals.push((f64::from(best.epoch), low, high));
            figure.lines.push(line);
        }
        figure
    };
    let shown = shown(run.epochs.len(), best.epoch as usize);
    let left_out = if shown.len() < run.epochs.len() { " The table shows some of the epochs." } else { "" };
    let (name, rest) = set_name(best).split_at(1);
    let text = format!(
        "Blue is what the network was trained on, the others it never saw: attempts of known scenes, and whole scenes. {}{rest} choose the \
         best epoch.{left_out}",
        name.to_uppercase()
    );
    let figures = vec![
        Picture::figure(
            mark(curves::loss(&run.epochs)),
            "Mean of the samples, Eq. 5. Blue falling while the others rise is overfitting.",
        ),
        Picture::figure(
            mark(curves::accuracy(&run.epochs)),
            "Share of right predictions, Eq. 6. A network is worth something where it lies above the dashes of its colour, the share of \
             attempts that failed.",
        ),
    ];
    let mut head = vec![
        "epoch",
        "loss, train",
        "test attempts",
        "test scenes",
        "accuracy, train",
        "test attempts",
        "test scenes",
        "time",
        "step size",
    ];
    let mut rows: Vec<Vec<Cell>> = shown.into_iter().map(|at| row(&run.epochs[at], best.epoch)).collect();
    if run.epochs.iter().all(|epoch| epoch.learning_rate.is_none()) {
        head.pop();
        rows.iter_mut().for_each(|row| drop(row.pop()));
    }
    [
        Block::Heading("Training".to_owned()),
        Block::Text(text),
        Block::Figures(figures),
        Block::Table(Table::new(head, rows)),
    ]
}

/// The places of the epochs that are shown.
fn shown(count: usize, best: usize) -> Vec<usize> {
    let step = count.div_ceil(ROWS_MAX).max(1);
    (0..count).filter(|at| at % step == 0 || at + 1 == best || at + 1 == count).collect()
}

fn row(epoch: &Epoch, best: u32) -> Vec<Cell> {
    let sets = [&epoch.train, &epoch.test_attempts, &epoch.test_scenes];
    let star = if epoch.epoch == best { " best" } else { "" };
    let loss = |set: &Set| Cell::Number(set.loss.map_or("–".to_owned(), |loss| format!("{loss:.4}")));
    let mut cells = vec![format!("{}{star}", epoch.epoch).into()];
    cells.extend(sets.map(loss));
    cells.extend(sets.map(|set| Cell::Number(number(set.accuracy))));
    cells.push(Cell::Number(epoch.seconds.map_or("–".to_owned(), duration)));
    cells.push(Cell::Number(epoch.learning_rate.map_or("–".to_owned(), |rate| format!("{rate:.1e}"))));
    cells
}

/// Seconds as people say them.
pub(super) fn duration(seconds: f64) -> String {
    let minutes = (seconds / 60.0).round();
    if seconds < 60.0 {
        format!("{seconds:.1} s")
    } else if seconds < 3600.0 {
        format!("{minutes} min")
    } else {
        format!("{} h {} min", (minutes / 60.0).floor(), minutes % 60.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_read_well() {
        assert_eq!([4.26, 90.0, 3570.0, 6091.0].map(duration), ["4.3 s", "2 min", "60 min", "1 h 42 min"]);
    }

    #[test]
    fn of_long_runs_some_epochs_are_shown_and_always_the_best_and_the_last() {
        assert_eq!(shown(3, 2), [0, 1, 2]);
        let some = shown(1000, 777);
        assert!(some.len() <= ROWS_MAX + 2 && some.contains(&776) && some.contains(&999), "{some:?}");
        assert!(some.is_sorted());
    }
}
