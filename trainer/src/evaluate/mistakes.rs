//! The worst errors of a network: failed attempts with the highest predicted qualities, and held attempts with the
//! lowest. Only a limited number is kept.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use crate::scores::Score;

/// An attempt with its prediction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mistake {
    /// The scene.
    pub scene_id: u64,
    /// The attempt within the scene.
    pub attempt_id: u32,
    /// Prediction and label.
    pub score: Score,
}

/// The worst errors, worst first; equal ones in the order of scenes and attempts.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mistakes {
    /// Failed attempts with the highest qualities.
    pub overrated: Vec<Mistake>,
    /// Held attempts with the lowest qualities.
    pub underrated: Vec<Mistake>,
}

/// Collects the worst attempts.
#[derive(Debug)]
pub(super) struct Keeper {
    most: usize,
    overrated: BinaryHeap<Kept>,
    underrated: BinaryHeap<Kept>,
}

/// The maximum of a heap is the least bad attempt, which is removed first.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Kept(Mistake);

impl Keeper {
    /// Keeps up to `most` of each kind.
    pub(super) fn new(most: usize) -> Self {
        Self { most, overrated: BinaryHeap::new(), underrated: BinaryHeap::new() }
    }

    /// Adds an attempt. A quality that is NaN is ignored.
    pub(super) fn see(&mut self, mistake: Mistake) {
        if mistake.score.logit.is_nan() {
            return;
        }
        let heap = if mistake.score.held { &mut self.underrated } else { &mut self.overrated };
        heap.push(Kept(mistake));
        if heap.len() > self.most {
            heap.pop();
        }
    }

    pub(super) fn into_mistakes(self) -> Mistakes {
        let worst_first = |heap: BinaryHeap<Kept>| heap.into_sorted_vec().into_iter().map(|kept| kept.0).collect();
        Mistakes { overrated: worst_first(self.overrated), underrated: worst_first(self.underrated) }
    }
}

impl Ord for Kept {
    fn cmp(&self, other: &Self) -> Ordering {
        let (a, b) = (&self.0, &other.0);
        let by_logit = a.score.logit.total_cmp(&b.score.logit);
        // A heap has one kind: high qualities are bad for failures, low ones for successes.
        let by_badness = if a.score.held { by_logit } else { by_logit.reverse() };
        by_badness.then_with(|| (a.scene_id, a.attempt_id).cmp(&(b.scene_id, b.attempt_id)))
    }
}

impl PartialOrd for Kept {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Eq for Kept {}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The sorted attempts of one kind.
    fn slowly(all: &[Mistake], held: bool, most: usize) -> Vec<Mistake> {
        let mut own: Vec<Mistake> = all.iter().filter(|one| one.score.held == held).copied().collect();
        own.retain(|one| !one.score.logit.is_nan());
        let sign = if held { 1.0 } else { -1.0 };
        own.sort_by(|a, b| {
            let [x, y] = [a, b].map(|one| (sign * one.score.logit, one.scene_id, one.attempt_id));
            x.partial_cmp(&y).unwrap()
        });
        own.truncate(most);
        own
    }

    proptest! {
        #[test]
        fn the_worst_are_those_that_sorting_everything_finds(
            logits in prop::collection::vec((-4_i8..5, any::<bool>()), 0..80), most in 0_usize..9,
        ) {
            let all: Vec<Mistake> = logits.iter().enumerate().map(|(at, (logit, held))| {
                let logit = if *logit == 4 { f32::NAN } else { f32::from(*logit) + 0.5 };
                let (scene_id, attempt_id) = (at as u64 / 7, at as u32 % 7);
                Mistake { scene_id, attempt_id, score: Score { logit, held: *held } }
            }).collect();
            let mut keeper = Keeper::new(most);
            for (seen, one) in all.iter().enumerate() {
                keeper.see(*one);
                prop_assert!(keeper.overrated.len() + keeper.underrated.len() <= (2 * most).min(seen + 1));
            }
            let found = keeper.into_mistakes();
            prop_assert_eq!(found.overrated, slowly(&all, false, most));
            prop_assert_eq!(found.underrated, slowly(&all, true, most));
        }
    }
}
