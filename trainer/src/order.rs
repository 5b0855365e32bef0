//! The order of training samples in an epoch: a pure function of (seed, epoch).

use schema::{Purpose, Stream};

/// The training samples in the order in which an epoch visits them.
///
/// Each scene's samples are shuffled and cut into groups of `samples_per_scene`; then the groups are shuffled. With 1
/// this is a plain shuffle of all samples.
///
/// `scene_of` gives the scene of a sample; `samples` must be sorted by scene.
#[must_use]
pub fn epoch_order(
    samples: &[usize],
    scene_of: impl Fn(usize) -> u32,
    samples_per_scene: usize,
    seed: u64,
    epoch: u32,
) -> Vec<usize> {
    let mut stream = Stream::new(seed, u64::from(epoch), Purpose::Shuffle, 0);
    let mut shuffled = samples.to_vec();
    let mut groups: Vec<&[usize]> = Vec::new();
    for scene in shuffled.chunk_by_mut(|a, b| scene_of(*a) == scene_of(*b)) {
        stream.shuffle(scene);
        groups.extend(scene.chunks(samples_per_scene));
    }
    stream.shuffle(&mut groups);
    groups.concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(samples_per_scene: usize, epoch: u32) -> Vec<usize> {
        let samples: Vec<usize> = (0..600).collect();
        epoch_order(&samples, |sample| (sample / 60) as u32, samples_per_scene, 5, epoch)
    }

    #[test]
    fn every_sample_comes_once_and_every_epoch_otherwise() {
        for samples_per_scene in [1, 7] {
            let mut first = order(samples_per_scene, 0);
            assert_eq!(first, order(samples_per_scene, 0));
            assert_ne!(first, order(samples_per_scene, 1));
            first.sort_unstable();
            assert_eq!(first, (0..600).collect::<Vec<_>>());
        }
    }

    #[test]
    fn groups_stay_together() {
        let order = order(6, 2);
        for group in order.chunks(6) {
            assert!(group.iter().all(|sample| sample / 60 == group[0] / 60), "{group:?}");
        }
    }
}
