//! The judge decides: grasp candidates are proposed on what was seen, and the network says how each attempt would end.

use std::collections::BTreeSet;

use network::checkpoint::Checkpoint;
use network::judge::{Crop, JudgeInputs, JudgeNetwork, OUTCOMES, Screen, probabilities, robustness};
use program::Failure;
use rayon::prelude::*;
use schema::{Grasp, Grid, Gripper, Outcome, Pose, Stream, Vec3};

use crate::things::Things;
use crate::{CandidateSampler, ObservedScene, Search, Space, Spread, TRIES_MAX, Wanted, kept};

/// Candidates that one thread judges together.
const TOGETHER: usize = 8;
/// Candidates at which one thread looks quickly together.
const SCREENED: usize = 32;
/// One of so many candidates that are chosen has its tips further than this from all that were chosen before.
const APART: usize = 8;
const SPREAD_M: f32 = 0.03;
/// If there are several things, one of so many candidates that are chosen is shared among them, or nearly all where
/// each thing counts, and the judge is first asked about fewer: one of so many is kept back.
const SHARED: usize = 2;
const KEPT_BACK: usize = 4;
/// For each thing without a sure grasp so many more are proposed and asked about, in all up to as many as all were.
/// Where each thing counts, they are twice as many, without a limit, and so many times.
const PROPOSED: usize = 64;
const ASKED: usize = 8;
const ROUNDS: usize = 3;
/// A sure grasp is also one of things whose middles are nearer to it than this: of a large part, or of a heap, the
/// squares are things.
const SERVED_M: f32 = 0.025;
/// So many are drawn at most for each of these: of some things no candidate is free.
const TRIES_MORE_MAX: usize = 8;

/// Where no candidate holds with more than this probability, more are proposed: at the second and the third time so
/// many times as many, and the judge is asked about so many times as many.
const SURE: f32 = 0.9;
const SEARCHES: [[usize; 2]; 3] = [[1, 1], [2, 2], [2, 4]];
/// A further search is for candidates nearer than this to one that holds with more than this probability: most of what
/// is seen of a bin is wall, which no gripper can lift.
const NEAR_M: f32 = 0.03;
const HOPE: f32 = 0.1;
/// Candidates about places are proposed on points of the surface that are nearer to them than this.
const ABOUT_M: f32 = 0.01;
/// Number of the best grasps apart from each other that are looked at more closely: they are moved to where they fit
/// better, and their mirror images are judged, too.
const LEADERS: usize = 6;
/// They are moved by the largest of these shares of the way where the judge is as sure of them but for this.
const SHARES: [f32; 2] = [0.5, 1.0];
const AS_SURE: f32 = 0.03;
/// A grasp of an earlier search is asked about at the first of these distances before it at which it is free: noise
/// moves what was seen.
const BEFORE_M: [f32; 4] = [0.0, 0.002, 0.004, 0.006];

/// A judge, prepared for a gripper on a grid.
#[derive(Debug, Clone)]
pub struct Judge {
    network: JudgeNetwork,
    crop: Crop,
    sampler: CandidateSampler,
}

/// A grasp and how its attempt would end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoredGrasp {
    /// The grasp.
    pub grasp: Grasp,
    /// Probabilities in the order of [`Outcome::ALL`].
    pub outcomes: [f32; OUTCOMES],
    /// If it holds, the share of repeats with other masses, other friction and slightly moved grasps that would, too;
    /// `None` of a judge that did not learn it.
    pub robustness: Option<f32>,
    /// What it touches, of the things that are apart from each other; `None` where these were not told apart.
    pub thing: Option<usize>,
}

/// What was seen, prepared for questions.
struct Seen<'a> {
    space: Space<'a>,
    things: Things,
    views: usize,
}

/// What the network says of a candidate.
type Answer = ([f32; OUTCOMES], Option<f32>);

