//! The result of a run as terminal text.

use generator::Report;
use program::text::{bar, grouped, percent, ratio};
use schema::Outcome;
use shards::{Counts, Finalized, Location};

use crate::assignment::index_list;

/// The table at the end of a run: the numbers of the dataset if it is complete, else of this run; then the next step.
pub(crate) fn render(report: &Report, at: &Location, elapsed_s: f64) -> String {
    let made = report.made.labels.attempts;
    let mut text = counted(match &report.dataset {
        Some(Finalized::Complete(manifest)) => &manifest.totals,
        _ => &report.made,
    });
    if !report.rejected.moving.is_empty() {
        text += &line("moved on", &report.rejected.moved_on());
    }
    if made > 0 {
        let rate = grouped((made as f64 / elapsed_s) as u64);
        text += &line("speed", &format!("{rate} attempts/s ({} in {elapsed_s:.1} s)", grouped(made)));
    }
    let next = match (&report.dataset, &report.stopped) {
        (Some(Finalized::Complete(_)), _) if made == 0 => format!("complete already: {at}"),
        (_, Some(finished)) => format!(
            "stopped: {} finished scenes of incomplete shards are lost\n\
             next: run the same command again, which continues",
            grouped(*finished)
        ),
        (Some(state), None) => next(state, at),
        (None, None) => format!("next, when all shards exist: graspmill dataset finalize {at}"),
    };
    format!("{text}\n{next}\n")
}

/// The result of `finalize`.
pub(crate) fn state(state: &Finalized, at: &Location) -> String {
    let text = match state {
        Finalized::Complete(manifest) => counted(&manifest.totals) + "\n",
        Finalized::Incomplete { .. } => String::new(),
    };
    format!("{text}{}\n", next(state, at))
}

fn next(state: &Finalized, at: &Location) -> String {
    match state {
        Finalized::Complete(_) => {
            format!("complete: {at}\nnext: graspmill dataset verify {at} && graspmill dataset report {at}")
        }
        Finalized::Incomplete { missing } => {
            let are = if missing.len() == 1 { "shard is" } else { "shards are" };
            format!("not complete yet: {} {are} missing: {}", missing.len(), index_list(missing))
        }
    }
}

fn counted(counts: &Counts) -> String {
    let (labels, rejected) = (counts.labels, &counts.rejections);
    let (share, parts) = (percent(labels.positive_share()), ratio(labels.positives, labels.negatives()));
    let mut text = line("attempts", &format!("{} in {} scenes", grouped(labels.attempts), grouped(counts.scenes)));
    text += &line("positive", &format!("{} · {share} · {parts}", grouped(labels.positives)));
    for outcome in Outcome::ALL {
        let count = counts.outcome(outcome);
        let share = count as f64 / labels.attempts.max(1) as f64;
        text += &line(outcome.name(), &format!("{:>9}  {:>6}  {}", grouped(count), percent(share), bar(share, 30)));
    }
    let reasons = format!("{} unsettled, {} empty, {} unstable", rejected.unsettled, rejected.empty, rejected.unstable);
    text + &line("rejected scenes", &format!("{} ({reasons})", grouped(rejected.total())))
}

fn line(name: &str, value: &str) -> String {
    format!("{name:<20}{value}\n")
}
