//! The result of a run as terminal text.

use std::fmt::Write;

use generator::{Report, Stopped};
use program::text::{bar, grouped, percent, ratio};
use schema::Outcome;
use shards::{Counts, Finalized, Location};

use crate::assignment::index_list;

/// The table at the end of a run: the numbers of the dataset if it is complete, else of this run; then the next step.
pub(crate) fn render(report: &Report, at: &Location, elapsed_s: f64) -> String {
    let mut text = String::new();
    let made = report.made.labels.attempts;
    let counts = match &report.dataset {
        Some(Finalized::Complete(manifest)) => &manifest.totals,
        Some(Finalized::Incomplete { .. }) | None => &report.made,
    };
    write_counts(&mut text, counts);
    if !report.rejected.moving.is_empty() {
        line(&mut text, "moved on", &report.rejected.moved_on());
    }
    if made > 0 {
        let rate = made as f64 / elapsed_s;
        line(
            &mut text,
            "speed",
            &format!("{} attempts/s ({} in {elapsed_s:.1} s)", grouped(rate as u64), grouped(made)),
        );
    }
    text += "\n";
    text += &match (&report.dataset, &report.stopped) {
        (Some(Finalized::Complete(_)), _) if made == 0 => format!("complete already: {at}\n"),
        (_, Some(stopped)) => goes_on(stopped),
        (Some(state), None) => next(state, at),
        (None, None) => format!("next, when all shards exist: graspmill dataset finalize {at}\n"),
    };
    text
}

/// What a stopped run loses, and how to go on.
fn goes_on(Stopped { finished, abandoned }: &Stopped) -> String {
    let lost = format!("{} finished scenes of incomplete shards are lost, {abandoned} under way", grouped(*finished));
    format!("stopped: {lost}\nnext: run the same command again, which continues\n")
}

/// The result of `finalize`.
pub(crate) fn state(state: &Finalized, at: &Location) -> String {
    let mut text = String::new();
    if let Finalized::Complete(manifest) = state {
        write_counts(&mut text, &manifest.totals);
        text += "\n";
    }
    text + &next(state, at)
}

fn next(state: &Finalized, at: &Location) -> String {
    match state {
        Finalized::Complete(_) => {
            format!("complete: {at}\nnext: graspmill dataset verify {at} && graspmill dataset report {at}\n")
        }
        Finalized::Incomplete { missing } => {
            let are = if missing.len() == 1 { "shard is" } else { "shards are" };
            format!("not complete yet: {} {are} missing: {}\n", missing.len(), index_list(missing))
        }
    }
}

fn write_counts(text: &mut String, counts: &Counts) {
    let labels = counts.labels;
    line(text, "attempts", &format!("{} in {} scenes", grouped(labels.attempts), grouped(counts.scenes)));
    let share = percent(labels.positive_share());
    line(
        text,
        "positive",
        &format!("{} · {share} · {}", grouped(labels.positives), ratio(labels.positives, labels.negatives())),
    );
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
