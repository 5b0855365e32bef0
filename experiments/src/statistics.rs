//! The results of an experiment, computed from its rows: rates with intervals, counts, times.
//!
//! Rounds are the independent units, not attempts, because attempts of a round share a scene. Therefore every interval
//! is a percentile bootstrap over whole rounds.

use std::collections::BTreeMap;

use schema::Outcome;
use schema::statistics::bootstrap_share;
use serde::{Deserialize, Serialize};

use crate::record::{Ending, Round};

/// The results of an experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// Name of the protocol to which all numbers refer.
    pub protocol: String,
    /// Rounds.
    pub rounds: u64,
    /// Objects at the beginning of the rounds.
    pub objects: u64,
    /// Grasps that were executed.
    pub attempts: u64,
    /// Number that held.
    pub held: u64,
    /// Objects that were held and taken away.
    pub removed: u64,
    /// The rates.
    pub rates: Rates,
    /// Rounds by ending, for the endings that occurred.
    pub endings: BTreeMap<Ending, u64>,
    /// Attempts by outcome, for the outcomes that occurred.
    pub outcomes: BTreeMap<Outcome, u64>,
    /// Rounds by the kind of scene.
    pub by_group: Vec<GroupResults>,
    /// Rounds by seed, if there are several.
    pub by_seed: Vec<GroupResults>,
    /// Depth images to ranked grasps; `None` without attempts.
    pub plan_ms: Option<Percentiles>,
}

/// The rates for comparing experiments; `None` where the denominator is 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Rates {
    /// Attempts that held, of all attempts: the grasp success rate, GSR.
    pub success_rate: Option<Interval>,
    /// Objects removed, of those at the beginning: "% cleared", GIGA's declutter rate, DR.
    pub cleared_share: Option<Interval>,
    /// Rounds that ended with no object left, of all rounds.
    pub rounds_cleared_share: Option<Interval>,
}

/// A share and its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// The share, from 0 to 1.
    pub value: f64,
    /// 2.5 % of the bootstrap's draws are below.
    pub low: f64,
    /// 2.5 % of the bootstrap's draws are above.
    pub high: f64,
}

/// Rounds of one kind.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GroupResults {
    /// Their common property.
    pub name: String,
    /// Rounds.
    pub rounds: u64,
    /// Objects at the beginning.
    pub objects: u64,
    /// Grasps that were executed.
    pub attempts: u64,
    /// Number that held.
    pub held: u64,
    /// The rates.
    pub rates: Rates,
}

/// Quantiles of times, in the unit of the field's name; each is a measured time (nearest rank).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f32,
    /// 90th percentile.
    pub p90: f32,
    /// 99th percentile.
    pub p99: f32,
}

/// Number of bootstrap draws.
const DRAWS: u32 = 2000;

/// Computes the results of an experiment. Rounds and their attempts may be in any order.
#[must_use]
pub fn results(protocol: &str, rounds: &[Round]) -> Results {
    let mut rounds: Vec<&Round> = rounds.iter().collect();
    rounds.sort_by_key(|round| round.round);
    let tried = || rounds.iter().flat_map(|round| &round.attempts);
    let GroupResults { objects, attempts, held, rates, .. } = group(String::new(), &rounds);
    let seeds = by(&rounds, |round| format!("seed {}", round.seed));
    Results {
        protocol: protocol.to_owned(),
        rounds: rounds.len() as u64,
        objects,
        attempts,
        held,
        removed: rounds.iter().map(|round| u64::from(round.removed_count)).sum(),
        rates,
        endings: counts(rounds.iter().map(|round| round.ending)),
        outcomes: counts(tried().map(|attempt| attempt.outcome)),
        by_group: by(&rounds, |round| round.group.clone()),
        by_seed: if seeds.len() > 1 { seeds } else { Vec::new() },
        plan_ms: Percentiles::of(tried().map(|attempt| attempt.plan_ms).collect()),
    }
}

/// The results of rounds of each name, in the order in which names appear.
fn by(rounds: &[&Round], name: impl Fn(&Round) -> String) -> Vec<GroupResults> {
    let mut groups: Vec<(String, Vec<&Round>)> = Vec::new();
    for round in rounds {
        let name = name(round);
        match groups.iter_mut().find(|group| group.0 == name) {
            Some((_, rounds)) => rounds.push(round),
            None => groups.push((name, vec![round])),
        }
    }
    groups.into_iter().map(|(name, rounds)| group(name, &rounds)).collect()
}

