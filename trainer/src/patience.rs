//! When training ends early: after so many epochs without a better test accuracy.

use serde::Deserialize;

/// What counts of a line of `metrics.jsonl`.
#[derive(Deserialize)]
struct Line {
    is_best: bool,
}

/// Epochs since the last one that was the best so far; `lines` are those of `metrics.jsonl`, one an epoch. The file is all
/// that has to be remembered, so a run that was begun without patience, or before there was any, can go on with it.
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
