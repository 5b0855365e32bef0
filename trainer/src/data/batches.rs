//! Batches of samples.

use crate::batch::{Batch, Sample, Scenes};
use crate::method::{Epoch, Method};

/// A batch of samples, given by scene and attempt and sorted so that those of a scene share its grid. Training samples
/// are changed for an epoch; tests have none. A batch is a pure function of the samples, the method and the epoch.
///
/// # Panics
/// If there is no such scene or sample.
#[must_use]
pub fn batch<M: Method>(
    method: &M,
    scenes: &Scenes<M::Data>,
    mut wanted: Vec<(u32, u32)>,
    epoch: Option<&Epoch>,
) -> Batch<M::Data> {
    wanted.sort_unstable();
    let mut batch = Batch { grids: Vec::new(), samples: Vec::with_capacity(wanted.len()) };
    for own in wanted.chunk_by(|a, b| a.0 == b.0) {
        let (scene, start) = (&scenes[&own[0].0], batch.samples.len());
        batch.samples.extend(own.iter().map(|(_, attempt)| {
            let at = scene.samples.partition_point(|sample| sample.id.attempt < *attempt);
            Sample { grid: batch.grids.len(), ..scene.samples[at] }
        }));
        let changed = epoch.map(|epoch| method.change(epoch, scene, &mut batch.samples[start..]));
        batch.grids.push(changed.unwrap_or_else(|| scene.grid.clone()));
    }
    batch
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use network::VoxelParams;
    use network::upsampling::Upsampling;
    use schema::{Quat, Rule};

    use super::*;
    use crate::batch::{SampleId, Scene};
    use crate::device::Device;
    use crate::split::LabelCount;
    use crate::voxel::augmentation::Augmentation;
    use crate::voxel::loss::{ClassWeights, Target};
    use crate::voxel::{Voxel, VoxelSample};

    fn method() -> Voxel {
        let params = VoxelParams::at_tips(Upsampling::Linear);
        Voxel::new(params, Device::Host)
    }

    fn scenes() -> Scenes<VoxelSample> {
        let scene = |number: u32| {
            let samples = (0..4_u32).map(|attempt| Sample {
                id: SampleId { scene: number, attempt, rule: Rule::of_the_paper()[0] },
                grid: 0,
                data: VoxelSample {
                    voxel: [3, 30, 8 + 3 * attempt as usize],
                    target: Target {
                        tips_voxels: [0.0; 3],
                        label: u8::from(attempt == 0),
                        rotation: Quat::from_xyzw(0.0, 0.6, 0.0, 0.8),
                        width_voxels: 5.0,
                        quality_weight: 1.0,
                    },
                },
            });
            Scene {
                number,
                first_attempt: 4 * u64::from(number),
                grid: (0..64_000).map(|at| (at + number) as f32 / 64_000.0).collect(),
                samples: samples.collect(),
            }
        };
        (0..3).map(|number| (number, Arc::new(scene(number)))).collect()
    }

    fn epoch(number: u32) -> Epoch {
        Epoch { seed: 1, number, train: LabelCount { samples: 12, held: 3 } }
    }

    fn sample(number: u32) -> (u32, u32) {
        (number / 4, number % 4)
    }

    #[test]
    fn without_augmentation_and_weights_training_sees_the_dataset() {
        let (scenes, samples, off) = (scenes(), [7, 2, 5].map(sample).to_vec(), method());
        let [plain, treated] = [None, Some(&epoch(2))].map(|epoch| batch(&off, &scenes, samples.clone(), epoch));
        assert_eq!((&plain.grids, &plain.samples), (&treated.grids, &treated.samples));
        assert_eq!(
            plain.samples.iter().map(|sample| (sample.id.scene, sample.id.attempt)).collect::<Vec<_>>(),
            [2, 5, 7].map(sample)
        );
    }

    #[test]
    fn a_scenes_samples_move_with_its_grid_whatever_batch_they_are_in() {
        let scenes = scenes();
        let augmentation = Augmentation { quarter_turns: true, mirrors: true, shift_z_voxels_max: 30 };
        let weights = ClassWeights::new(3.0, 3, 12);
        let method = Voxel { augmentation, positive_weight: 3.0, ..method() };
        let mut moved = 0;
        for number in 0..20 {
            let epoch = epoch(number);
            let all = batch(&method, &scenes, (0..12).map(sample).collect(), Some(&epoch));
            for number in 0..12 {
                let [alone, plain] =
                    [Some(&epoch), None].map(|epoch| batch(&method, &scenes, vec![sample(number)], epoch));
                let (one, was) = (alone.samples[0], plain.samples[0].data);
                let same = all.samples[number as usize];
                assert_eq!(one, Sample { grid: 0, ..same });
                assert_eq!(alone.grids[0], all.grids[same.grid]);
                let one = one.data;
                assert_eq!(one.target.quality_weight, weights.of(was.target.label));
                let value = |batch: &Batch<VoxelSample>, [i, j, k]: [usize; 3]| batch.grids[0][(i * 40 + j) * 40 + k];
                assert_eq!(value(&alone, one.voxel), value(&plain, was.voxel));
                moved += usize::from(one.voxel != was.voxel);
            }
        }
        assert!(moved > 200, "{moved}");
    }
}