impl ScoredGrasp {
    /// The probability that it holds.
    #[must_use]
    pub fn quality(&self) -> f32 {
        self.outcomes[Outcome::Held as usize]
    }

    /// The likeliest outcome and its probability.
    #[must_use]
    pub fn likeliest(&self) -> (Outcome, f32) {
        let outcomes = Outcome::ALL.into_iter().zip(self.outcomes);
        outcomes.fold((Outcome::Held, self.quality()), |best, one| if one.1 > best.1 { one } else { best })
    }

    /// Whether its tips are nearer than this to those of another grasp.
    #[must_use]
    pub fn is_near(&self, other: &Self, apart_m: f32) -> bool {
        let [here_m, there_m] = [self, other].map(|judged| judged.grasp.workspace_from_grasp.translation);
        (here_m - there_m).length() < apart_m
    }
}

impl Judge {
    /// Prepares the judge of a checkpoint.
    ///
    /// # Errors
    /// If these are another network's weights, or the judge was trained for another gripper or another grid.
    pub fn new(checkpoint: &Checkpoint, gripper: &Gripper, grid: &Grid) -> Result<Self, Failure> {
        let scope = checkpoint.architecture.scope("judging grasps")?;
        scope.must_match(gripper, grid)?;
        let (sampler, pregrasp_m) =
            (CandidateSampler::new(gripper, scope.pregrasp_distance_m), scope.pregrasp_distance_m);
        Ok(Self { network: JudgeNetwork::new(&checkpoint.vector), crop: Crop::new(gripper, pregrasp_m, grid), sampler })
    }

    /// Proposes candidates in a scene, and judges the likeliest: `asked` of `proposals`, and again where none is good.
    /// First come the best of those whose tips are `apart_m` from each other, then the others, each best first; beside
    /// them the number of proposals. The best are asked about again in each mirror image: a grasp and its mirror image
    /// end alike, so where the answers differ their mean is nearer to the truth. Only candidates that are wanted are
    /// proposed, and if `about_m` has places only near these. The best grasps are moved towards a `better` place; so is
    /// a `previous` one, which counts as one of the best.
    #[must_use]
    pub fn scored_grasps(
        &self,
        seen: ObservedScene<'_>,
        search: &Search<'_>,
        stream: &mut Stream,
    ) -> (Vec<ScoredGrasp>, usize) {
        let Search { proposals, asked, apart_m, spread, .. } = *search;
        let space = Space::new(seen.field, seen.fine, seen.reach_m);
        let about = space.near(search.about_m, ABOUT_M);
        let things = if spread == Spread::Evenly { Things::default() } else { Things::new(&space, &about) };
        let seen = Seen { space, things, views: seen.views };
        let previous = self.previous(&seen, search);
        let (mut judged, mut proposed) = (Vec::<ScoredGrasp>::new(), usize::from(previous.is_some()));
        let mut wanted = seen.things.shared(&seen.space, &about, |_| true);
        let asked_first = if seen.things.count() > 0 { asked - asked / KEPT_BACK } else { asked };
        for [more, more_asked] in SEARCHES {
            let search = Search { proposals: more * proposals, asked: more_asked * asked_first, ..*search };
            let (found, count) = self.found(&seen, &wanted, &search, TRIES_MAX, stream);
            judged.extend(found);
            proposed += count;
            if count == 0 || judged.iter().chain(&previous).any(|judged| judged.quality() > SURE) {
                break;
            }
            wanted = seen.space.near(&hopeful_m(&judged), NEAR_M);
        }
        proposed += self.of_things(&seen, &about, search, &mut judged, stream);
        let (mut best, rest) = leaders(sorted(judged), apart_m, spread);
        best.extend(previous);
        self.move_where_better(&seen, &mut best, search);
        self.judge_mirrored(&seen, &mut best);
        let mut all = sorted(best);
        all.extend(rest);
        (all, proposed)
    }

