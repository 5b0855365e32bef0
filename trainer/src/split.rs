//! The split into training and test samples: a pure function of the seed and the ids.
//!
//! Two test sets are always held out, so that one trained network gives two accuracies. First, whole scenes are held
//! out (`test scenes`: the network never sees their grids). Then single attempts of the remaining scenes are held out
//! (`test attempts`, as in the paper: the network sees the same grid with other attempts). The rest is used for
//! training. [`crate::config::SplitConfig`] selects which of the two is *the* test set and the size of each.
//!
//! Every scene and every attempt has a draw, and those with the smallest are held out.

use program::{ExitCode, Failure};
use rayon::prelude::*;
use schema::{Purpose, Stream};

use crate::config::{SplitBy, SplitConfig};
use crate::data::split_bits::{HELD, HITS_TABLE, NO_SAMPLE};
use crate::data::{Set, SplitBits};

/// Labels of the sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Labels {
    /// Of the training samples.
    pub train: LabelCount,
    /// Of held-out attempts of training scenes.
    pub test_attempts: LabelCount,
    /// Of held-out scenes.
    pub test_scenes: LabelCount,
}

/// Splits the samples of shards; afterwards an attempt's mark is its [`Set`]. Grasps at which the gripper hits the
/// table are in no training set: of them there is nothing to learn.
///
/// # Errors
/// If a set would be empty.
pub fn split(marks: &mut [SplitBits], seed: u64, config: &SplitConfig) -> Result<Labels, Failure> {
    let (scene_share, attempt_share) = match config.by {
        SplitBy::Attempt => (config.other_share, config.test_share),
        SplitBy::Scene => (config.test_share, config.other_share),
    };
    let with_samples = |marks: &SplitBits| {
        let scenes = marks.scenes().filter(|scene| marks.has(*scene, |mark| mark != NO_SAMPLE));
        scenes.map(|scene| draw(seed, scene, 0)).collect::<Vec<_>>()
    };
    let scene_draws: Vec<u64> = marks.par_iter().flat_map_iter(with_samples).collect();
    let scenes = scene_draws.len();
    let last_scene = last_held_out(scene_draws, scene_share * scenes as f64);
    let is_held_out = |scene: u32| draw(seed, scene, 0) <= last_scene;
    let count = |marks: &SplitBits| marks.scenes().map(|scene| samples_of(marks, scene).len()).sum::<usize>();
    let samples: usize = marks.par_iter().map(count).sum();
    let of_scene = |marks: &SplitBits, scene: u32| {
        samples_of(marks, scene).into_iter().map(move |(attempt, _)| draw(seed, scene, attempt + 1))
    };
    let of_shard = |marks: &SplitBits| {
        let scenes = marks.scenes().filter(|scene| !is_held_out(*scene));
        scenes.flat_map(|scene| of_scene(marks, scene)).collect::<Vec<_>>()
    };
    let last_attempt =
        last_held_out(marks.par_iter().flat_map_iter(of_shard).collect(), attempt_share * samples as f64);
    let assign = |marks: &mut SplitBits| {
        let mut labels = Labels::default();
        for scene in marks.scenes() {
            let is_held_out = is_held_out(scene);
            for (attempt, mark) in samples_of(marks, scene) {
                let set = match draw(seed, scene, attempt + 1) {
                    _ if is_held_out => Set::TestScenes,
                    draw if draw <= last_attempt => Set::TestAttempts,
                    _ => Set::Train,
                };
                labels.put(marks, scene, attempt, mark, set);
            }
        }
        labels
    };
    let labels = marks.par_iter_mut().map(assign).reduce(Labels::default, Labels::plus);
    let counts = [labels.train, labels.test_attempts, labels.test_scenes].map(|set| set.samples);
    if counts.contains(&0) {
        let [train, test_attempts, test_scenes] = counts;
        let text = format!(
            "the split leaves {train} samples to train on, {test_attempts} test attempts and {test_scenes} samples of test \
             scenes, of {samples} samples in {scenes} scenes: none may be 0, take more data or other shares"
        );
        return Err(Failure::new(ExitCode::Config, text));
    }
    Ok(labels)
}

