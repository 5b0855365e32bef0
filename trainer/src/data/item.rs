//! The samples as a `burn-dataset`, and batches of them.

use core::ops::RangeInclusive;
use std::io;

use burn_dataset::Dataset;
use schema::{Outcome, Pose, Purpose, Quat, Rule, Stream};

use super::grids::Grids;
use crate::augmentation::{Augmentation, Motion};
use crate::batch::{Batch, Hand, Sample};
use crate::loss::{ClassWeights, Target};

/// The changes to samples in training; there are none in testing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrainingTransform {
    /// The run's seed.
    pub seed: u64,
    /// The epoch, from 0.
    pub epoch: u32,
    /// Rotations and shifts of scenes.
    pub augmentation: Augmentation,
    /// Weights of successes and failures.
    pub weights: ClassWeights,
}

/// A sample without its grid, 40 bytes, held in memory for every attempt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Record {
    /// The scene.
    pub scene: u32,
    /// The attempt within its scene that represents the sample.
    pub attempt: u32,
    /// The voxel that holds the grasp's origin.
    pub voxel: [u8; 3],
    /// The rule that drew the attempt: target shape and approach axis.
    pub rule: Rule,
    /// 1 if the attempt held its object, else 0.
    pub label: u8,
    /// Quaternion xyzw.
    pub rotation: [f32; 4],
    /// Opening width in voxels; 0 unless held.
    pub width_voxels: f32,
}

/// What a judge is asked about a sample, and how the attempt ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandRecord {
    /// The grasp.
    pub workspace_from_grasp: Pose,
    /// Number of views of the scene.
    pub views: u8,
    /// How the attempt ended.
    pub outcome: Outcome,
    /// Whether the hand hits the table on its way.
    pub hits_table: bool,
}

/// All samples of a dataset, by scene and attempt. For the paper's network those whose grasp is inside the grid: one
/// per attempt by a rule, one per point of VGN's sampler. For a judge every attempt.
#[derive(Debug)]
pub struct GraspDataset {
    pub(super) records: Vec<Record>,
    /// For each record its hand; none for the paper's network.
    pub(super) hands: Vec<HandRecord>,
    pub(super) grids: Grids,
    /// Number of attempts without a sample, because their grasp's origin is outside the grid.
    pub outside: u64,
}

impl GraspDataset {
    /// A sample without its grid.
    #[must_use]
    pub fn record(&self, sample: usize) -> &Record {
        &self.records[sample]
    }

    /// What a judge is asked about a sample; `None` for the paper's network.
    #[must_use]
    pub fn hand(&self, sample: usize) -> Option<&HandRecord> {
        self.hands.get(sample)
    }

    /// Scene and attempt of every sample, ascending.
    #[must_use]
    pub fn ids(&self) -> Vec<(u64, u32)> {
        self.records.iter().map(|record| (u64::from(record.scene), record.attempt)).collect()
    }

    /// A batch of samples, sorted so that those of a scene share its grid.
    ///
    /// # Errors
    /// If a grid cannot be read.
    pub fn batch(&self, samples: &[usize]) -> io::Result<Batch> {
        let mut sorted = samples.to_vec();
        sorted.sort_unstable();
        let mut batch = Batch::default();
        let mut last = None;
        for sample in sorted {
            let record = &self.records[sample];
            if last != Some(record.scene) {
                batch.grids.push(self.grids.read(record.scene as usize)?);
                last = Some(record.scene);
            }
            batch.samples.push(Sample {
                grid: batch.grids.len() - 1,
                voxel: record.voxel.map(usize::from),
                target: record.target(),
            });
            batch.hands.extend(self.hands.get(sample).map(HandRecord::hand));
        }
        Ok(batch)
    }

    /// A batch of training samples: a pure function of the samples and the transform.
    ///
    /// # Errors
    /// As [`Self::batch`].
    pub fn training_batch(&self, samples: &[usize], transform: &TrainingTransform) -> io::Result<Batch> {
        let TrainingTransform { seed, epoch, augmentation, weights } = *transform;
        let mut batch = self.batch(samples)?;
        for sample in &mut batch.samples {
            sample.target.quality_weight = weights.of(sample.target.label);
        }
        if !batch.hands.is_empty() {
            let mut sorted = samples.to_vec();
            sorted.sort_unstable();
            for (hand, sample) in batch.hands.iter_mut().zip(sorted) {
                let mut draw = Stream::new(seed, sample as u64, Purpose::Mirror, epoch);
                hand.mirrored = [(); 2].map(|()| draw.unit() < 0.5);
            }
        }
        if augmentation != Augmentation::OFF {
            let mut scenes: Vec<u32> = samples.iter().map(|sample| self.records[*sample].scene).collect();
            scenes.sort_unstable();
            scenes.dedup(); // in the order of the batch's grids
            let draw = |scene: &u32| augmentation.draw(seed, epoch, u64::from(*scene), self.heights(*scene));
            let motions: Vec<Motion> = scenes.iter().map(draw).collect();
            for (grid, motion) in batch.grids.iter_mut().zip(&motions) {
                *grid = motion.grid(grid);
            }
            for sample in &mut batch.samples {
                let motion = motions[sample.grid];
                sample.voxel = motion.voxel(sample.voxel);
                sample.target.rotation = motion.rotation(sample.target.rotation);
            }
        }
        Ok(batch)
    }

