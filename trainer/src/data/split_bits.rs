//! Two bits for every attempt of a shard: 25 MB for 10⁸ attempts. First how it ended, then the set that it is in.

use core::ops::Range;

/// The sets of samples, as an attempt's mark after the split. An attempt that is in none is marked 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Set {
    /// Samples to train on.
    Train = 1,
    /// Held-out attempts of training scenes.
    TestAttempts = 2,
    /// All samples of held-out scenes.
    TestScenes = 3,
}

/// The mark of an attempt without a sample; before the split there are three others.
pub(crate) const NO_SAMPLE: u8 = 0;
pub(crate) const FAILED: u8 = 1;
pub(crate) const HELD: u8 = 2;
/// Failed, and there is nothing to learn of it, because the gripper hits the table.
pub(crate) const HITS_TABLE: u8 = 3;

/// The marks of a shard's attempts.
#[derive(Debug, Clone)]
pub struct SplitBits {
    scenes: Range<u32>,
    attempts_per_scene: usize,
    attempts: usize,
    /// Four attempts a byte.
    bits: Box<[u8]>,
}

impl SplitBits {
    /// Of scenes with so many attempts each; the last scene may have fewer.
    #[must_use]
    pub fn new(scenes: Range<u32>, attempts_per_scene: usize, attempts: usize) -> Self {
        Self { scenes, attempts_per_scene, attempts, bits: vec![0; attempts.div_ceil(4)].into() }
    }

    /// The scenes, numbered over all datasets.
    #[must_use]
    pub fn scenes(&self) -> Range<u32> {
        self.scenes.clone()
    }

    /// Attempts of a scene and their marks.
    pub fn of_scene(&self, scene: u32) -> impl Iterator<Item = (u32, u8)> + use<'_> {
        let start = self.place(scene, 0);
        let end = (start + self.attempts_per_scene).min(self.attempts);
        (0..).zip((start..end).map(|at| self.bits[at / 4] >> (2 * (at % 4)) & 3))
    }

    /// Whether an attempt of a scene has a mark of some.
    pub(crate) fn has(&self, scene: u32, is_wanted: impl Fn(u8) -> bool) -> bool {
        self.of_scene(scene).any(|(_, mark)| is_wanted(mark))
    }

    /// Marks an attempt.
    pub fn set(&mut self, scene: u32, attempt: u32, mark: u8) {
        let at = self.place(scene, attempt);
        let (byte, shift) = (&mut self.bits[at / 4], 2 * (at % 4));
        *byte = *byte & !(3 << shift) | mark << shift;
    }

    fn place(&self, scene: u32, attempt: u32) -> usize {
        (scene - self.scenes.start) as usize * self.attempts_per_scene + attempt as usize
    }
}

/// The place among all shards of the one that has a scene.
pub(crate) fn shard_of(marks: &[SplitBits], scene: u32) -> usize {
    marks.partition_point(|marks| marks.scenes.end <= scene)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_come_back_and_leave_others_alone() {
        let mut marks = SplitBits::new(7..10, 5, 13);
        let mark = |scene: u32, attempt: u32| ((scene * 3 + attempt) % 4) as u8;
        for _ in 0..2 {
            for scene in [9, 7, 8] {
                for attempt in 0..if scene == 9 { 3 } else { 5 } {
                    marks.set(scene, attempt, mark(scene, attempt));
                }
            }
        }
        for scene in 7..10 {
            let found: Vec<_> = marks.of_scene(scene).collect();
            assert_eq!(found.len(), if scene == 9 { 3 } else { 5 });
            assert!(found.iter().all(|(attempt, own)| *own == mark(scene, *attempt)), "{found:?}");
        }
    }
}