/// The draw of the last that is held out, of about so many with the smallest draws.
fn last_held_out(mut draws: Vec<u64>, count: f64) -> u64 {
    let count = (count.round().max(1.0) as usize).min(draws.len());
    count.checked_sub(1).map_or(0, |last| *draws.select_nth_unstable(last).1)
}

/// Attempts of a scene with a sample, and their marks.
fn samples_of(marks: &SplitBits, scene: u32) -> Vec<(u32, u8)> {
    marks.of_scene(scene).filter(|(_, mark)| *mark != NO_SAMPLE).collect()
}

impl Labels {
    /// Puts a sample into a set.
    fn put(&mut self, marks: &mut SplitBits, scene: u32, attempt: u32, mark: u8, set: Set) {
        let is_useless = set == Set::Train && mark == HITS_TABLE;
        marks.set(scene, attempt, if is_useless { NO_SAMPLE } else { set as u8 });
        let own = match set {
            Set::Train if is_useless => return,
            Set::Train => &mut self.train,
            Set::TestAttempts => &mut self.test_attempts,
            Set::TestScenes => &mut self.test_scenes,
        };
        own.add(LabelCount { samples: 1, held: usize::from(mark == HELD) });
    }

    fn plus(mut self, other: Self) -> Self {
        self.train.add(other.train);
        self.test_attempts.add(other.test_attempts);
        self.test_scenes.add(other.test_scenes);
        self
    }
}

/// The stream of try 0 draws for a scene, that of try a + 1 for its attempt a.
fn draw(seed: u64, scene: u32, attempt: u32) -> u64 {
    Stream::new(seed, scene.into(), Purpose::Split, attempt).bits()
}

/// Labels of a set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LabelCount {
    /// Samples.
    pub samples: usize,
    /// Successes among them.
    pub held: usize,
}

impl LabelCount {
    pub(crate) fn add(&mut self, other: Self) {
        self.samples += other.samples;
        self.held += other.held;
    }

