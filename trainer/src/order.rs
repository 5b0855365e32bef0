//! The order in which samples are visited: a pure function of the seed, the epoch and the recipe.
//!
//! Up to `shuffle_scenes` scenes are in memory, and an epoch is a full shuffle. Of more scenes only a window of
//! `shuffle_scenes` is in memory, which goes through the shards in a random order, `LANES` of them at once. A group
//! of samples is visited at a random time while its scene is in the window, so a batch mixes scenes of the whole window
//! and a scene's samples spread over all of its time there.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::iter::from_fn;

use schema::{Purpose, Stream};

use crate::config::{Config, TrainingParams};
use crate::data::split_bits::shard_of;
use crate::data::{Set, SplitBits};

/// Shards that are read at once, each by its own thread.
pub(crate) const LANES: usize = 8;

/// The samples of a batch.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    /// Which of the sets it belongs to, where several are visited together.
    pub set: usize,
    /// Scene and attempt of each sample.
    pub samples: Vec<(u32, u32)>,
    /// The first so many scenes are not needed after this batch.
    pub done: usize,
}

/// The order in which scenes are read.
#[derive(Debug, Clone)]
pub struct SceneOrder {
    /// The scenes.
    pub scenes: Vec<u32>,
    /// For each shard the lane that reads it.
    lanes: Vec<u8>,
}

impl SceneOrder {
    /// The scenes with an attempt of some marks, ascending.
    #[must_use]
    pub fn ascending(marks: &[SplitBits], is_wanted: impl Fn(u8) -> bool) -> Self {
        let scenes = marks.iter().flat_map(|marks| wanted(marks, &is_wanted)).collect();
        Self { scenes, lanes: (0..marks.len()).map(|shard| (shard % LANES) as u8).collect() }
    }

    /// The scenes with training samples, as an epoch reads them: shards in random order, and of those that are read at
    /// once a scene of each in turn. A shard's scenes are read in their order, so that its files are opened once and
    /// it may be of any size.
    fn shuffled(marks: &[SplitBits], seed: u64, epoch: u32) -> Self {
        let mut shards: Vec<usize> = (0..marks.len()).collect();
        Stream::new(seed, epoch.into(), Purpose::Shuffle, 1).shuffle(&mut shards);
        let mut lanes = vec![0; marks.len()];
        for (rank, shard) in shards.iter().enumerate() {
            lanes[*shard] = (rank % LANES) as u8;
        }
        let lane = |lane| shards.iter().skip(lane).step_by(LANES).flat_map(|shard| wanted(&marks[*shard], is_train));
        let mut readers: Vec<_> = (0..LANES).map(lane).collect();
        let mut scenes = Vec::new();
        loop {
            let before = scenes.len();
            scenes.extend(readers.iter_mut().filter_map(Iterator::next));
            if scenes.len() == before {
                return Self { scenes, lanes };
            }
        }
    }

    /// The lane that reads a scene.
    pub(crate) fn lane(&self, marks: &[SplitBits], scene: u32) -> usize {
        self.lanes[shard_of(marks, scene)].into()
    }
}

fn is_train(mark: u8) -> bool {
    mark == Set::Train as u8
}

fn wanted(marks: &SplitBits, is_wanted: impl Fn(u8) -> bool) -> impl Iterator<Item = u32> {
    marks.scenes().filter(move |scene| marks.has(*scene, &is_wanted))
}

/// The training samples of a scene.
fn training(marks: &[SplitBits], scene: u32) -> Vec<u32> {
    let own = marks[shard_of(marks, scene)].of_scene(scene).filter(|(_, mark)| is_train(*mark));
    own.map(|(attempt, _)| attempt).collect()
}

/// The order in which an epoch reads scenes.
#[must_use]
pub fn epoch_order(marks: &[SplitBits], config: &Config, epoch: u32) -> SceneOrder {
    if is_small(marks, &config.training) {
        SceneOrder::ascending(marks, is_train)
    } else {
        SceneOrder::shuffled(marks, config.seed, epoch)
    }
}

/// Whether all scenes stay in memory.
pub(crate) fn is_small(marks: &[SplitBits], params: &TrainingParams) -> bool {
    marks.last().is_none_or(|last| last.scenes().end as usize <= params.shuffle_scenes)
}

/// The batches of an epoch. Each scene's samples are shuffled and cut into groups of `samples_per_scene`; then the
/// groups are shuffled. With 1 this is a plain shuffle of all samples.
pub fn epoch_steps<'a>(
    marks: &'a [SplitBits],
    order: &'a SceneOrder,
    config: &Config,
    epoch: u32,
) -> impl Iterator<Item = Step> + Send + use<'a> {
    let batch = config.training.batch;
    let groups: Box<dyn Iterator<Item = Group> + Send + 'a> = if is_small(marks, &config.training) {
        Box::new(full_shuffle(marks, order, config, epoch).into_iter())
    } else {
        Box::new(windowed(marks, order, config, epoch))
    };
    let mut samples = groups.flat_map(|Group { done, scene, attempts, .. }| {
        attempts.into_iter().map(move |attempt| (done, (scene, attempt)))
    });
    from_fn(move || {
        let mut step = Step { set: 0, samples: Vec::with_capacity(batch), done: 0 };
        for (done, sample) in samples.by_ref().take(batch) {
            step.done = done;
            step.samples.push(sample);
        }
        (!step.samples.is_empty()).then_some(step)
    })
}

