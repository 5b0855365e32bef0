//! The attempts that a network was most wrong about: those with the highest quality that failed, and those with the lowest that
//! held. Of all that are seen only so many are kept.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use crate::scores::Score;

/// An attempt, and what the network said of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mistake {
    /// The scene.
    pub scene_id: u64,
    /// The attempt within the scene.
    pub attempt_id: u32,
    /// What was predicted and what happened.
    pub score: Score,
}

/// The worst mistakes, worst first; of equal ones those of earlier scenes and attempts.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mistakes {
    /// They failed, and have the highest qualities among those that did.
    pub overrated: Vec<Mistake>,
    /// They held, and have the lowest qualities among those that did.
    pub underrated: Vec<Mistake>,
}

/// What keeps the worst of the attempts that it sees.
#[derive(Debug)]
pub(super) struct Keeper {
    most: usize,
    overrated: BinaryHeap<Kept>,
    underrated: BinaryHeap<Kept>,
}

/// The greatest of a heap is the least bad: the one to go.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Kept(Mistake);

impl Keeper {
    /// Keeps up to `most` of either kind.
    pub(super) fn new(most: usize) -> Self {
        Self { most, overrated: BinaryHeap::new(), underrated: BinaryHeap::new() }
    }

    /// Looks at an attempt. A quality that is no number says nothing and is passed over.
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
        // A heap holds one kind: of what failed high is bad, of what held low is.
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

    /// All of one kind, sorted, and the first of them.
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
