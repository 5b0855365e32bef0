//! From shards to samples.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use network::receptive_field::RESOLUTION;
use program::{ExitCode, Failure};
use rayon::prelude::*;
use schema::{AttemptRecord, SceneRows};
use shards::Dataset;

use super::split_bits::{SplitBits, shard_of};
use crate::batch::{SampleId, Scene, Scenes};
use crate::method::Method;

/// The samples of some datasets, whose scenes are numbered on. In memory are two bits for each attempt, and the scenes
/// themselves only if they are few ([`Self::keep`]).
#[derive(Debug)]
pub struct GraspDataset<'a, M: Method> {
    shards: Vec<Shard<'a>>,
    /// For which the samples are.
    pub method: M,
    /// For each shard the marks of its attempts.
    pub marks: Vec<SplitBits>,
    /// Number of attempts without a sample, because their grasp's origin is outside the grid.
    pub outside: u64,
    /// Every scene by its number, or none.
    pub(super) kept: Scenes<M::Data>,
}

impl<'a, M: Method> GraspDataset<'a, M> {
    /// Reads every attempt, but no grid, and marks how it ended. Shards are read in parallel. Files are checked against
    /// the manifest's checksums. `scene_done` is called once per scene, from any thread.
    ///
    /// # Errors
    /// If a dataset cannot be read or trained on, or `stop` is set.
    pub fn survey(
        datasets: &'a [Dataset],
        method: M,
        stop: &AtomicBool,
        scene_done: &(dyn Fn() + Sync),
    ) -> Result<Self, Failure> {
        let shards = Shard::all::<M>(datasets)?;
        let survey = |shard: &Shard<'_>| shard.survey(&method, stop, scene_done);
        let (marks, outside): (_, Vec<u64>) =
            shards.par_iter().map(survey).collect::<Result<Vec<_>, _>>()?.into_iter().unzip();
        Ok(Self { shards, method, marks, outside: outside.iter().sum(), kept: BTreeMap::new() })
    }

    /// The place among all shards of the one that has a scene.
    pub(super) fn shard_of(&self, scene: u32) -> usize {
        shard_of(&self.marks, scene)
    }

    /// Reads some scenes of a shard, ascending.
    pub(super) fn read(
        &self,
        shard: usize,
        scenes: &[u32],
    ) -> Result<impl Iterator<Item = Result<Scene<M::Data>, Failure>>, Failure> {
        let (shard, method) = (&self.shards[shard], &self.method);
        let wanted = scenes.iter().map(|scene| u64::from(scene - shard.first_scene)).collect();
        let rows = shard.dataset.some_scenes(shard.shard, wanted)?;
        Ok(rows.map(move |rows| rows.map(|rows| shard.scene(rows, method))))
    }
}

/// An item is a scene with its samples, read alone.
impl<M: Method> burn_dataset::Dataset<Scene<M::Data>, Failure> for GraspDataset<'_, M> {
    fn get(&self, index: usize) -> Result<Scene<M::Data>, Failure> {
        let scene = index as u32; // below `len`
        let shard = &self.shards[self.shard_of(scene)];
        let rows = shard.dataset.read_scene(u64::from(scene - shard.first_scene))?;
        Ok(shard.scene(rows, &self.method))
    }

    fn len(&self) -> usize {
        self.marks.last().map_or(0, |last| last.scenes().end as usize)
    }
}

pub(super) fn stopped() -> Failure {
    Failure::new(ExitCode::TryAgain, "stopped by a signal while reading the dataset")
}

/// A shard of one of the datasets.
#[derive(Debug)]
pub struct Shard<'a> {
    pub(crate) dataset: &'a Dataset,
    shard: u32,
    /// The number that its dataset's first scene has among all.
    first_scene: u32,
    /// The same of its dataset's first attempt.
    first_attempt: u64,
    /// The same of its dataset's first gripper.
    pub(crate) first_gripper: usize,
}

impl<'a> Shard<'a> {
    /// All shards of some datasets.
    fn all<M: Method>(datasets: &'a [Dataset]) -> Result<Vec<Self>, Failure> {
        let (mut scenes, mut first_attempt, mut first_gripper) = (0_u64, 0, 0);
        let mut shards = Vec::new();
        for dataset in datasets {
            let info = dataset.info();
            if !M::takes(&info.grid) {
                let has = info.grid.resolution;
                let text = format!("the network takes grids of {RESOLUTION}^3 voxels, the dataset has {has}^3");
                return Err(Failure::new(ExitCode::Config, text));
            }
            let first_scene = scenes as u32; // checked below
            let shard = |shard| Self { dataset, shard, first_scene, first_attempt, first_gripper };
            shards.extend((0..info.shard_count).map(shard));
            first_gripper += info.grippers().len();
            scenes += info.scene_count;
            first_attempt += info.attempt_count;
            // Samples have four bytes for the number of their scene.
            if scenes > u64::from(u32::MAX) {
                let text = format!("at most {} scenes can be trained on, the data have {scenes}", u32::MAX);
                return Err(Failure::new(ExitCode::Config, text));
            }
        }
        Ok(shards)
    }

    /// Marks how its attempts ended, and counts those without a sample.
    fn survey<M: Method>(
        &self,
        method: &M,
        stop: &AtomicBool,
        scene_done: &(dyn Fn() + Sync),
    ) -> Result<(SplitBits, u64), Failure> {
        let info = self.dataset.info();
        let ids = info.scenes_of(self.shard);
        let attempts = ids.clone().map(|scene| info.attempts_of_scene(scene) as usize).sum();
        let scenes = self.first_scene + ids.start as u32..self.first_scene + ids.end as u32;
        let (mut marks, mut outside) = (SplitBits::new(scenes, info.attempts_per_scene as usize, attempts), 0);
        for attempts in self.dataset.attempts_by_scene(self.shard)? {
            if stop.load(Ordering::Relaxed) {
                return Err(stopped());
            }
            let (samples, own_outside) = method.samples(self, &attempts?, 0);
            outside += own_outside;
            for sample in samples {
                marks.set(sample.id.scene, sample.id.attempt, M::mark(&sample.data));
            }
            scene_done();
        }
        Ok((marks, outside))
    }

    fn scene<M: Method>(&self, SceneRows { scene, attempts, .. }: SceneRows, method: &M) -> Scene<M::Data> {
        Scene {
            number: self.first_scene + scene.scene_id as u32,
            first_attempt: self.first_attempt + scene.scene_id * u64::from(self.dataset.info().attempts_per_scene),
            grid: scene.tsdf.into(),
            samples: method.samples(self, &attempts, scene.views.len()).0,
        }
    }

    /// The attempt of a sample.
    pub(crate) fn id(&self, attempt: &AttemptRecord) -> SampleId {
        let scene = self.first_scene + attempt.scene_id as u32;
        SampleId { scene, attempt: attempt.attempt_id, rule: attempt.rule }
    }
}