    /// The range of heights of a scene's samples, in voxels.
    fn heights(&self, scene: u32) -> RangeInclusive<usize> {
        let start = self.records.partition_point(|record| record.scene < scene);
        let own = self.records[start..].iter().take_while(|record| record.scene == scene);
        let (low, high) =
            own.fold((u8::MAX, 0), |(low, high), record| (low.min(record.voxel[2]), high.max(record.voxel[2])));
        usize::from(low)..=usize::from(high)
    }
}

impl HandRecord {
    fn hand(&self) -> Hand {
        let Self { workspace_from_grasp, views, outcome, hits_table } = *self;
        Hand { workspace_from_grasp, views: views.into(), mirrored: [false; 2], outcome, hits_table }
    }
}

impl Record {
    fn target(&self) -> Target {
        Target {
            label: self.label,
            rotation: Quat::from_array(self.rotation),
            width_voxels: self.width_voxels,
            quality_weight: 1.0,
        }
    }
}

/// An item is a batch of one sample.
impl Dataset<Batch, io::Error> for GraspDataset {
    fn get(&self, index: usize) -> io::Result<Batch> {
        self.batch(&[index])
    }

    fn len(&self) -> usize {
        self.records.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dataset(folder: &std::path::Path) -> GraspDataset {
        let grids = Grids::create(folder, 3).unwrap();
        let mut records = Vec::new();
        for scene in 0..3_u32 {
            let values: Vec<f32> = (0..64_000).map(|at| (at + scene) as f32 / 64_000.0).collect();
            grids.write(scene as usize, &values).unwrap();
            records.extend((0..4_u32).map(|attempt| Record {
                scene,
                attempt,
                voxel: [3, 30, 8 + 3 * attempt as u8],
                rule: schema::Rule::of_the_paper()[0],
                label: u8::from(attempt == 0),
                rotation: [0.0, 0.6, 0.0, 0.8],
                width_voxels: 5.0,
            }));
        }
        GraspDataset { records, hands: Vec::new(), grids, outside: 0 }
    }

    #[test]
    fn without_augmentation_and_weights_training_sees_the_dataset() {
        let folder = tempfile::tempdir().unwrap();
        let dataset = dataset(folder.path());
        let off =
            TrainingTransform { seed: 1, epoch: 2, augmentation: Augmentation::OFF, weights: ClassWeights::EQUAL };
        let (plain, treated) = (dataset.batch(&[7, 2, 5]).unwrap(), dataset.training_batch(&[7, 2, 5], &off).unwrap());
        assert_eq!((&plain.grids, &plain.samples), (&treated.grids, &treated.samples));
    }

    #[test]
    fn a_scenes_samples_move_with_its_grid_whatever_batch_they_are_in() {
        let folder = tempfile::tempdir().unwrap();
        let dataset = dataset(folder.path());
        let augmentation = Augmentation { quarter_turns: true, shift_z_voxels_max: 30 };
        let weights = ClassWeights::new(3.0, 3, 12);
        let mut moved = 0;
        for epoch in 0..20 {
            let transform = TrainingTransform { seed: 1, epoch, augmentation, weights };
            let all = dataset.training_batch(&(0..12).collect::<Vec<_>>(), &transform).unwrap();
            for number in 0..12 {
                let [alone, plain] =
                    [dataset.training_batch(&[number], &transform).unwrap(), dataset.batch(&[number]).unwrap()];
                let (one, was) = (alone.samples[0], plain.samples[0]);
                assert_eq!(one, Sample { grid: 0, ..all.samples[number] });
                assert_eq!(alone.grids[0], all.grids[all.samples[number].grid]);
                assert_eq!(one.target.quality_weight, weights.of(was.target.label));
                let value = |batch: &Batch, [i, j, k]: [usize; 3]| batch.grids[0][(i * 40 + j) * 40 + k];
                assert_eq!(value(&alone, one.voxel), value(&plain, was.voxel));
                moved += usize::from(one.voxel != was.voxel);
            }
        }
        assert!(moved > 200, "{moved}");
    }
}