/// Samples of a scene that are visited one after another.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Group {
    /// The first so many scenes have no later group.
    done: usize,
    scene: u32,
    attempts: Vec<u32>,
}

fn full_shuffle(marks: &[SplitBits], order: &SceneOrder, config: &Config, epoch: u32) -> Vec<Group> {
    let mut stream = Stream::new(config.seed, epoch.into(), Purpose::Shuffle, 0);
    let mut groups = Vec::new();
    for scene in &order.scenes {
        let mut own = training(marks, *scene);
        stream.shuffle(&mut own);
        let group = |own: &[u32]| Group { done: 0, scene: *scene, attempts: own.to_vec() };
        groups.extend(own.chunks(config.training.samples_per_scene).map(group));
    }
    stream.shuffle(&mut groups);
    groups
}

/// Times are counted in parts of the step from one scene to the next.
const TIMES: u64 = 1 << 16;

fn windowed<'a>(
    marks: &'a [SplitBits],
    order: &'a SceneOrder,
    config: &Config,
    epoch: u32,
) -> impl Iterator<Item = Group> + use<'a> {
    let Config { seed, training: TrainingParams { samples_per_scene, shuffle_scenes: window, .. }, .. } = *config;
    let mut open = BinaryHeap::<Reverse<(u64, u32, Vec<u32>)>>::new();
    let mut scenes = (0_u64..).map(|place| place * TIMES).zip(&order.scenes).peekable();
    from_fn(move || {
        loop {
            // A scene's groups come after its own time, so those before the next scene's are complete.
            let next = scenes.peek().map(|(time, _)| *time);
            if next.is_none_or(|next| open.peek().is_some_and(|Reverse((time, ..))| *time < next)) {
                let Reverse((time, scene, attempts)) = open.pop()?;
                let done = ((time / TIMES) as usize + 1).saturating_sub(window);
                return Some(Group { done, scene, attempts });
            }
            let (time, scene) = scenes.next()?;
            let mut stream = Stream::new(seed, (*scene).into(), Purpose::Visits, epoch);
            let mut own = training(marks, *scene);
            stream.shuffle(&mut own);
            for own in own.chunks(samples_per_scene) {
                let wait = stream.index(window * TIMES as usize) as u64;
                open.push(Reverse((time + wait, *scene, own.to_vec())));
            }
        }
    })
}