fn group(name: String, rounds: &[&Round]) -> GroupResults {
    let held = |round: &&Round| round.attempts.iter().map(|attempt| u64::from(attempt.outcome.label())).sum::<u64>();
    let attempts: Vec<(u64, u64)> = rounds.iter().map(|round| (held(round), round.attempts.len() as u64)).collect();
    let objects: Vec<(u64, u64)> =
        rounds.iter().map(|round| (round.removed_count.into(), round.object_count.into())).collect();
    let cleared: Vec<(u64, u64)> = rounds.iter().map(|round| ((round.ending == Ending::Cleared).into(), 1)).collect();
    let (held, attempt_count) = sum(&attempts);
    GroupResults {
        name,
        rounds: rounds.len() as u64,
        objects: sum(&objects).1,
        attempts: attempt_count,
        held,
        rates: Rates {
            success_rate: Interval::over(&attempts),
            cleared_share: Interval::over(&objects),
            rounds_cleared_share: Interval::over(&cleared),
        },
    }
}

/// Counts of each value, in their own order.
fn counts<T: Ord>(found: impl Iterator<Item = T>) -> BTreeMap<T, u64> {
    let mut counts = BTreeMap::new();
    for one in found {
        *counts.entry(one).or_insert(0) += 1;
    }
    counts
}

fn sum(pairs: &[(u64, u64)]) -> (u64, u64) {
    pairs.iter().fold((0, 0), |(part, whole), pair| (part + pair.0, whole + pair.1))
}

impl Rates {
    /// All of them, in the order of their importance.
    #[must_use]
    pub fn all(&self) -> [Option<Interval>; 3] {
        [self.success_rate, self.cleared_share, self.rounds_cleared_share]
    }
}

impl Interval {
    /// The share over all rounds, from the part and the whole of each. Rounds are drawn with replacement, as many as
    /// there are; draws with a zero denominator are skipped. Fewer than two non-empty rounds contain no information
    /// about their variance; the interval is then 0 to 1. `None` if the denominator is 0.
    fn over(rounds: &[(u64, u64)]) -> Option<Self> {
        let (part, whole) = sum(rounds);
        let value = (whole > 0).then(|| part as f64 / whole as f64)?;
        if rounds.iter().filter(|(_, whole)| *whole > 0).count() < 2 {
            return Some(Self { value, low: 0.0, high: 1.0 });
        }
        let (low, high) = bootstrap_share(rounds, DRAWS)?;
        Some(Self { value, low, high })
    }
}

impl Percentiles {
    /// Quantiles of times in any order; `None` if there are none. NaN means not measured.
    pub(crate) fn of(mut times: Vec<f32>) -> Option<Self> {
        times.retain(|time| time.is_finite());
        times.sort_by(f32::total_cmp);
        let at = |percent: usize| {
            let rank = (percent * times.len()).div_ceil(100);
            times.get(rank.checked_sub(1)?).copied()
        };
        Some(Self { p50: at(50)?, p90: at(90)?, p99: at(99)? })
    }
}

#[cfg(test)]
mod tests {
    use schema::Pose;

    use super::*;
    use crate::record::{Attempt, AttemptObject};

    fn round(round: u64, object_count: u32, removed_count: u32, ending: Ending, attempts: Vec<Attempt>) -> Round {
        Round {
            round,
            seed: round % 2,
            scene_id: round / 2,
            group: if round == 0 { "first" } else { "others" }.to_owned(),
            unviable_count: 1,
            object_count,
            removed_count,
            lost_count: 0,
            ending,
            no_answer: None,
            container: None,
            attempts,
            left: Vec::new(),
        }
    }

    fn attempt(number: u32, target: &str, outcome: Outcome, plan_ms: f32) -> Attempt {
        let object = |body: &str| AttemptObject {
            body: body.to_owned(),
            size_m: [0.05; 3],
            mass_kg: 0.1,
            friction: 1.0,
            workspace_from_object: Pose::IDENTITY,
        };
        Attempt {
            object_count: 5,
            planned_count: 10 + number,
            workspace_from_grasp: Pose::IDENTITY,
            width_m: 0.05,
            quality: 0.9,
            rho_m: None,
            target_id: 1,
            objects: vec![object("another"), object(target)],
            outcome,
            hit: None,
            observe_ms: 2.0 * plan_ms,
            plan_ms,
        }
    }

    /// Three rounds: cleared, given up after a failure, and one without a grasp.
    fn rows() -> Vec<Round> {
        use Outcome::{Empty, Held, Slipped};
        let (cuboid, cylinder) = ("cuboid", "cylinder");
        let cleared = vec![attempt(0, cuboid, Held, 10.0), attempt(1, cylinder, Held, 11.0)];
        let failed =
            vec![attempt(0, cuboid, Held, 12.0), attempt(1, cuboid, Slipped, 13.0), attempt(2, cuboid, Empty, 14.0)];
        vec![
            round(0, 2, 2, Ending::Cleared, cleared),
            round(1, 3, 1, Ending::Failures, failed),
            round(2, 3, 0, Ending::NoGrasp, Vec::new()),
        ]
    }

