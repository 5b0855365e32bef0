//! Random streams. Every draw comes from a stream that is named by the dataset's seed, the scene, the *purpose* of the
//! draw and the try, so adding a draw in one place never shifts another.
//!
//! The four numbers are laid side by side in ChaCha8's 32-byte key: two streams with different names have different
//! keys, with no hash between them that could collide. The transforms to uniform and normal variates are written out
//! here, because the bytes of a shard must not change when a distribution library does.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::{Quat, Vec3};

/// What a stream of random numbers is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Purpose {
    /// How many objects, which shapes, which sizes.
    Objects = 1,
    /// Where and how the objects are dropped.
    Drops = 2,
    /// Camera poses.
    Views = 3,
    /// Grasp candidates.
    Candidates = 4,
    /// Depth noise.
    DepthNoise = 5,
    /// Train/test split.
    Split = 6,
    /// Order of training samples, or with try 1 of shards (the scene slot carries the epoch).
    Shuffle = 7,
    /// Initial network weights.
    Weights = 8,
    /// Turns and shifts of training scenes (the try carries the epoch).
    Augmentation = 9,
    /// Which grasps of a training epoch are mirrored (the scene slot carries the sample, the try the epoch).
    Mirror = 10,
    /// Grasp candidates of a scene.
    Proposals = 11,
    /// Which scenes a bootstrap draws (the try carries the draw).
    Bootstrap = 12,
    /// Samples of points in the search for a plane.
    Plane = 13,
    /// The order of grasps that are ranked by chance.
    Ranking = 14,
    /// Objects of packed scenes (the first try: whether a scene is packed).
    Packed = 15,
    /// Grippers that are drawn (the scene slot carries the gripper's number).
    Grippers = 16,
    /// When the samples of a scene are visited in an epoch (the try carries the epoch).
    Visits = 17,
    /// Household objects of a catalogue (the scene slot carries the object's number, the try its kind).
    Household = 18,
    /// Which scenes have only objects that the gripper can span.
    Spanned = 20,
    /// What the objects of a scene lie in.
    Container = 21,
    /// Which scenes' attempts are repeated (slot 0), and how the repeats are moved (slot 1 + attempt).
    Robustness = 22,
    /// Grasps of an object alone (the scene slot carries the candidate; the try is 0 for where it is, 1 for how it is
    /// moved, 2 + n for its n-th two repeats), and drops of the object (try [`u32::MAX`]).
    Annotation = 23,
}

/// A reproducible stream of random numbers.
#[derive(Debug, Clone)]
pub struct Stream(ChaCha8Rng);

