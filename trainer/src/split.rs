//! The split into training and test samples: a pure function of the seed and the ids.
//!
//! Two test sets are always held out, so that one trained network gives two accuracies. First, whole scenes are held
//! out (`test scenes`: the network never sees their grids). Then single attempts of the remaining scenes are held out
//! (`test attempts`, as in the paper: the network sees the same grid with other attempts). The rest is used for
//! training. [`crate::config::SplitConfig`] selects which of the two is *the* test set and the size of each.

use std::collections::BTreeSet;

use program::{ExitCode, Failure};
use schema::{Purpose, Stream};

use crate::config::{SplitBy, SplitConfig};

/// The indices of the samples in each set, ascending.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Split {
    /// Training samples.
    pub train: Vec<usize>,
    /// Held-out attempts of training scenes.
    pub test_attempts: Vec<usize>,
    /// Every sample of the held-out scenes.
    pub test_scenes: Vec<usize>,
}

/// Splits samples, given as (scene, attempt) ids.
///
/// # Errors
/// If a set would be empty.
pub fn split(ids: &[(u64, u32)], seed: u64, config: &SplitConfig) -> Result<Split, Failure> {
    let (scene_share, attempt_share) = match config.by {
        SplitBy::Attempt => (config.other_share, config.test_share),
        SplitBy::Scene => (config.test_share, config.other_share),
    };
    let scenes: BTreeSet<u64> = ids.iter().map(|(scene, _)| *scene).collect();
    let scene_count = (scene_share * scenes.len() as f64).round().max(1.0) as usize;
    let mut ranked: Vec<(u64, u64)> = scenes.iter().map(|scene| (draw(seed, *scene, 0), *scene)).collect();
    ranked.sort_unstable();
    let held_out: BTreeSet<u64> = ranked.into_iter().take(scene_count).map(|(_, scene)| scene).collect();

    let (in_test_scenes, others): (Vec<usize>, Vec<usize>) =
        (0..ids.len()).partition(|at| held_out.contains(&ids[*at].0));
    let attempt_count = (attempt_share * ids.len() as f64).round().max(1.0) as usize;
    let mut ranked: Vec<(u64, usize)> =
        others.into_iter().map(|at| (draw(seed, ids[at].0, ids[at].1 + 1), at)).collect();
    ranked.sort_unstable();
    let train = ranked.split_off(attempt_count.min(ranked.len()));
    let ascending = |ranked: Vec<(u64, usize)>| {
        let mut numbers: Vec<usize> = ranked.into_iter().map(|(_, at)| at).collect();
        numbers.sort_unstable();
        numbers
    };
    let split = Split { train: ascending(train), test_attempts: ascending(ranked), test_scenes: in_test_scenes };
    let counts = [&split.train, &split.test_attempts, &split.test_scenes].map(Vec::len);
    if counts.contains(&0) {
        let ([train, test_attempts, test_scenes], samples, scenes) = (counts, ids.len(), scenes.len());
        let text = format!(
            "the split leaves {train} samples to train on, {test_attempts} test attempts and {test_scenes} samples of test \
             scenes, of {samples} samples in {scenes} scenes: none may be 0, take more data or other shares"
        );
        return Err(Failure::new(ExitCode::Config, text));
    }
    Ok(split)
}

/// The stream of try 0 draws for a scene, that of try a + 1 for its attempt a.
fn draw(seed: u64, scene: u64, attempt: u32) -> u64 {
    Stream::new(seed, scene, Purpose::Split, attempt).bits()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ids(scenes: u64, attempts: u32) -> Vec<(u64, u32)> {
        (0..scenes).flat_map(|scene| (0..attempts).map(move |attempt| (scene, attempt))).collect()
    }

    const BY_ATTEMPT: SplitConfig = SplitConfig { by: SplitBy::Attempt, test_share: 0.1, other_share: 0.05 };

    #[test]
    fn shares_are_kept_and_scenes_do_not_leak() {
        let ids = ids(200, 60);
        for config in [BY_ATTEMPT, SplitConfig { by: SplitBy::Scene, ..BY_ATTEMPT }] {
            let split = split(&ids, 3, &config).unwrap();
            let (scenes, attempts) = match config.by {
                SplitBy::Attempt => (600, 1200),
                SplitBy::Scene => (1200, 600),
            };
            assert_eq!((split.test_scenes.len(), split.test_attempts.len()), (scenes, attempts));
            let held_out: BTreeSet<u64> = split.test_scenes.iter().map(|at| ids[*at].0).collect();
            assert!(split.train.iter().chain(&split.test_attempts).all(|at| !held_out.contains(&ids[*at].0)));
            let mut all = [split.train, split.test_attempts, split.test_scenes].concat();
            all.sort_unstable();
            assert_eq!(all, (0..ids.len()).collect::<Vec<_>>());
        }
    }

    #[test]
    fn the_same_seed_splits_the_same_way() {
        let ids = ids(50, 20);
        let of = |seed: u64| split(&ids, seed, &BY_ATTEMPT).unwrap();
        assert_eq!(of(7), of(7));
        assert_ne!(of(7), of(8));
    }

    #[test]
    fn one_scene_cannot_be_split() {
        let error = split(&ids(1, 60), 0, &BY_ATTEMPT).unwrap_err().to_string();
        for words in ["leaves 0 samples to train on", " 60 samples of test scenes", "none may be 0"] {
            assert!(error.contains(words), "{words} is not in {error}");
        }
    }
}
