//! What a reader of experiments should be worried about.

use std::collections::BTreeSet;

use experiments::record::Ending;
use experiments::report::Report;
use program::text::{grouped, percent};

use super::Played;

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
    warnings
}

fn of(one: &Played) -> Vec<String> {
    let Report { results, about } = &one.report;
    let mut warnings = Vec::new();
    let mut warn = |is_so: bool, text: String| warnings.extend(is_so.then_some(text));
    let rounds = grouped(results.rounds);
    warn(
        results.rounds < ROUNDS_MIN,
        format!(
            "Only {rounds} rounds: intervals are wide, and too narrow still, for few rounds cannot show what is rare."
        ),
    );
    warn(results.attempts == 0, "No grasp was executed: the planner found none.".to_owned());
    warn(
        results.attempts > 0 && results.rates.all().into_iter().flatten().any(|rate| rate.is_point()),
        "A rate's interval has no width: all rounds ended alike, which is not certainty.".to_owned(),
    );
    let ended = |ending: Ending| results.endings.get(&ending).copied().unwrap_or_default();
    let unsettled = ended(Ending::Unsettled);
    warn(
        unsettled > 0,
        format!("{} of {rounds} rounds ended because objects would not come to rest.", grouped(unsettled)),
    );
    let share = ended(Ending::NoGrasp) as f64 / results.rounds.max(1) as f64;
    warn(
        share > NO_GRASP_SHARE_MAX,
        format!("{} of the rounds ended without a grasp: the threshold of quality may be too high.", percent(share)),
    );
    let (own, made) = (env!("CARGO_PKG_VERSION"), about.versions.get("experiments").map_or("unknown", String::as_str));
    warn(made != own, format!("Version of the program that played the rounds: {made}; of this page's: {own}."));
    let Some(played) = &one.rounds else {
        warn(true, "The folder has no journal.jsonl: what it would warn of is not known.".to_owned());
        return warnings;
    };
    let silent: Vec<&str> = played.iter().filter_map(|round| round.no_answer.as_deref()).collect();
    warn(
        !silent.is_empty(),
        format!(
            "{} of {rounds} rounds ended because the planner gave no answer, the first with: {}.",
            grouped(silent.len() as u64),
            silent.first().copied().unwrap_or_default(),
        ),
    );
    let lost: u64 = played.iter().map(|round| u64::from(round.lost_count)).sum();
    warn(lost > 0, format!("Objects that left the workspace without being held: {}.", grouped(lost)));
    let seeds: BTreeSet<u64> = played.iter().map(|round| round.seed).collect();
    warn(
        seeds.len() == 1,
        "All scenes are of one seed: several (seeds = [1, 2, 3]) also show how much seeds differ.".to_owned(),
    );
    let missing = results.rounds.saturating_sub(played.len() as u64);
    warn(missing > 0, format!("Rounds of the report that the journal lacks: {}.", grouped(missing)));
    warnings
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::path::PathBuf;

    use experiments::record::{Attempt, Round};
    use experiments::report::About;
    use experiments::statistics::results;
    use schema::{Outcome, Pose};

    use super::*;

    fn round(number: u64) -> Round {
        let held = !number.is_multiple_of(3);
        let attempt = Attempt {
            object_count: 1,
            planned_count: 1,
            workspace_from_grasp: Pose::IDENTITY,
            width_m: 0.04,
            quality: 0.9,
            rho_m: None,
            target_id: 0,
            objects: Vec::new(),
            outcome: if held { Outcome::Held } else { Outcome::Slipped },
            hit: None,
            observe_ms: 1.0,
            plan_ms: 1.0,
        };
        Round {
            round: number,
            seed: number % 2,
            scene_id: number,
            group: "pile".to_owned(),
            unviable_count: 0,
            object_count: 1,
            removed_count: u32::from(held),
            lost_count: 0,
            ending: if held { Ending::Cleared } else { Ending::Failures },
            no_answer: None,
            attempts: vec![attempt],
        }
    }

    fn played(rounds: Vec<Round>) -> Played {
        let versions = BTreeMap::from([("experiments".to_owned(), env!("CARGO_PKG_VERSION").to_owned())]);
        let about = About { command: String::new(), config: String::new(), model_id: "c0ffee".to_owned(), versions };
        let report = Report { results: results("pile", &rounds), about };
        Played { folder: PathBuf::from("out"), report, rounds: Some(rounds) }
    }

    fn fine() -> Vec<Round> {
        (0..30).map(round).collect()
    }

    fn of_several(all: &[Played]) -> Vec<String> {
        let names: Vec<String> = (0..all.len()).map(|at| format!("number {at}")).collect();
        warnings(all, &names)
    }

    #[test]
    fn each_reason_to_worry_is_a_warning_and_none_is_invented() {
        assert_eq!(of_several(&[played(fine())]), Vec::<String>::new());
        let warns = |change: &dyn Fn(&mut Vec<Round>), word: &str| {
            let mut rounds = fine();
            change(&mut rounds);
            let warnings = of_several(&[played(rounds)]);
            assert!(warnings.len() == 1 && warnings[0].contains(word), "{word}: {warnings:?}");
        };
        warns(&|rounds| rounds.truncate(29), "Only 29 rounds");
        warns(&|rounds| rounds[3].ending = Ending::Unsettled, "1 of 30 rounds ended");
        warns(&|rounds| rounds.iter_mut().for_each(|round| round.seed = 7), "of one seed");
        warns(&|rounds| rounds[4].lost_count = 2, "left the workspace without being held: 2");
        warns(&|rounds| rounds[..20].iter_mut().for_each(|r| r.ending = Ending::NoGrasp), "66.7 % of the rounds");
        let all_held = |rounds: &mut Vec<Round>| rounds.iter_mut().for_each(|r| r.attempts[0].outcome = Outcome::Held);
        warns(&all_held, "no width");
        let nothing = |rounds: &mut Vec<Round>| rounds.iter_mut().for_each(|round| round.attempts.clear());
        warns(&nothing, "planner found none");
    }

    #[test]
    fn other_builds_are_warnings() {
        let mut old = played(fine());
        old.report.about.versions.insert("experiments".to_owned(), "0.0.1".to_owned());
        let found = of_several(&[played(fine()), old]);
        assert_eq!(found.len(), 1);
        assert!(found[0].starts_with("number 1: ") && found[0].contains("played the rounds: 0.0.1"), "{found:?}");
        let mut cut = played(fine());
        cut.rounds.as_mut().unwrap().pop();
        assert!(of_several(&[cut])[0].contains("lacks: 1"));
    }
}