    /// Adds candidates on things without a sure grasp, and says how many were proposed.
    fn of_things(
        &self,
        seen: &Seen<'_>,
        about: &Wanted,
        search: &Search<'_>,
        judged: &mut Vec<ScoredGrasp>,
        stream: &mut Stream,
    ) -> usize {
        let (is_each, mut proposed) = (search.spread == Spread::Each, 0);
        let rounds = if is_each { ROUNDS } else { 1 };
        for _ in 0..rounds {
            let sure: Vec<&ScoredGrasp> = judged.iter().filter(|one| one.quality() > SURE).collect();
            let is_served = |thing: usize, one: &ScoredGrasp| {
                let off_m = one.grasp.workspace_from_grasp.translation - seen.things.middle_m(thing);
                one.thing == Some(thing) || off_m.length() < SERVED_M
            };
            let is_lacking = |thing: usize| !sure.iter().any(|one| is_served(thing, one));
            let lacking: Vec<bool> = (0..seen.things.count()).map(is_lacking).collect();
            let count = lacking.iter().filter(|is_lacking| **is_lacking).count();
            if count == 0 {
                break;
            }
            let more = |each: usize, all: usize| if is_each { 2 * each * count } else { (each * count).min(all) };
            let [proposals, asked] = [more(PROPOSED, search.proposals), more(ASKED, search.asked)];
            let search = Search { proposals, asked, ..*search };
            let is_meant = |thing: Option<usize>| thing.is_some_and(|thing| lacking[thing]);
            let wanted = seen.things.shared(&seen.space, about, is_meant);
            let (found, count) = self.found(seen, &wanted, &search, TRIES_MORE_MAX, stream);
            judged.extend(found);
            proposed += count;
        }
        proposed
    }

    /// Candidates of one search about which the judge was asked, and the number of those that were proposed. So many
    /// are drawn at most for each.
    fn found(
        &self,
        seen: &Seen<'_>,
        wanted: &Wanted,
        search: &Search<'_>,
        tries_max: usize,
        stream: &mut Stream,
    ) -> (Vec<ScoredGrasp>, usize) {
        let counts = [search.proposals, search.proposals * tries_max];
        let candidates = self.sampler.search(&seen.space, wanted, search.are_wanted, counts, stream);
        let proposed = candidates.len();
        let chosen = self.likeliest(seen, candidates, *search);
        let grasps: Vec<Grasp> = chosen.iter().map(|(_, grasp)| *grasp).collect();
        let judged = pair(&grasps, &self.judge(seen, &grasps, [false; 2]));
        let of_thing =
            |((at_m, _), judged): (&(Vec3, Grasp), ScoredGrasp)| ScoredGrasp { thing: seen.things.at(*at_m), ..judged };
        (chosen.iter().zip(judged).map(of_thing).collect(), proposed)
    }

    /// What the judge says of the grasp of an earlier search where it is free and wanted, or a little before it.
    fn previous(&self, seen: &Seen<'_>, search: &Search<'_>) -> Option<ScoredGrasp> {
        let previous = search.previous?;
        let mut tries = BEFORE_M.map(|_| previous).to_vec();
        for (grasp, before_m) in tries.iter_mut().zip(BEFORE_M) {
            let approach = grasp.workspace_from_grasp.rotation * Vec3::Z;
            grasp.workspace_from_grasp.translation -= before_m * approach;
        }
        tries.retain(|grasp| self.sampler.is_free(&seen.space, &grasp.workspace_from_grasp));
        let mut tries = kept(&tries, &(search.are_wanted)(&tries));
        tries.truncate(1);
        pair(&tries, &self.judge(seen, &tries, [false; 2])).pop()
    }