/// Batches of the samples of ascending scenes, in their order. `set_of` names the set of a mark, below 2; a batch has
/// samples of one set.
pub fn steps_in_order(
    marks: &[SplitBits],
    order: &SceneOrder,
    batch: usize,
    set_of: impl Fn(u8) -> Option<usize> + Copy + Send,
) -> impl Iterator<Item = Step> + Send {
    let mut samples = order.scenes.iter().enumerate().flat_map(move |(place, scene)| {
        let own = marks[shard_of(marks, *scene)].of_scene(*scene);
        own.filter_map(move |(attempt, mark)| Some((set_of(mark)?, place, (*scene, attempt))))
    });
    let mut pending: [Vec<(usize, (u32, u32))>; 2] = [Vec::new(), Vec::new()];
    from_fn(move || {
        let (set, next) = loop {
            match samples.next() {
                Some((set, place, sample)) => {
                    pending[set].push((place, sample));
                    if pending[set].len() == batch {
                        break (set, place);
                    }
                }
                None => break (pending.iter().position(|set| !set.is_empty())?, order.scenes.len()),
            }
        };
        let own = std::mem::take(&mut pending[set]);
        let first_pending = pending.iter().filter_map(|set| set.first()).map(|(place, _)| *place).min();
        let done = first_pending.unwrap_or(next).min(next);
        Some(Step { set, samples: own.into_iter().map(|(_, sample)| sample).collect(), done })
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::path::Path;

    use super::*;
    use crate::config::PAPER;

    /// Shards of 10 scenes of 20 attempts, of which every fifth trains.
    fn marks(shards: u32) -> Vec<SplitBits> {
        let shard = |shard: u32| {
            let mut marks = SplitBits::new(10 * shard..10 * shard + 10, 20, 200);
            for scene in marks.scenes() {
                (0..20).for_each(|attempt| {
                    marks.set(scene, attempt, if attempt % 5 == 1 { 0 } else { 1 + u8::from(attempt % 5 == 2) });
                });
            }
            marks
        };
        (0..shards).map(shard).collect()
    }

    fn config(samples_per_scene: usize, shuffle_scenes: usize) -> Config {
        let mut config = Config::parse(PAPER, Path::new("paper.toml")).unwrap();
        config.training = TrainingParams { samples_per_scene, shuffle_scenes, batch: 48, ..config.training };
        config
    }

    fn steps(marks: &[SplitBits], config: &Config, epoch: u32) -> (SceneOrder, Vec<Step>) {
        let order = epoch_order(marks, config, epoch);
        let steps = epoch_steps(marks, &order, config, epoch).collect();
        (order, steps)
    }

    fn samples(steps: &[Step]) -> Vec<(u32, u32)> {
        steps.iter().flat_map(|step| step.samples.clone()).collect()
    }

    #[test]
    fn every_sample_comes_once_and_every_epoch_otherwise() {
        let marks = marks(30);
        let all: Vec<(u32, u32)> =
            (0..300).flat_map(|scene| training(&marks, scene).into_iter().map(move |a| (scene, a))).collect();
        assert_eq!(all.len(), 300 * 12);
        for (samples_per_scene, window) in [(1, 1000), (7, 300), (1, 299), (7, 40), (4, 1)] {
            let config = config(samples_per_scene, window);
            let first = samples(&steps(&marks, &config, 0).1);
            assert_eq!(first, samples(&steps(&marks, &config, 0).1));
            assert_ne!(first, samples(&steps(&marks, &config, 1).1));
            let mut sorted = first.clone();
            sorted.sort_unstable();
            assert_eq!(sorted, all);
            let groups: Vec<_> = first.chunk_by(|a, b| a.0 == b.0).collect();
            assert!(groups.iter().filter(|group| group.len() < samples_per_scene.min(5)).count() <= 300);
        }
    }

    #[test]
    fn a_small_epoch_is_in_the_order_of_earlier_versions() {
        let marks = marks(3);
        let config = config(5, 30);
        let mut stream = Stream::new(config.seed, 2, Purpose::Shuffle, 0);
        let mut all: Vec<(u32, u32)> =
            (0..30).flat_map(|scene| training(&marks, scene).into_iter().map(move |a| (scene, a))).collect();
        let mut groups: Vec<&[(u32, u32)]> = Vec::new();
        for scene in all.chunk_by_mut(|a, b| a.0 == b.0) {
            stream.shuffle(scene);
            groups.extend(scene.chunks(5));
        }
        stream.shuffle(&mut groups);
        assert_eq!(samples(&steps(&marks, &config, 2).1), groups.concat());
    }

    /// Between its first and its last batch a scene is in memory: never more of them than the window, and most of the
    /// time nearly as many.
    #[test]
    fn a_window_is_in_memory() {
        let marks = marks(30);
        let (order, steps) = steps(&marks, &config(3, 40), 1);
        let place = |scene: u32| order.scenes.iter().position(|own| *own == scene).unwrap();
        let (mut done, mut reached, mut widest) = (0, 0, 0);
        for step in &steps {
            let places: BTreeSet<usize> = step.samples.iter().map(|(scene, _)| place(*scene)).collect();
            assert!(*places.first().unwrap() >= done, "{places:?} {done}");
            reached = reached.max(places.last().unwrap() + 1);
            widest = widest.max(reached - done);
            assert!(step.done >= done);
            done = step.done;
            assert!(reached - done <= 40, "{reached} {done}");
        }
        assert!(widest >= 38 && reached == 300, "{widest} {reached}");
        // The first scenes are of so many shards.
        let shards: BTreeSet<u32> = order.scenes[..LANES].iter().map(|scene| scene / 10).collect();
        assert_eq!(shards.len(), LANES);
        let of_one: Vec<usize> = (0..10).map(place).collect();
        assert!(of_one.is_sorted(), "{of_one:?}");
    }

    #[test]
    fn sets_are_visited_in_order_and_their_scenes_are_left_behind() {
        let marks = marks(5);
        let set_of = |mark: u8| (mark > 0).then(|| usize::from(mark) - 1);
        let order = SceneOrder::ascending(&marks, |mark| set_of(mark).is_some());
        let steps: Vec<Step> = steps_in_order(&marks, &order, 64, set_of).collect();
        let mut done = 0;
        for step in &steps {
            assert!(step.samples.iter().all(|(scene, _)| *scene as usize >= done));
            assert!(step.done >= done && step.samples.len() <= 64);
            done = step.done;
        }
        assert_eq!(done, 50);
        for (set, count) in [(0, 12), (1, 4)] {
            let own: Vec<_> = steps.iter().filter(|step| step.set == set).cloned().collect();
            assert!(own[..own.len() - 1].iter().all(|step| step.samples.len() == 64));
            assert!(samples(&own).is_sorted() && samples(&own).len() == 50 * count);
        }
    }
}
