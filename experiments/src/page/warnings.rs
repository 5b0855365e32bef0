//! What a reader of experiments should be worried about.

use std::collections::BTreeSet;

use shards::text::{grouped, percent};

use super::Played;
use crate::record::Ending;
use crate::report::{headline_rates, is_any_point};

/// Of fewer rounds a bootstrap says little.
const ROUNDS_MIN: u64 = 30;
/// Rounds without a grasp that are many.
const NO_GRASP_SHARE_MAX: f64 = 0.5;

/// What is unusual about experiments, one sentence each; `names` are what they are called.
pub(super) fn warnings(all: &[Played], names: &[String]) -> Vec<String> {
    let mut warnings = Vec::new();
    for (one, name) in all.iter().zip(names) {
        let prefix = if all.len() > 1 { format!("{name}: ") } else { String::new() };
        warnings.extend(of(one).into_iter().map(|warning| format!("{prefix}{warning}")));
    }
    let several = |what: &str, values: BTreeSet<&str>| {
        let count = values.len();
        (count > 1)
            .then(|| format!("The experiments were run with {count} {what}: they differ in more than their settings."))
    };
    let versions = all.iter().filter_map(|one| one.about.versions.get("experiments")).map(String::as_str).collect();
    let networks = all.iter().map(|one| one.about.model_id.as_str()).collect();
    warnings.extend(several("versions of the program", versions));
    warnings.extend(several("networks", networks));
    warnings
}

fn of(one: &Played) -> Vec<String> {
    let results = &one.results;
    let mut warnings = Vec::new();
    if results.rounds < ROUNDS_MIN {
        warnings.push(format!(
            "Only {} rounds: intervals are wide, and the bootstrap they come from makes them too narrow still.",
            results.rounds
        ));
    }
    if results.attempts == 0 {
        warnings.push("No grasp was executed: the planner found none.".to_owned());
    } else if is_any_point(headline_rates(results)) {
        warnings.push("A rate's interval has no width: all rounds ended alike, which is not certainty.".to_owned());
    }
    let ended = |ending: Ending| results.endings.iter().find(|(one, _)| *one == ending).map_or(0, |(_, count)| *count);
    let unsettled = ended(Ending::Unsettled);
    if unsettled > 0 {
        warnings.push(format!(
            "{} of {} rounds ended because objects would not come to rest: what they would have given is missing.",
            grouped(unsettled),
            grouped(results.rounds)
        ));
    }
    let share = ended(Ending::NoGrasp) as f64 / results.rounds.max(1) as f64;
    if share > NO_GRASP_SHARE_MAX {
        warnings.push(format!(
            "{} of the rounds ended because the planner gave no grasp: its threshold of quality may be too high for this network.",
            percent(share)
        ));
    }
    if let Some(rounds) = &one.rounds {
        let lost: u64 = rounds.iter().map(|round| u64::from(round.record.lost_count)).sum();
        if lost > 0 {
            warnings.push(format!("{} objects left the workspace without being held.", grouped(lost)));
        }
        let seeds: BTreeSet<u64> = rounds.iter().map(|round| round.record.seed).collect();
        if let (1, Some(seed)) = (seeds.len(), seeds.first()) {
            warnings.push(format!(
                "All scenes are of one seed, {seed}: the intervals tell what other rounds of it would give. Several seeds (seeds = [1, 2, 3]) \
                 also show how much seeds differ."
            ));
        }
        if rounds.len() as u64 != results.rounds {
            warnings.push(format!(
                "The journal holds {} of the report's {} rounds: the pictures are of those.",
                rounds.len(),
                results.rounds
            ));
        }
    }
    let made = one.about.versions.get("experiments").map_or("an unknown version", String::as_str);
    if made != env!("CARGO_PKG_VERSION") {
        warnings.push(format!(
            "The rounds were played by version {made} of the program, this page is made by {}.",
            env!("CARGO_PKG_VERSION")
        ));
    }
    warnings
}