    /// Moves grasps to where `better` finds that they fit better, as far as they are free and wanted there and the
    /// judge is as sure of them.
    fn move_where_better(
        &self,
        seen: &Seen<'_>,
        best: &mut [ScoredGrasp],
        Search { are_wanted, better, .. }: &Search<'_>,
    ) {
        let steps = best.par_iter().enumerate().flat_map_iter(|(place, judged)| {
            let there = better(&judged.grasp);
            let moved = there.into_iter().flat_map(|there| SHARES.map(|share| part_way(&judged.grasp, &there, share)));
            let free = moved.filter(|grasp| self.sampler.is_free(&seen.space, &grasp.workspace_from_grasp));
            free.map(move |grasp| (place, grasp)).collect::<Vec<_>>()
        });
        let steps: Vec<(usize, Grasp)> = steps.collect();
        let moved: Vec<Grasp> = steps.iter().map(|(_, grasp)| *grasp).collect();
        let steps = kept(&steps, &are_wanted(&moved));
        let moved: Vec<Grasp> = steps.iter().map(|(_, grasp)| *grasp).collect();
        let judged = pair(&moved, &self.judge(seen, &moved, [false; 2]));
        let least: Vec<f32> = best.iter().map(|judged| judged.quality() - AS_SURE).collect();
        for ((place, _), there) in steps.into_iter().zip(judged) {
            if there.quality() >= least[place] {
                best[place] = ScoredGrasp { thing: best[place].thing, ..there };
            }
        }
    }

    /// Asks about grasps in their mirror images, too.
    fn judge_mirrored(&self, seen: &Seen<'_>, best: &mut [ScoredGrasp]) {
        let grasps: Vec<Grasp> = best.iter().map(|judged| judged.grasp).collect();
        let mirrored = [[true, false], [false, true], [true, true]];
        for outcomes in mirrored.map(|mirrored| self.judge(seen, &grasps, mirrored)) {
            for (judged, (outcomes, robustness)) in best.iter_mut().zip(outcomes) {
                judged.outcomes.iter_mut().zip(outcomes).for_each(|(sum, outcome)| *sum += outcome);
                judged.robustness = judged.robustness.zip(robustness).map(|(sum, share)| sum + share);
            }
        }
        let images = (1 + mirrored.len()) as f32;
        for judged in best {
            judged.outcomes = judged.outcomes.map(|sum| sum / images);
            judged.robustness = judged.robustness.map(|sum| sum / images);
        }
    }

    /// Of many candidates the `asked` ones that a quick look finds likeliest to hold, in their order: then those that
    /// give each thing its share, and at last some that are apart from all others, so that all things are asked about.
    fn likeliest(
        &self,
        seen: &Seen<'_>,
        candidates: Vec<(Vec3, Grasp)>,
        Search { asked, spread, .. }: Search<'_>,
    ) -> Vec<(Vec3, Grasp)> {
        let Some(screen) = Screen::built_in().filter(|_| asked < candidates.len()) else { return candidates };
        let logits = |some: &[(Vec3, Grasp)]| {
            let poses: Vec<Pose> = some.iter().map(|(_, candidate)| candidate.workspace_from_grasp).collect();
            screen.logits(&self.crop, &seen.space.padded, seen.views, &poses)
        };
        let logits = candidates.par_chunks(SCREENED).map(logits).collect::<Vec<_>>().concat();
        let mut order: Vec<usize> = (0..candidates.len()).collect();
        order.sort_by(|a, b| logits[*b].total_cmp(&logits[*a]));
        let things: Vec<Option<usize>> = candidates.iter().map(|(at_m, _)| seen.things.at(*at_m)).collect();
        let count = things.iter().flatten().collect::<BTreeSet<_>>().len();
        let apart = asked / APART;
        let shared = match spread {
            _ if count == 0 => 0,
            Spread::Each => asked - apart,
            _ => asked / SHARED,
        };
        let (mut chosen, mut left) =
            (order[..asked - shared - apart].to_vec(), order[asked - shared - apart..].to_vec());
        let mut add = |most: usize, is_meant: &dyn Fn(&[usize], usize) -> bool| {
            left.retain(|number| {
                let is_chosen = chosen.len() < most && is_meant(&chosen, *number);
                chosen.extend(is_chosen.then_some(*number));
                !is_chosen
            });
        };
        add(asked - apart, &|chosen, number| {
            let of_it = chosen.iter().filter(|other| things[**other] == things[number]).count();
            things[number].is_some() && of_it < (shared / count).max(1)
        });
        let tips_m = |number: usize| candidates[number].1.workspace_from_grasp.translation;
        let is_apart = |other: usize, number: usize| (tips_m(other) - tips_m(number)).length() > SPREAD_M;
        add(asked, &|chosen, number| chosen.iter().all(|other| is_apart(*other, number)));
        chosen.extend(&left[..asked - chosen.len()]);
        chosen.sort_unstable();
        chosen.into_iter().map(|number| candidates[number]).collect()
    }

