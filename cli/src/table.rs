//! The result of a run as terminal text.

use generator::Report;
use program::text::{grouped, percent, ratio};
use schema::Outcome;
use shards::{Counts, Finalized, Location};

use crate::assignment::index_list;

/// The share of positives below which a run warns, and the attempts from which on a share says something.
const POSITIVE_SHARE_MIN: f64 = 0.05;
const ATTEMPTS_MIN: u64 = 100;
const MORE: &str = "Of the samplers, \"mixed\" finds most (configs/generate/household.toml); spanned_share = 1 leaves \
                    out what the gripper cannot span";

/// The table at the end of a run: the numbers of the dataset if it is complete, else of this run; then the next step.
/// A run that was stopped before it kept anything has only the last lines.
pub(crate) fn render(report: &Report, at: &Location, shards: u32, elapsed_s: f64) -> String {
    let (made, is_stopped) = (report.made.labels.attempts, report.stopped.is_some());
    let mut text = if is_stopped && made == 0 { String::new() } else { counted(counts(report)) };
    if made > 0 && !is_stopped {
        let rate = grouped((made as f64 / elapsed_s) as u64);
        text += &line("speed", &format!("{rate} attempts/s ({} in {elapsed_s:.1} s)", grouped(made)));
    }
    let next = match (&report.dataset, &report.stopped) {
        (Some(Finalized::Complete(_)), _) if made == 0 => format!("complete already: {at}"),
        (_, Some(finished)) => format!(
            "stopped: {}{} finished scenes of incomplete shards are lost\n\
             next: run the same command again, which continues",
            kept(report, shards),
            grouped(*finished)
        ),
        (Some(state), None) => next(state, at),
        (None, None) => format!("next, when all shards exist: graspmill dataset finalize {at}"),
    };
    format!("{text}\n{next}\n")
}

/// What is counted: the dataset if it is complete, else what this run keeps.
fn counts(report: &Report) -> &Counts {
    match &report.dataset {
        Some(Finalized::Complete(manifest)) => &manifest.totals,
        _ => &report.made,
    }
}

/// How many of the dataset's shards are there, if that was looked at.
fn kept(report: &Report, shards: u32) -> String {
    let Some(Finalized::Incomplete { missing }) = &report.dataset else { return String::new() };
    format!("{} of {shards} shards are kept, ", shards as usize - missing.len())
}

/// A line about a dataset of which a network learns little, if it is one.
pub(crate) fn few_positives(report: &Report) -> Option<String> {
    let labels = counts(report).labels;
    let is_few = labels.attempts >= ATTEMPTS_MIN && labels.positive_share() < POSITIVE_SHARE_MIN;
    let ([held, all], share) = ([labels.positives, labels.attempts].map(grouped), percent(labels.positive_share()));
    is_few.then(|| format!("warning: {held} of {all} attempts held, {share}. {MORE}"))
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
        text += &line(outcome.name(), &format!("{:>9}  {:>6}", grouped(count), percent(share)));
    }
    let reasons = format!("{} unsettled, {} empty, {} unstable", rejected.unsettled, rejected.empty, rejected.unstable);
    text + &line("rejected scenes", &format!("{} ({reasons})", grouped(rejected.total())))
}

fn line(name: &str, value: &str) -> String {
    format!("{name:<20}{value}\n")
}
