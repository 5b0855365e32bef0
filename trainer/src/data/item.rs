//! The samples as a `burn-dataset`, and batches of them.

use std::sync::Arc;

use burn_dataset::Dataset;
use schema::{Quat, Rule};

use super::grids::{Grids, SpoolError};
use crate::batch::{Batch, Sample};
use crate::loss::Target;

/// A training sample with its grid.
#[derive(Debug, Clone)]
pub struct GraspItem {
    /// The scene's TSDF, 40³ values, x slowest.
    pub grid: Arc<[f32]>,
    /// The voxel that holds the grasp's origin.
    pub voxel: [usize; 3],
    /// What the attempt showed.
    pub target: Target,
}

/// A sample without its grid, 40 bytes: what is held in memory for every attempt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Record {
    pub(super) scene: u32,
    pub(super) attempt: u32,
    pub(super) voxel: [u8; 3],
    pub(super) rule: Rule,
    pub(super) label: u8,
    pub(super) rotation: [f32; 4],
    pub(super) width_voxels: f32,
}

/// All attempts of a dataset whose grasp lies in the grid, by scene and attempt.
#[derive(Debug)]
pub struct GraspDataset {
    pub(super) records: Vec<Record>,
    pub(super) grids: Grids,
    /// Attempts left out because their grasp's origin lies outside the grid.
    pub(super) outside: u64,
}

impl GraspDataset {
    /// Attempts that are no samples, for their grasp's origin lies outside the grid.
    #[must_use]
    pub fn outside_count(&self) -> u64 {
        self.outside
    }

    /// The scene of a sample.
    #[must_use]
    pub fn scene(&self, sample: usize) -> u64 {
        u64::from(self.records[sample].scene)
    }

    /// Scene and attempt of every sample, ascending.
    #[must_use]
    pub fn ids(&self) -> Vec<(u64, u32)> {
        self.records.iter().map(|record| (u64::from(record.scene), record.attempt)).collect()
    }

    /// The rule by which a sample's attempt was drawn: the shape that it was aimed at, and along which of its axes.
    #[must_use]
    pub fn rule(&self, sample: usize) -> Rule {
        self.records[sample].rule
    }

    /// 1 if the sample's attempt held its object, else 0.
    #[must_use]
    pub fn label(&self, sample: usize) -> u8 {
        self.records[sample].label
    }

    /// A batch of samples, sorted by sample so that those of a scene share its grid.
    ///
    /// # Errors
    /// [`SpoolError`] if a grid cannot be read.
    pub fn batch(&self, samples: &[usize]) -> Result<Batch, SpoolError> {
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
        }
        Ok(batch)
    }
}

impl Record {
    fn target(&self) -> Target {
        Target { label: self.label, rotation: Quat::from_array(self.rotation), width_voxels: self.width_voxels }
    }
}

impl Dataset<GraspItem, SpoolError> for GraspDataset {
    fn get(&self, index: usize) -> Result<GraspItem, SpoolError> {
        let record = &self.records[index];
        let grid = self.grids.read(record.scene as usize)?;
        Ok(GraspItem { grid, voxel: record.voxel.map(usize::from), target: record.target() })
    }

    fn len(&self) -> usize {
        self.records.len()
    }
}
