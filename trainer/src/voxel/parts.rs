//! A batch in parts, which different threads compute.

use std::iter::repeat_n;
use std::ops::Range;

use network::VoxelInputs;
use rayon::prelude::*;

use super::VoxelSample;
use super::loss::Target;
use crate::batch::Batch;

/// Some consecutive samples of a batch.
#[derive(Debug, Clone)]
pub struct BatchPart<'a> {
    /// Their grids, each once, and their voxels.
    pub inputs: VoxelInputs<'a>,
    /// For each sample its target.
    pub targets: Vec<Target>,
}

/// Maximum number of grids in a part of a batch. Parts run on different threads, so this limits memory. It does not
/// depend on the number of threads, so neither do results.
const PART_GRIDS_MAX: usize = 2;
/// Maximum number of samples in a part of a batch.
const PART_SAMPLES_MAX: usize = 12;

impl Batch<VoxelSample> {
    /// Cuts the batch into parts, as a pure function of the batch, and calls `work` with each of them, on any thread;
    /// results are in the order of parts. A scene's samples stay together if possible, so that its grid is encoded
    /// once.
    pub fn by_parts<T: Send>(&self, work: impl Fn(&BatchPart<'_>) -> T + Sync) -> Vec<T> {
        self.parts().into_par_iter().map(|part| work(&self.part(part))).collect()
    }

    fn parts(&self) -> Vec<Range<usize>> {
        let mut parts = Vec::new();
        let (mut start, mut grids) = (0, 0);
        for (at, sample) in self.samples.iter().enumerate() {
            let new_grid = at == start || self.samples[at - 1].grid != sample.grid;
            if at > start && (at - start == PART_SAMPLES_MAX || (new_grid && grids == PART_GRIDS_MAX)) {
                parts.push(start..at);
                (start, grids) = (at, 1);
            } else {
                grids += usize::from(new_grid);
            }
        }
        if start < self.samples.len() {
            parts.push(start..self.samples.len());
        }
        parts
    }

    /// Some consecutive samples, with their grids.
    fn part(&self, part: Range<usize>) -> BatchPart<'_> {
        let samples = &self.samples[part];
        let (mut grids, mut grid_of_sample) = (Vec::new(), Vec::new());
        for (number, own) in samples.chunk_by(|a, b| a.grid == b.grid).enumerate() {
            grids.push(&*self.grids[own[0].grid]);
            grid_of_sample.extend(repeat_n(number, own.len()));
        }
        let voxels = samples.iter().map(|sample| sample.data.voxel).collect();
        let targets = samples.iter().map(|sample| sample.data.target).collect();
        BatchPart { inputs: VoxelInputs { grids, grid_of_sample, voxels }, targets }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::voxel::tests::sample;
    use proptest::prelude::*;
    use schema::Quat;

    fn batch(grid_of_sample: &[usize]) -> Batch<VoxelSample> {
        let target = Target {
            tips_voxels: [0.0; 3],
            label: 0,
            rotation: Quat::IDENTITY,
            width_voxels: 0.0,
            quality_weight: 1.0,
        };
        let samples = grid_of_sample.iter().map(|grid| sample(*grid, [0; 3], target)).collect();
        let count = grid_of_sample.last().map_or(0, |last| last + 1);
        Batch { grids: (0..count).map(|grid| Arc::from([grid as f32])).collect(), samples }
    }

    proptest! {
        #[test]
        fn parts_tile_the_batch_within_their_limits(steps in prop::collection::vec(0_usize..2, 0..100)) {
            let grids: Vec<usize> = steps.iter().scan(0, |grid, step| { *grid += step; Some(*grid) }).collect();
            let batch = batch(&grids);
            let mut end = 0;
            for part in batch.parts() {
                prop_assert_eq!(part.start, end);
                prop_assert!(!part.is_empty() && part.len() <= PART_SAMPLES_MAX);
                let own = batch.part(part.clone()).inputs;
                prop_assert!(own.grids.len() <= PART_GRIDS_MAX);
                for (sample, number) in batch.samples[part.clone()].iter().zip(own.grid_of_sample) {
                    prop_assert_eq!(own.grids[number][0], sample.grid as f32);
                }
                end = part.end;
            }
            prop_assert_eq!(end, batch.samples.len());
        }
    }
}
