//! The worst errors of a network: failed attempts with the highest predicted qualities, and held attempts with the
//! lowest.

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

/// The worst `most` of the attempts that held or of those that failed, worst first; equal ones in the order of scenes
/// and attempts. A quality that is NaN is ignored.
pub(super) fn worst(all: &[Mistake], held: bool, most: usize) -> Vec<Mistake> {
    let own = all.iter().filter(|one| one.score.held == held && !one.score.logit.is_nan());
    let mut worst: Vec<Mistake> = own.copied().collect();
    worst.sort_by(|a, b| {
        let by_logit = a.score.logit.total_cmp(&b.score.logit);
        // High qualities are bad for failures, low ones for successes.
        let by_badness = if held { by_logit } else { by_logit.reverse() };
        by_badness.then_with(|| (a.scene_id, a.attempt_id).cmp(&(b.scene_id, b.attempt_id)))
    });
    worst.truncate(most);
    worst
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_worst_are_no_better_than_what_is_left_out_and_stand_in_order(
            logits in prop::collection::vec((-4_i8..5, any::<bool>()), 0..80), most in 0_usize..9,
        ) {
            let all: Vec<Mistake> = logits.iter().enumerate().map(|(at, (logit, held))| {
                let logit = if *logit == 4 { f32::NAN } else { f32::from(*logit) + 0.5 };
                let (scene_id, attempt_id) = (at as u64 / 7, at as u32 % 7);
                Mistake { scene_id, attempt_id, score: Score { logit, held: *held } }
            }).collect();
            for held in [false, true] {
                let key = |one: &Mistake| {
                    let goodness = if held { one.score.logit } else { -one.score.logit };
                    (goodness, one.scene_id, one.attempt_id)
                };
                let own: Vec<_> =
                    all.iter().filter(|one| one.score.held == held).map(key).filter(|key| !key.0.is_nan()).collect();
                let found: Vec<_> = worst(&all, held, most).iter().map(key).collect();
                prop_assert_eq!(found.len(), most.min(own.len()));
                prop_assert!(found.is_sorted_by(|a, b| a < b));
                prop_assert!(found.iter().all(|one| own.contains(one)));
                if let Some(last) = found.last() {
                    prop_assert_eq!(own.iter().filter(|one| *one <= last).count(), found.len());
                }
            }
        }
    }
}