    fn value(interval: Option<Interval>) -> f64 {
        interval.unwrap().value
    }

    #[test]
    fn rates_and_counts_are_those_of_the_rows() {
        let found = results("pile", &rows());
        assert_eq!((found.protocol.as_str(), found.rounds, found.objects, found.removed), ("pile", 3, 8, 3));
        assert_eq!((found.attempts, found.held), (5, 3));
        assert_eq!(value(found.rates.success_rate), 0.6);
        assert_eq!(value(found.rates.cleared_share), 0.375);
        assert_eq!(value(found.rates.rounds_cleared_share), 1.0 / 3.0);
        assert_eq!(found.endings, [(Ending::Cleared, 1), (Ending::NoGrasp, 1), (Ending::Failures, 1)].into());
        assert_eq!(found.outcomes, [(Outcome::Empty, 1), (Outcome::Slipped, 1), (Outcome::Held, 3)].into());
        assert_eq!(found.plan_ms, Some(Percentiles { p50: 12.0, p90: 14.0, p99: 14.0 }));
        let told = |groups: &[GroupResults]| -> Vec<(String, [u64; 4])> {
            groups.iter().map(|g| (g.name.clone(), [g.rounds, g.objects, g.attempts, g.held])).collect()
        };
        assert_eq!(told(&found.by_group), [("first".to_owned(), [1, 2, 2, 2]), ("others".to_owned(), [2, 6, 3, 1])]);
        assert_eq!(told(&found.by_seed), [("seed 0".to_owned(), [2, 5, 2, 2]), ("seed 1".to_owned(), [1, 3, 3, 1])]);
    }

    #[test]
    fn results_come_back_from_their_json() {
        let found = results("pile", &rows());
        let text = serde_json::to_string(&found).unwrap();
        assert_eq!(serde_json::from_str::<Results>(&text).unwrap(), found);
        assert!(serde_json::from_str::<Results>(&text.replace("\"held\":3", "\"hold\":3")).is_err());
    }

    #[test]
    fn intervals_hold_their_share_and_the_order_of_rows_is_nothing() {
        let mut rounds = rows();
        let found = results("pile", &rounds);
        let Rates { success_rate, cleared_share, rounds_cleared_share } = &found.rates;
        for interval in [success_rate, cleared_share, rounds_cleared_share] {
            let Interval { value, low, high } = interval.unwrap();
            assert!(0.0 <= low && low < value && value < high && high <= 1.0, "{low} {value} {high}");
        }
        rounds.reverse();
        rounds.iter_mut().for_each(|round| round.attempts.reverse());
        assert_eq!(results("pile", &rounds), found);
    }

    #[test]
    fn nothing_is_divided_by_nothing() {
        let found = results("pile", &[]);
        assert_eq!(found.rates, Rates { success_rate: None, cleared_share: None, rounds_cleared_share: None });
        assert_eq!(found.plan_ms, None);
        assert!(found.endings.is_empty() && found.outcomes.is_empty());
        let no_grasp = [0, 1].map(|number| round(number, 5, 0, Ending::NoGrasp, Vec::new()));
        let rates = results("pile", &no_grasp).rates;
        assert_eq!(rates.success_rate, None);
        assert_eq!(rates.cleared_share, Some(Interval { value: 0.0, low: 0.0, high: 0.0 }));
    }

    #[test]
    fn one_round_cannot_tell_how_much_rounds_differ() {
        let all = Some(Interval { value: 0.75, low: 0.0, high: 1.0 });
        assert_eq!(Interval::over(&[(3, 4)]), all);
        assert_eq!(Interval::over(&[(0, 0), (3, 4), (0, 0)]), all);
        assert_eq!(Interval::over(&[(0, 0)]), None);
    }

    /// Half of the rounds have no attempt: draws without attempts are skipped, and the others are shares.
    #[test]
    fn empty_rounds_are_drawn_but_never_divided_by() {
        let Interval { value, low, high } = Interval::over(&[(0, 0), (1, 1), (0, 0), (0, 1)]).unwrap();
        assert_eq!((value, low, high), (0.5, 0.0, 1.0));
    }

    #[test]
    fn percentiles_are_times_that_were_measured() {
        let of = |times: &[f32]| Percentiles::of(times.to_vec());
        assert_eq!(of(&[50.0, 15.0, 40.0, 20.0, 35.0]), Some(Percentiles { p50: 35.0, p90: 50.0, p99: 50.0 }));
        let hundred: Vec<f32> = (1..=100_u16).rev().map(f32::from).collect();
        assert_eq!(of(&hundred), Some(Percentiles { p50: 50.0, p90: 90.0, p99: 99.0 }));
        assert_eq!(of(&[7.0, f32::NAN]), Some(Percentiles { p50: 7.0, p90: 7.0, p99: 7.0 }));
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[f32::NAN]), None);
    }
}
