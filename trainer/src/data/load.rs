//! From shards to samples.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use network::judge::Crop;
use network::receptive_field::RESOLUTION;
use program::{ExitCode, Failure};
use rayon::prelude::*;
use schema::{AttemptRecord, Grasp, Grid, Vec3};
use shards::Dataset;

use super::grids::Grids;
use super::item::{GraspDataset, HandRecord, Record};

/// How a network sees grasps.
#[derive(Debug, Clone, Copy)]
pub enum Seen<'a> {
    /// In voxels. `offset` is the place of a grasp in its voxel along each axis: 0.5, the centre, for our networks; 0,
    /// a corner, for VGN's weights, because VGN rounds positions to voxels.
    Voxels {
        /// The place.
        offset: f32,
    },
    /// As hands, by a judge.
    Hands(&'a Crop),
}

impl Seen<'_> {
    /// In the voxels of our networks.
    pub const OURS: Self = Self::Voxels { offset: 0.5 };
}

/// Reads every attempt and decodes every grid once to a file in `folder`. Shards are read in parallel; after a failed
/// shard no later ones are read. Files are checked against the manifest's checksums. `scene_done` is called once per
/// scene, from any thread. `seen` is how the network sees grasps. Scenes of several datasets are numbered on.
///
/// # Errors
/// If a dataset cannot be read or trained on, the grids cannot be stored, or `stop` is set; the first error in the
/// order of shards.
pub fn load(
    datasets: &[Dataset],
    folder: &Path,
    seen: Seen<'_>,
    stop: &AtomicBool,
    scene_done: &(dyn Fn() + Sync),
) -> Result<GraspDataset, Failure> {
    let mut scenes = 0_u64;
    let mut shards = Vec::new();
    for dataset in datasets {
        let info = dataset.info();
        if info.grid.resolution != RESOLUTION {
            let text =
                format!("the network takes grids of {RESOLUTION}^3 voxels, the dataset has {}^3", info.grid.resolution);
            return Err(Failure::new(ExitCode::Config, text));
        }
        shards.extend((0..info.shard_count).map(|shard| Shard { dataset, shard, first_scene: scenes as u32 }));
        scenes += info.scene_count;
        // Samples have four bytes for the number of their scene.
        if scenes > u64::from(u32::MAX) {
            let text = format!("at most {} scenes can be trained on, the data have {scenes}", u32::MAX);
            return Err(Failure::new(ExitCode::Config, text));
        }
    }
    let grids = Grids::create(folder, scenes as usize)?;
    let failed = AtomicUsize::new(usize::MAX); // the first shard that failed
    let read: Vec<Samples> = shards
        .par_iter()
        .enumerate()
        .map(|(number, shard)| {
            if failed.load(Ordering::Relaxed) < number {
                return Err(stopped()); // after the failure, so the result is not used
            }
            shard.load(&grids, seen, stop, scene_done).inspect_err(|_| {
                failed.fetch_min(number, Ordering::Relaxed);
            })
        })
        .collect::<Vec<Result<_, Failure>>>()
        .into_iter()
        .collect::<Result<_, _>>()?;
    let mut all = GraspDataset { records: Vec::new(), hands: Vec::new(), grids, outside: 0 };
    for Samples { records, hands, outside } in read {
        all.records.extend(records);
        all.hands.extend(hands);
        all.outside += outside;
    }
    Ok(all)
}

fn stopped() -> Failure {
    Failure::new(ExitCode::TryAgain, "stopped by a signal while reading the dataset")
}

/// The samples of a shard.
struct Samples {
    records: Vec<Record>,
    hands: Vec<HandRecord>,
    outside: u64,
}

/// A shard of one of the datasets.
struct Shard<'a> {
    dataset: &'a Dataset,
    shard: u32,
    /// The number that its dataset's first scene has among all.
    first_scene: u32,
}

impl Shard<'_> {
    /// Reads the samples and writes their grids to the file.
    fn load(
        &self,
        grids: &Grids,
        seen: Seen<'_>,
        stop: &AtomicBool,
        scene_done: &(dyn Fn() + Sync),
    ) -> Result<Samples, Failure> {
        if stop.load(Ordering::Relaxed) {
            return Err(stopped());
        }
        let Self { dataset, shard, first_scene } = *self;
        let mut views = BTreeMap::new();
        for scene in dataset.scenes(shard)? {
            let scene = scene?;
            views.insert(scene.scene_id, scene.views.len());
            grids.write(first_scene as usize + scene.scene_id as usize, &scene.tsdf)?;
            scene_done();
            if stop.load(Ordering::Relaxed) {
                return Err(stopped());
            }
        }
        let attempts = dataset.read_attempts(shard)?;
        let numbered = |record: Record| Record { scene: first_scene + record.scene, ..record };
        let voxel_offset = match seen {
            Seen::Voxels { offset } => offset,
            // A judge is asked about every hand, wherever its origin is.
            Seen::Hands(crop) => {
                let hand = |attempt: &AttemptRecord| HandRecord {
                    workspace_from_grasp: attempt.workspace_from_grasp,
                    views: views.get(&attempt.scene_id).copied().unwrap_or_default() as u8,
                    outcome: attempt.outcome,
                    hits_table: crop.hits_table(&attempt.workspace_from_grasp),
                };
                let hands = attempts.iter().map(hand).collect();
                let records = attempts.iter().map(|attempt| numbered(record(attempt, [0; 3], 0.0))).collect();
                return Ok(Samples { records, hands, outside: 0 });
            }
        };
        let samples = schema::samples_of(&attempts, &dataset.info().gripper);
        let inside = samples.iter().filter_map(|sample| at_voxel(sample, &dataset.info().grid, voxel_offset));
        let records: Vec<Record> = inside.map(numbered).collect();
        let outside = (samples.len() - records.len()) as u64;
        Ok(Samples { records, hands: Vec::new(), outside })
    }
}

/// The sample of an attempt, or `None` if its grasp's origin is outside the grid.
fn at_voxel(attempt: &AttemptRecord, grid: &Grid, offset: f32) -> Option<Record> {
    let mut workspace_from_grasp = attempt.workspace_from_grasp;
    workspace_from_grasp.translation += Vec3::splat((0.5 - offset) * grid.voxel_size_m());
    let grasp = Grasp {
        workspace_from_grasp,
        // Only a held object's width is a target.
        width_m: attempt.width_m.filter(|_| attempt.label() == 1).unwrap_or(0.0),
    };
    let voxels = grasp.to_voxels(grid)?;
    let index = voxels.index.map(|index| index as u8);
    Some(Record { rotation: voxels.rotation.to_array(), ..record(attempt, index, voxels.width_voxels) })
}

fn record(attempt: &AttemptRecord, voxel: [u8; 3], width_voxels: f32) -> Record {
    Record {
        scene: attempt.scene_id as u32,
        attempt: attempt.attempt_id,
        voxel,
        rule: attempt.rule,
        label: attempt.label(),
        rotation: attempt.workspace_from_grasp.rotation.to_array(),
        width_voxels,
    }
}
