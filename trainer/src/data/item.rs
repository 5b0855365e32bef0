//! Scenes with their samples, and batches of them.

use core::ops::RangeInclusive;
use std::collections::BTreeMap;
use std::sync::Arc;

use schema::{Outcome, Pose, Purpose, Quat, Rule, Stream};

use crate::augmentation::Augmentation;
use crate::batch::{Batch, Hand, Sample};
use crate::loss::{ClassWeights, Closings, Target};

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
    /// Whether every closing counts by which the object can be gripped, or that of the attempt alone, as in tests.
    pub any_closing: bool,
}

/// A sample without its grid.
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
    /// Which turns of it grip the object as well.
    pub closings: Closings,
    /// Opening width in voxels; 0 unless held.
    pub width_voxels: f32,
}

/// What a judge is asked about a sample, and how the attempt ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandRecord {
    /// Which of the hands it is.
    pub crop: u16,
    /// The grasp.
    pub workspace_from_grasp: Pose,
    /// Number of views of the scene.
    pub views: u8,
    /// How the attempt ended.
    pub outcome: Outcome,
    /// Whether the hand hits the table on its way.
    pub hits_table: bool,
}

/// A scene: its grid and all of its samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Its number among the scenes of all datasets.
    pub number: u32,
    /// The number of its first attempt among the attempts of all datasets.
    pub first_attempt: u64,
    /// TSDF, 40³ values, x slowest.
    pub grid: Arc<[f32]>,
    /// Its samples by attempt. For the paper's network those whose grasp is inside the grid: one per attempt by a
    /// rule, one per point of VGN's sampler. For a judge every attempt.
    pub records: Vec<Record>,
    /// For each record its hand; none for the paper's network.
    pub hands: Vec<HandRecord>,
}

impl Scene {
    /// The range of heights of its samples, in voxels.
    fn heights(&self) -> RangeInclusive<usize> {
        let fold = |(low, high): (u8, u8), record: &Record| (low.min(record.voxel[2]), high.max(record.voxel[2]));
        let (low, high) = self.records.iter().fold((u8::MAX, 0), fold);
        usize::from(low)..=usize::from(high)
    }
}

/// A batch of samples, given by scene and attempt and sorted so that those of a scene share its grid. A batch of
/// training samples is a pure function of the samples and the transform.
///
/// # Panics
/// If there is no such scene or sample.
#[must_use]
pub fn batch(
    scenes: &BTreeMap<u32, Arc<Scene>>,
    mut samples: Vec<(u32, u32)>,
    transform: Option<&TrainingTransform>,
) -> Batch {
    samples.sort_unstable();
    let mut batch = Batch::default();
    for own in samples.chunk_by(|a, b| a.0 == b.0) {
        let scene = &scenes[&own[0].0];
        let off = |transform: &&TrainingTransform| transform.augmentation != Augmentation::OFF;
        let motion = transform.filter(off).map(|TrainingTransform { seed, epoch, augmentation, .. }| {
            augmentation.draw(*seed, *epoch, scene.number.into(), scene.heights())
        });
        batch.grids.push(motion.map_or_else(|| scene.grid.clone(), |motion| motion.grid(&scene.grid)));
        for (_, attempt) in own {
            let at = scene.records.partition_point(|record| record.attempt < *attempt);
            let record = scene.records[at];
            let mut sample =
                Sample { grid: batch.grids.len() - 1, voxel: record.voxel.map(usize::from), target: record.target() };
            let mut hand = scene.hands.get(at).map(HandRecord::hand);
            if let Some(TrainingTransform { seed, epoch, weights, any_closing, .. }) = transform {
                if *any_closing {
                    sample.target.closings = record.closings;
                }
                sample.target.quality_weight = weights.of(sample.target.label);
                if let Some(hand) = &mut hand {
                    let number = scene.first_attempt + u64::from(*attempt);
                    let mut draw = Stream::new(*seed, number, Purpose::Mirror, *epoch);
                    hand.mirrored = [(); 2].map(|()| draw.unit() < 0.5);
                }
            }
            if let Some(motion) = motion {
                sample.voxel = motion.voxel(sample.voxel);
                sample.target.rotation = motion.rotation(sample.target.rotation);
            }
            batch.records.push(record);
            batch.samples.push(sample);
            batch.hands.extend(hand);
        }
    }
    batch
}

