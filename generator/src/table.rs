//! What a run made, as text for the person who started it.

use std::fmt::Write;
use std::path::Path;

use generator::Report;
use schema::Outcome;
use shards::text::{bar, grouped, percent, ratio};
use shards::{Counts, Finalized};

/// The table at the end of a run: the whole dataset's numbers if it is complete, else this run's; then what to do next.
pub(crate) fn render(report: &Report, dir: &Path, elapsed_s: f64) -> String {
    let mut text = String::new();
    let made = report.made.labels.attempts;
    let counts = match &report.dataset {
        Finalized::Complete(manifest) => &manifest.totals,
        Finalized::Incomplete { .. } => &report.made,
    };
    write_counts(&mut text, counts);
    if made > 0 {
        let rate = made as f64 / elapsed_s;
        line(
            &mut text,
            "speed",
            &format!("{} attempts/s ({} in {elapsed_s:.1} s)", grouped(rate as u64), grouped(made)),
        );
    }
    let shown = dir.display();
    text += "\n";
    text += &match &report.dataset {
        Finalized::Complete(_) if made == 0 => format!("complete already: {shown}\n"),
        Finalized::Complete(_) => format!("complete: {shown}\nnext: shards verify {shown} && shards report {shown}\n"),
        Finalized::Incomplete { missing } if report.is_stopped => {
            format!("stopped: {} shards are missing; run the same command again to continue\n", missing.len())
        }
        Finalized::Incomplete { missing } => {
            format!("not complete yet: {} shards are missing: {}\n", missing.len(), index_list(missing))
        }
    };
    text
}

fn write_counts(text: &mut String, counts: &Counts) {
    let labels = counts.labels;
    line(text, "attempts", &format!("{} in {} scenes", grouped(labels.attempts), grouped(counts.scenes)));
    let share = percent(labels.positive_share());
    line(text, "positive", &format!("{} · {share} · {}", grouped(labels.positives), ratio(labels)));
    for outcome in Outcome::ALL {
        let count = counts.outcome(outcome);
        let share = count as f64 / labels.attempts.max(1) as f64;
        line(text, outcome.name(), &format!("{:>9}  {:>6}  {}", grouped(count), percent(share), bar(share, 30)));
    }
    let rejected = &counts.rejections;
    let reasons = format!("{} unsettled, {} empty, {} unstable", rejected.unsettled, rejected.empty, rejected.unstable);
    line(text, "rejected scenes", &format!("{} ({reasons})", grouped(rejected.total())));
}

fn line(text: &mut String, name: &str, value: &str) {
    let _ = writeln!(text, "{name:<20}{value}");
}

/// Indices as `--shard-index` takes them.
fn index_list(indices: &[u32]) -> String {
    let mut parts: Vec<(u32, u32)> = Vec::new();
    for index in indices {
        match parts.last_mut() {
            Some((_, last)) if *last + 1 == *index => *last = *index,
            _ => parts.push((*index, *index)),
        }
    }
    let shown = |(first, last): &(u32, u32)| {
        if first == last { first.to_string() } else { format!("{first}-{last}") }
    };
    parts.iter().map(shown).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_indices_are_folded_into_ranges() {
        assert_eq!(index_list(&[0, 1, 2, 5, 7, 8]), "0-2,5,7-8");
    }
}
