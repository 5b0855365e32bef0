//! Early stopping: training ends after a number of epochs without a better test accuracy.

use serde::Deserialize;

/// The relevant fields of a line of `metrics.jsonl`.
#[derive(Deserialize)]
struct Line {
    is_best: bool,
}

/// Number of epochs since the best one; `lines` are those of `metrics.jsonl`, one per epoch. No other state is needed,
/// so a run that was begun without patience can resume with it.
#[must_use]
pub fn epochs_without_better(lines: &[String]) -> u32 {
    let is_best = |line: &&String| serde_json::from_str::<Line>(line).is_ok_and(|line| line.is_best);
    lines.iter().rev().take_while(|line| !is_best(line)).count() as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn epochs_are_counted_from_the_last_best() {
        let lines = |best: &[bool]| -> Vec<String> {
            best.iter().map(|is_best| format!("{{\"epoch\": 1, \"is_best\": {is_best}}}")).collect()
        };
        assert_eq!(epochs_without_better(&[]), 0);
        assert_eq!(epochs_without_better(&lines(&[true])), 0);
        assert_eq!(epochs_without_better(&lines(&[true, false, true, false, false])), 2);
    }
}