    /// What the network says of grasps, which are seen mirrored or not.
    fn judge(&self, seen: &Seen<'_>, grasps: &[Grasp], mirrored: [bool; 2]) -> Vec<Answer> {
        let is_robust = self.network.has_robustness();
        let answer = |logits| (probabilities(&logits), is_robust.then(|| robustness(&logits)));
        let together = |some: &[Grasp]| -> Vec<Answer> {
            let mut inputs = JudgeInputs::with_capacity(some.len());
            for Grasp { workspace_from_grasp, .. } in some {
                inputs.push(&self.crop, &seen.space.padded, workspace_from_grasp, seen.views, mirrored);
            }
            self.network.forward(&inputs).logits().map(answer).collect()
        };
        grasps.par_chunks(TOGETHER).map(together).collect::<Vec<_>>().concat()
    }
}

/// A grasp moved by a share of its way to another place, as that is turned.
fn part_way(from: &Grasp, to: &Grasp, share: f32) -> Grasp {
    let mut moved = *to;
    let [from_m, to_m] = [from, to].map(|grasp| grasp.workspace_from_grasp.translation);
    moved.workspace_from_grasp.translation = from_m + share * (to_m - from_m);
    moved
}

/// Where the grasps that may hold have their tips.
fn hopeful_m(judged: &[ScoredGrasp]) -> Vec<Vec3> {
    let hopeful = judged.iter().filter(|judged| judged.quality() > HOPE);
    hopeful.map(|judged| judged.grasp.workspace_from_grasp.translation).collect()
}

/// The best grasps that are this far apart, of grasps in order, and the others. Where each thing counts, its best one
/// that may hold is among them.
fn leaders(judged: Vec<ScoredGrasp>, apart_m: f32, spread: Spread) -> (Vec<ScoredGrasp>, Vec<ScoredGrasp>) {
    let (mut best, mut rest) = (Vec::<ScoredGrasp>::new(), Vec::new());
    for judged in judged {
        let is_first = spread == Spread::Each
            && judged.thing.is_some()
            && judged.quality() > HOPE
            && best.iter().all(|better| better.thing != judged.thing);
        let leads = (best.len() < LEADERS || is_first) && !best.iter().any(|better| better.is_near(&judged, apart_m));
        if leads { &mut best } else { &mut rest }.push(judged);
    }
    (best, rest)
}

fn pair(grasps: &[Grasp], answers: &[Answer]) -> Vec<ScoredGrasp> {
    let scored = |(grasp, (outcomes, robustness)): (&Grasp, &Answer)| ScoredGrasp {
        grasp: *grasp,
        outcomes: *outcomes,
        robustness: *robustness,
        thing: None,
    };
    grasps.iter().zip(answers).map(scored).collect()
}

/// Best first; last those whose answers are not numbers, as of weights that overflow.
fn sorted(mut judged: Vec<ScoredGrasp>) -> Vec<ScoredGrasp> {
    let key = |judged: &ScoredGrasp| Some(judged.quality()).filter(|quality| !quality.is_nan());
    judged.sort_by(|a, b| key(b).unwrap_or(-1.0).total_cmp(&key(a).unwrap_or(-1.0)));
    judged
}
