//! What a reader of experiments should be worried about.

use std::collections::BTreeSet;

use program::text::{grouped, percent};

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
    let versions =
        all.iter().filter_map(|one| one.report.about.versions.get("experiments")).map(String::as_str).collect();
    let networks = all.iter().map(|one| one.report.about.model_id.as_str()).collect();
    warnings.extend(several("versions of the program", versions));
    warnings.extend(several("networks", networks));
    warnings
}

fn of(one: &Played) -> Vec<String> {
    let results = &one.report.results;
    let mut warnings = Vec::new();
    if results.rounds < ROUNDS_MIN {
        warnings.push(format!(
            "Only {} rounds: the intervals are wide, and still narrower than they should be, for few rounds cannot show what is rare.",
            results.rounds
        ));
    }
    if results.attempts == 0 {
        warnings.push("No grasp was executed: the planner found none.".to_owned());
    } else if is_any_point(headline_rates(results)) {
        warnings.push("A rate's interval has no width: all rounds ended alike, which is not certainty.".to_owned());
    }
    let ended = |ending: Ending| results.endings.get(&ending).copied().unwrap_or_default();
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
        let lost: u64 = rounds.iter().map(|round| u64::from(round.lost_count)).sum();
        if lost > 0 {
            let objects = if lost == 1 { "object" } else { "objects" };
            warnings.push(format!("{} {objects} left the workspace without being held.", grouped(lost)));
        }
        let seeds: BTreeSet<u64> = rounds.iter().map(|round| round.seed).collect();
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
    let made = one.report.about.versions.get("experiments").map_or("an unknown version", String::as_str);
    if made != env!("CARGO_PKG_VERSION") {
        warnings.push(format!(
            "The rounds were played by version {made} of the program, this page is made by {}.",
            env!("CARGO_PKG_VERSION")
        ));
    }
    warnings
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::path::PathBuf;

    use schema::{Outcome, Pose};

    use super::*;
    use crate::record::{Round, Trial};
    use crate::report::{About, Report};
    use crate::statistics::results;

    fn round(number: u64) -> Round {
        let held = !number.is_multiple_of(3);
        let trial = Trial {
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
            trials: vec![trial],
        }
    }

    fn played(rounds: Vec<Round>) -> Played {
        let versions = BTreeMap::from([("experiments".to_owned(), env!("CARGO_PKG_VERSION").to_owned())]);
        let about = About { command: String::new(), config: String::new(), model_id: "c0ffee".to_owned(), versions };
        let report = Report { results: results("pile", &rounds), about };
        Played { folder: PathBuf::from("out"), report, rounds: Some(rounds), stage: None }
    }

    fn fine() -> Vec<Round> {
        (0..30).map(round).collect()
    }

    fn of_several(all: &[Played]) -> Vec<String> {
        let names: Vec<String> = (0..all.len()).map(|at| format!("number {at}")).collect();
        warnings(all, &names)
    }

    #[test]
    fn each_reason_to_worry_is_told_and_none_is_invented() {
        assert_eq!(of_several(&[played(fine())]), Vec::<String>::new());
        let told = |change: &dyn Fn(&mut Vec<Round>), word: &str| {
            let mut rounds = fine();
            change(&mut rounds);
            let warnings = of_several(&[played(rounds)]);
            assert!(warnings.len() == 1 && warnings[0].contains(word), "{word}: {warnings:?}");
        };
        told(&|rounds| rounds.truncate(29), "Only 29 rounds");
        told(&|rounds| rounds[3].ending = Ending::Unsettled, "1 of 30 rounds ended because objects");
        told(&|rounds| rounds.iter_mut().for_each(|round| round.seed = 7), "one seed, 7");
        told(&|rounds| rounds[4].lost_count = 2, "2 objects left the workspace");
        told(&|rounds| rounds[..20].iter_mut().for_each(|r| r.ending = Ending::NoGrasp), "66.7 % of the rounds");
        let all_held = |rounds: &mut Vec<Round>| rounds.iter_mut().for_each(|r| r.trials[0].outcome = Outcome::Held);
        told(&all_held, "no width");
        let nothing = |rounds: &mut Vec<Round>| rounds.iter_mut().for_each(|round| round.trials.clear());
        told(&nothing, "planner found none");
    }

    #[test]
    fn other_builds_and_networks_are_told() {
        let mut old = played(fine());
        old.report.about.versions.insert("experiments".to_owned(), "0.0.1".to_owned());
        old.report.about.model_id = "other".to_owned();
        let found = of_several(&[played(fine()), old]);
        for word in ["number 1: The rounds were played by version 0.0.1", "2 versions of the program", "2 networks"] {
            assert!(found.iter().any(|warning| warning.contains(word)), "{word}: {found:?}");
        }
        assert_eq!(found.len(), 3);
        let mut cut = played(fine());
        cut.rounds.as_mut().unwrap().pop();
        assert!(of_several(&[cut])[0].contains("29 of the report's 30 rounds"));
    }
}
