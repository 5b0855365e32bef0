//! The judge decides: grasp candidates are proposed on what was seen, and the network says how each attempt would end.

use network::checkpoint::Checkpoint;
use network::judge::{Crop, JudgeInputs, JudgeNetwork, OUTCOMES, Screen, probabilities, robustness};
use program::Failure;
use rayon::prelude::*;
use schema::{Grasp, Grid, Gripper, Outcome, Pose, Stream, Vec3};

use crate::{CandidateSampler, ObservedScene, Search, Space, kept};

/// Candidates that one thread judges together.
const TOGETHER: usize = 8;
/// Candidates at which one thread looks quickly together.
const SCREENED: usize = 32;
/// One of so many candidates that are chosen has its tips further than this from all that were chosen before.
const APART: usize = 8;
const SPREAD_M: f32 = 0.03;

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
    /// proposed, and if `about_m` has places only near these. The best grasps are moved towards a `better` place.
    #[must_use]
    pub fn scored_grasps(
        &self,
        seen: ObservedScene<'_>,
        search: &Search<'_>,
        stream: &mut Stream,
    ) -> (Vec<ScoredGrasp>, usize) {
        let Search { proposals, asked, apart_m, about_m, are_wanted, .. } = *search;
        let space = Space::new(seen.field, seen.fine, seen.reach_m);
        let (mut judged, mut proposed) = (Vec::<ScoredGrasp>::new(), 0);
        let mut wanted = space.near(about_m, ABOUT_M);
        for [more, more_asked] in SEARCHES {
            let candidates = self.sampler.search(&space, &wanted, are_wanted, more * proposals, stream);
            proposed += candidates.len();
            let candidates = self.likeliest(&space, seen.views, candidates, more_asked * asked);
            judged.extend(pair(&candidates, &self.judge(&space, seen.views, &candidates, [false; 2])));
            if candidates.is_empty() || judged.iter().any(|judged| judged.quality() > SURE) {
                break;
            }
            wanted = space.near(&hopeful_m(&judged), NEAR_M);
        }
        let (mut best, rest) = leaders(sorted(judged), apart_m);
        self.move_where_better(&space, seen.views, &mut best, search);
        let grasps: Vec<Grasp> = best.iter().map(|judged| judged.grasp).collect();
        let mirrored = [[true, false], [false, true], [true, true]];
        for outcomes in mirrored.map(|mirrored| self.judge(&space, seen.views, &grasps, mirrored)) {
            for (judged, (outcomes, robustness)) in best.iter_mut().zip(outcomes) {
                judged.outcomes.iter_mut().zip(outcomes).for_each(|(sum, outcome)| *sum += outcome);
                judged.robustness = judged.robustness.zip(robustness).map(|(sum, share)| sum + share);
            }
        }
        let images = (1 + mirrored.len()) as f32;
        for judged in &mut best {
            judged.outcomes = judged.outcomes.map(|sum| sum / images);
            judged.robustness = judged.robustness.map(|sum| sum / images);
        }
        let mut all = sorted(best);
        all.extend(rest);
        (all, proposed)
    }

    /// Moves grasps to where `better` finds that they fit better, as far as they are free and wanted there and the
    /// judge is as sure of them.
    fn move_where_better(
        &self,
        space: &Space<'_>,
        views: usize,
        best: &mut [ScoredGrasp],
        Search { are_wanted, better, .. }: &Search<'_>,
    ) {
        let steps = best.par_iter().enumerate().flat_map_iter(|(place, judged)| {
            let there = better(&judged.grasp);
            let moved = there.into_iter().flat_map(|there| SHARES.map(|share| part_way(&judged.grasp, &there, share)));
            let free = moved.filter(|grasp| self.sampler.is_free(space, &grasp.workspace_from_grasp));
            free.map(move |grasp| (place, grasp)).collect::<Vec<_>>()
        });
        let steps: Vec<(usize, Grasp)> = steps.collect();
        let moved: Vec<Grasp> = steps.iter().map(|(_, grasp)| *grasp).collect();
        let steps = kept(&steps, &are_wanted(&moved));
        let moved: Vec<Grasp> = steps.iter().map(|(_, grasp)| *grasp).collect();
        let judged = pair(&moved, &self.judge(space, views, &moved, [false; 2]));
        let least: Vec<f32> = best.iter().map(|judged| judged.quality() - AS_SURE).collect();
        for ((place, _), there) in steps.into_iter().zip(judged) {
            if there.quality() >= least[place] {
                best[place] = there;
            }
        }
    }

    /// Of many candidates the `asked` ones that a quick look finds likeliest to hold, in their order: at last some that
    /// are apart from all others, so that all things are asked about.
    fn likeliest(&self, space: &Space<'_>, views: usize, candidates: Vec<Grasp>, asked: usize) -> Vec<Grasp> {
        let Some(screen) = Screen::built_in().filter(|_| asked < candidates.len()) else { return candidates };
        let logits = |some: &[Grasp]| {
            let poses: Vec<Pose> = some.iter().map(|candidate| candidate.workspace_from_grasp).collect();
            screen.logits(&self.crop, &space.padded, views, &poses)
        };
        let logits = candidates.par_chunks(SCREENED).map(logits).collect::<Vec<_>>().concat();
        let mut order: Vec<usize> = (0..candidates.len()).collect();
        order.sort_by(|a, b| logits[*b].total_cmp(&logits[*a]));
        let (mut chosen, mut left) = (order[..asked - asked / APART].to_vec(), order[asked - asked / APART..].to_vec());
        let tips_m = |number: usize| candidates[number].workspace_from_grasp.translation;
        left.retain(|number| {
            let is_apart = |other: &usize| (tips_m(*other) - tips_m(*number)).length() > SPREAD_M;
            let is_chosen = chosen.len() < asked && chosen.iter().all(is_apart);
            chosen.extend(is_chosen.then_some(*number));
            !is_chosen
        });
        chosen.extend(&left[..asked - chosen.len()]);
        chosen.sort_unstable();
        chosen.into_iter().map(|number| candidates[number]).collect()
    }

    /// What the network says of grasps, which are seen mirrored or not.
    fn judge(&self, space: &Space<'_>, views: usize, grasps: &[Grasp], mirrored: [bool; 2]) -> Vec<Answer> {
        let is_robust = self.network.has_robustness();
        let answer = |logits| (probabilities(&logits), is_robust.then(|| robustness(&logits)));
        let together = |some: &[Grasp]| -> Vec<Answer> {
            let mut inputs = JudgeInputs::with_capacity(some.len());
            for Grasp { workspace_from_grasp, .. } in some {
                inputs.push(&self.crop, &space.padded, workspace_from_grasp, views, mirrored);
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

/// The best grasps that are this far apart, of grasps in order, and the others.
fn leaders(judged: Vec<ScoredGrasp>, apart_m: f32) -> (Vec<ScoredGrasp>, Vec<ScoredGrasp>) {
    let (mut best, mut rest) = (Vec::<ScoredGrasp>::new(), Vec::new());
    for judged in judged {
        let leads = best.len() < LEADERS && !best.iter().any(|better| better.is_near(&judged, apart_m));
        if leads { &mut best } else { &mut rest }.push(judged);
    }
    (best, rest)
}

fn pair(grasps: &[Grasp], answers: &[Answer]) -> Vec<ScoredGrasp> {
    let scored = |(grasp, (outcomes, robustness)): (&Grasp, &Answer)| ScoredGrasp {
        grasp: *grasp,
        outcomes: *outcomes,
        robustness: *robustness,
    };
    grasps.iter().zip(answers).map(scored).collect()
}

/// Best first; last those whose answers are not numbers, as of weights that overflow.
fn sorted(mut judged: Vec<ScoredGrasp>) -> Vec<ScoredGrasp> {
    let key = |judged: &ScoredGrasp| Some(judged.quality()).filter(|quality| !quality.is_nan());
    judged.sort_by(|a, b| key(b).unwrap_or(-1.0).total_cmp(&key(a).unwrap_or(-1.0)));
    judged
}
