//! Samples, scenes and batches of them. What a sample is besides its attempt and its grid is its method's.

use std::collections::BTreeMap;
use std::sync::Arc;

use schema::Rule;

/// The attempt of which a sample is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SampleId {
    /// The scene.
    pub scene: u32,
    /// The attempt within its scene that represents the sample.
    pub attempt: u32,
    /// The rule that drew the attempt: target shape and approach axis.
    pub rule: Rule,
}

/// A sample for a method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<D> {
    /// The attempt.
    pub id: SampleId,
    /// Index of its grid in the batch; 0 in a scene.
    pub grid: usize,
    /// What the method asks, and the answer.
    pub data: D,
}

/// Samples in the order of their grids.
#[derive(Debug, Clone)]
pub struct Batch<D> {
    /// TSDFs, 40³ values each, x slowest.
    pub grids: Vec<Arc<[f32]>>,
    /// Samples, in ascending order of `grid`.
    pub samples: Vec<Sample<D>>,
}

/// A scene: its grid and all of its samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene<D> {
    /// Its number among the scenes of all datasets.
    pub number: u32,
    /// The number of its first attempt among the attempts of all datasets.
    pub first_attempt: u64,
    /// TSDF, 40³ values, x slowest.
    pub grid: Arc<[f32]>,
    /// Its samples by attempt.
    pub samples: Vec<Sample<D>>,
}

/// Scenes by their numbers.
pub type Scenes<D> = BTreeMap<u32, Arc<Scene<D>>>;