    /// The accuracy of always answering "failure"; 1 without samples.
    #[must_use]
    pub fn baseline_accuracy(&self) -> f64 {
        1.0 - self.held as f64 / self.samples.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;
    use crate::data::split_bits::FAILED;

    /// Shards of scenes with these marks.
    fn marks(scenes: u32, attempts: u32, mark: impl Fn(u32, u32) -> u8) -> Vec<SplitBits> {
        let edges: Vec<u32> = (0..=scenes).step_by(7).chain([scenes]).collect();
        let shard = |range: &[u32]| {
            let mut marks =
                SplitBits::new(range[0]..range[1], attempts as usize, ((range[1] - range[0]) * attempts) as usize);
            for scene in marks.scenes() {
                (0..attempts).for_each(|attempt| marks.set(scene, attempt, mark(scene, attempt)));
            }
            marks
        };
        edges.windows(2).map(shard).collect()
    }

    /// Scene, attempt and mark of every attempt.
    fn all(marks: &[SplitBits]) -> Vec<(u32, u32, u8)> {
        let of_scene =
            |marks: &SplitBits, scene| marks.of_scene(scene).map(move |(a, mark)| (scene, a, mark)).collect::<Vec<_>>();
        marks.iter().flat_map(|marks| marks.scenes().flat_map(|scene| of_scene(marks, scene))).collect()
    }

    /// The same with lists of everything, as it was done when checkpoints of 0.2 were trained.
    fn by_ranking(ids: &[(u32, u32)], seed: u64, config: &SplitConfig) -> Vec<Set> {
        let (scene_share, attempt_share) = match config.by {
            SplitBy::Attempt => (config.other_share, config.test_share),
            SplitBy::Scene => (config.test_share, config.other_share),
        };
        let scenes: BTreeSet<u32> = ids.iter().map(|(scene, _)| *scene).collect();
        let scene_count = (scene_share * scenes.len() as f64).round().max(1.0) as usize;
        let mut ranked: Vec<(u64, u32)> = scenes.iter().map(|scene| (draw(seed, *scene, 0), *scene)).collect();
        ranked.sort_unstable();
        let held_out: BTreeSet<u32> = ranked.into_iter().take(scene_count).map(|(_, scene)| scene).collect();
        let others = (0..ids.len()).filter(|at| !held_out.contains(&ids[*at].0));
        let mut ranked: Vec<(u64, usize)> = others.map(|at| (draw(seed, ids[at].0, ids[at].1 + 1), at)).collect();
        ranked.sort_unstable();
        let mut sets = vec![Set::TestScenes; ids.len()];
        let attempt_count = (attempt_share * ids.len() as f64).round().max(1.0) as usize;
        for (rank, (_, at)) in ranked.into_iter().enumerate() {
            sets[at] = if rank < attempt_count { Set::TestAttempts } else { Set::Train };
        }
        sets
    }

    const BY_ATTEMPT: SplitConfig = SplitConfig { by: SplitBy::Attempt, test_share: 0.1, other_share: 0.05 };

    proptest! {
        #[test]
        fn it_is_the_split_by_ranking_everything(
            seed in 0_u64..1000, scenes in 3_u32..60, attempts in 2_u32..40, share in 0.01_f64..0.4, by_scene: bool,
        ) {
            let by = if by_scene { SplitBy::Scene } else { SplitBy::Attempt };
            let config = SplitConfig { by, test_share: share, other_share: 0.1 };
            let mut marks = marks(scenes, attempts, |scene, attempt| ((scene * 5 + attempt * 3) % 7 % 4) as u8);
            let before = all(&marks);
            let Ok(labels) = split(&mut marks, seed, &config) else { return Ok(()) };
            let samples: Vec<_> = before.iter().zip(all(&marks)).filter(|(was, _)| was.2 != NO_SAMPLE).collect();
            let ids: Vec<(u32, u32)> = samples.iter().map(|(was, _)| (was.0, was.1)).collect();
            let mut slow = Labels::default();
            for ((was, is), set) in samples.iter().zip(by_ranking(&ids, seed, &config)) {
                let is_useless = set == Set::Train && was.2 == HITS_TABLE;
                prop_assert_eq!(is.2, if is_useless { NO_SAMPLE } else { set as u8 });
                let own = match set {
                    Set::Train => &mut slow.train,
                    Set::TestAttempts => &mut slow.test_attempts,
                    Set::TestScenes => &mut slow.test_scenes,
                };
                own.add(LabelCount { samples: usize::from(!is_useless), held: usize::from(was.2 == HELD) });
            }
            prop_assert_eq!(labels, slow);
        }
    }

    #[test]
    fn shares_are_kept_and_scenes_do_not_leak() {
        for config in [BY_ATTEMPT, SplitConfig { by: SplitBy::Scene, ..BY_ATTEMPT }] {
            let mut marks = marks(200, 60, |_, _| FAILED);
            let labels = split(&mut marks, 3, &config).unwrap();
            let (scenes, attempts) = match config.by {
                SplitBy::Attempt => (600, 1200),
                SplitBy::Scene => (1200, 600),
            };
            assert_eq!((labels.test_scenes.samples, labels.test_attempts.samples), (scenes, attempts));
            assert_eq!(labels.train.samples, 200 * 60 - scenes - attempts);
            for scene in all(&marks).chunks(60) {
                let held_out = scene.iter().filter(|(.., mark)| *mark == Set::TestScenes as u8).count();
                assert!([0, 60].contains(&held_out), "{held_out}");
            }
        }
    }

    #[test]
    fn another_seed_splits_in_another_way() {
        let of = |seed: u64| {
            let mut marks = marks(50, 20, |_, _| HELD);
            split(&mut marks, seed, &BY_ATTEMPT).unwrap();
            all(&marks)
        };
        assert_eq!(of(7), of(7));
        assert_ne!(of(7), of(8));
    }

    #[test]
    fn one_scene_cannot_be_split() {
        let error = split(&mut marks(1, 60, |_, _| FAILED), 0, &BY_ATTEMPT).unwrap_err().to_string();
        for words in ["leaves 0 samples to train on", " 60 samples of test scenes", "none may be 0"] {
            assert!(error.contains(words), "{words} is not in {error}");
        }
    }
}