impl Stream {
    /// The stream for `purpose` in scene `scene` of the dataset with seed `seed`, at the `attempt`-th try.
    #[must_use]
    pub fn new(seed: u64, scene: u64, purpose: Purpose, attempt: u32) -> Self {
        let mut key = [0_u8; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8..16].copy_from_slice(&scene.to_le_bytes());
        key[16..20].copy_from_slice(&(purpose as u32).to_le_bytes());
        key[20..24].copy_from_slice(&attempt.to_le_bytes());
        key[24..].copy_from_slice(b"grspmill");
        Self(ChaCha8Rng::from_seed(key))
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// U(0, 1), never 1, with 53 random bits.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// U(low, high).
    pub fn uniform(&mut self, low: f32, high: f32) -> f32 {
        (f64::from(low) + (f64::from(high) - f64::from(low)) * self.unit()) as f32
    }

    /// Between `low` and `high`, both positive, uniform in its logarithm.
    pub fn log_uniform(&mut self, [low, high]: [f32; 2]) -> f32 {
        let [from, to] = [low, high].map(|end| libm::log(f64::from(end)));
        (libm::exp(from + (to - from) * self.unit()) as f32).clamp(low, high)
    }

    /// N(mean, std²) by the Box–Muller transform; two uniforms a draw, so that the count of draws is fixed.
    pub fn normal(&mut self, mean: f32, std: f32) -> f32 {
        let radius = (-2.0 * libm::log(1.0 - self.unit())).sqrt();
        let angle = core::f64::consts::TAU * self.unit();
        (f64::from(mean) + f64::from(std) * radius * libm::cos(angle)) as f32
    }

    /// A whole number in `0..count`, by Lemire's multiplication; the bias is below `count / 2^64`.
    ///
    /// # Panics
    /// If `count` is 0.
    pub fn index(&mut self, count: usize) -> usize {
        assert!(count > 0, "cannot choose among nothing");
        ((u128::from(self.bits()) * count as u128) >> 64) as usize
    }

    /// One of `items`, each as often as its weight says; the last one if all weights are 0.
    ///
    /// # Panics
    /// If there are no items.
    pub fn weighted<'a, T>(&mut self, items: &'a [T], weights: &[f32]) -> &'a T {
        let total: f64 = weights.iter().map(|weight| f64::from(*weight)).sum();
        let mut left = self.unit() * total;
        let chosen = items.iter().zip(weights).find(|(_, weight)| {
            left -= f64::from(**weight);
            left < 0.0
        });
        chosen.map_or(&items[items.len() - 1], |(item, _)| item)
    }

    /// A rotation, uniform over SO(3) (Shoemake, 1992).
    pub fn rotation(&mut self) -> Quat {
        let (u1, u2, u3) = (self.unit(), self.unit() * core::f64::consts::TAU, self.unit() * core::f64::consts::TAU);
        let (a, b) = ((1.0 - u1).sqrt(), u1.sqrt());
        Quat::from_xyzw(
            (a * libm::sin(u2)) as f32,
            (a * libm::cos(u2)) as f32,
            (b * libm::sin(u3)) as f32,
            (b * libm::cos(u3)) as f32,
        )
        .normalize()
    }

    /// A point, uniform in the box between `low` and `high`.
    pub fn point(&mut self, low: Vec3, high: Vec3) -> Vec3 {
        Vec3::new(self.uniform(low.x, high.x), self.uniform(low.y, high.y), self.uniform(low.z, high.z))
    }

    /// Shuffles `items` in place (Fisher–Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            let chosen = self.index(last + 1);
            items.swap(last, chosen);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moments(mut draw: impl FnMut() -> f64) -> (f64, f64) {
        let n = 40_000;
        let values: Vec<f64> = (0..n).map(|_| draw()).collect();
        let mean = values.iter().sum::<f64>() / f64::from(n);
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / f64::from(n);
        (mean, variance)
    }

    #[test]
    fn each_name_has_its_own_stream() {
        let first = |seed, scene, purpose, attempt| Stream::new(seed, scene, purpose, attempt).bits();
        let base = first(1, 2, Purpose::Objects, 3);
        assert_eq!(base, first(1, 2, Purpose::Objects, 3));
        for other in [
            first(2, 2, Purpose::Objects, 3),
            first(1, 3, Purpose::Objects, 3),
            first(1, 2, Purpose::Drops, 3),
            first(1, 2, Purpose::Objects, 4),
        ] {
            assert_ne!(base, other);
        }
    }

    #[test]
    fn seed_zero_is_a_seed_like_any_other() {
        let mut zero = Stream::new(0, 0, Purpose::Objects, 0);
        assert_ne!(zero.bits(), zero.bits());
    }

    #[test]
    fn normal_has_its_mean_and_variance() {
        let mut stream = Stream::new(7, 0, Purpose::Candidates, 0);
        let (mean, variance) = moments(|| f64::from(stream.normal(2.0, 3.0)));
        assert!((mean - 2.0).abs() < 0.06, "mean {mean}");
        assert!((variance - 9.0).abs() < 0.25, "variance {variance}");
    }

    #[test]
    fn uniform_has_its_mean_and_variance() {
        let mut stream = Stream::new(7, 0, Purpose::Candidates, 0);
        let (mean, variance) = moments(|| f64::from(stream.uniform(-1.0, 3.0)));
        assert!((mean - 1.0).abs() < 0.03, "mean {mean}");
        assert!((variance - 16.0 / 12.0).abs() < 0.04, "variance {variance}");
    }

    #[test]
    fn rotations_are_unit_and_point_everywhere() {
        let mut stream = Stream::new(7, 0, Purpose::Drops, 0);
        let mut sum = Vec3::ZERO;
        for _ in 0..20_000 {
            let rotation = stream.rotation();
            assert!((rotation.length() - 1.0).abs() < 1e-5);
            sum += rotation * Vec3::X;
        }
        assert!(sum.length() / 20_000.0 < 0.02, "mean direction {sum}");
    }

    #[test]
    fn index_reaches_every_value_evenly() {
        let mut stream = Stream::new(7, 0, Purpose::Objects, 0);
        let mut counts = [0_u32; 5];
        for _ in 0..10_000 {
            counts[stream.index(5)] += 1;
        }
        assert!(counts.iter().all(|c| (1_850..2_150).contains(c)), "{counts:?}");
    }
}