impl HandRecord {
    fn hand(&self) -> Hand {
        let Self { crop, workspace_from_grasp, views, outcome, hits_table } = *self;
        Hand { crop: crop.into(), workspace_from_grasp, views: views.into(), mirrored: [false; 2], outcome, hits_table }
    }
}

impl Record {
    fn target(&self) -> Target {
        Target {
            label: self.label,
            rotation: Quat::from_array(self.rotation),
            closings: Closings::Half,
            width_voxels: self.width_voxels,
            quality_weight: 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scenes() -> BTreeMap<u32, Arc<Scene>> {
        let scene = |number: u32| {
            let records = (0..4_u32).map(|attempt| Record {
                scene: number,
                attempt,
                voxel: [3, 30, 8 + 3 * attempt as u8],
                rule: schema::Rule::of_the_paper()[0],
                label: u8::from(attempt == 0),
                rotation: [0.0, 0.6, 0.0, 0.8],
                closings: Closings::Half,
                width_voxels: 5.0,
            });
            Scene {
                number,
                first_attempt: 4 * u64::from(number),
                grid: (0..64_000).map(|at| (at + number) as f32 / 64_000.0).collect(),
                records: records.collect(),
                hands: Vec::new(),
            }
        };
        (0..3).map(|number| (number, Arc::new(scene(number)))).collect()
    }

    fn sample(number: u32) -> (u32, u32) {
        (number / 4, number % 4)
    }

    #[test]
    fn without_augmentation_and_weights_training_sees_the_dataset() {
        let (scenes, samples) = (scenes(), [7, 2, 5].map(sample).to_vec());
        let off = TrainingTransform {
            seed: 1,
            epoch: 2,
            augmentation: Augmentation::OFF,
            weights: ClassWeights::EQUAL,
            any_closing: false,
        };
        let (plain, treated) = (batch(&scenes, samples.clone(), None), batch(&scenes, samples, Some(&off)));
        assert_eq!((&plain.grids, &plain.samples), (&treated.grids, &treated.samples));
        assert_eq!(
            plain.records.iter().map(|record| (record.scene, record.attempt)).collect::<Vec<_>>(),
            [2, 5, 7].map(sample)
        );
    }

    #[test]
    fn a_scenes_samples_move_with_its_grid_whatever_batch_they_are_in() {
        let scenes = scenes();
        let augmentation = Augmentation { quarter_turns: true, shift_z_voxels_max: 30 };
        let weights = ClassWeights::new(3.0, 3, 12);
        let mut moved = 0;
        for epoch in 0..20 {
            let transform = TrainingTransform { seed: 1, epoch, augmentation, weights, any_closing: true };
            let all = batch(&scenes, (0..12).map(sample).collect(), Some(&transform));
            for number in 0..12 {
                let [alone, plain] =
                    [Some(&transform), None].map(|transform| batch(&scenes, vec![sample(number)], transform));
                let (one, was) = (alone.samples[0], plain.samples[0]);
                let same = all.samples[number as usize];
                assert_eq!(one, Sample { grid: 0, ..same });
                assert_eq!(alone.grids[0], all.grids[same.grid]);
                assert_eq!(one.target.quality_weight, weights.of(was.target.label));
                let value = |batch: &Batch, [i, j, k]: [usize; 3]| batch.grids[0][(i * 40 + j) * 40 + k];
                assert_eq!(value(&alone, one.voxel), value(&plain, was.voxel));
                moved += usize::from(one.voxel != was.voxel);
            }
        }
        assert!(moved > 200, "{moved}");
    }
}
