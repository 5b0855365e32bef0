//! From shards to samples.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use program::{ExitCode, Failure};
use rayon::prelude::*;
use schema::{AttemptRecord, Grasp, Grid};
use shards::Dataset;

use super::grids::Grids;
use super::item::{GraspDataset, Record};
use network::receptive_field::RESOLUTION;

/// Reads every attempt and decodes every grid once to a file in `folder`. Shards are read in parallel; after a failed
/// shard no later ones are read. Files are checked against the manifest's checksums. `scene_done` is called once per
/// scene, from any thread.
///
/// # Errors
/// If the dataset cannot be read or trained on, the grids cannot be stored, or `stop` is set; the first error in the
/// order of shards.
pub fn load(
    dataset: &Dataset,
    folder: &Path,
    stop: &AtomicBool,
    scene_done: &(dyn Fn() + Sync),
) -> Result<GraspDataset, Failure> {
    let info = dataset.info();
    if info.grid.resolution != RESOLUTION {
        let text =
            format!("the network takes grids of {RESOLUTION}^3 voxels, the dataset has {}^3", info.grid.resolution);
        return Err(Failure::new(ExitCode::Config, text));
    }
    // Samples have four bytes for the number of their scene.
    let scenes = u32::try_from(info.scene_count).map_err(|_| {
        let text = format!("at most {} scenes can be trained on, the dataset has {}", u32::MAX, info.scene_count);
        Failure::new(ExitCode::Config, text)
    })?;
    let grids = Grids::create(folder, scenes as usize)?;
    let failed = AtomicU32::new(u32::MAX); // the lowest shard that failed
    let shards: Vec<(Vec<Record>, u64)> = (0..info.shard_count)
        .into_par_iter()
        .map(|shard| {
            if failed.load(Ordering::Relaxed) < shard {
                return Err(stopped()); // after the failure, so the result is not used
            }
            let records = load_shard(dataset, shard, &grids, stop, scene_done);
            records.inspect_err(|_| {
                failed.fetch_min(shard, Ordering::Relaxed);
            })
        })
        .collect::<Vec<Result<_, Failure>>>()
        .into_iter()
        .collect::<Result<_, _>>()?;
    let outside = shards.iter().map(|(_, outside)| outside).sum();
    let records = shards.into_iter().flat_map(|(records, _)| records).collect();
    Ok(GraspDataset { records, grids, outside })
}

fn stopped() -> Failure {
    Failure::new(ExitCode::TryAgain, "stopped by a signal while reading the dataset")
}

/// Reads the samples of a shard and writes their grids to the file; also returns the number of grasps outside the grid.
fn load_shard(
    dataset: &Dataset,
    shard: u32,
    grids: &Grids,
    stop: &AtomicBool,
    scene_done: &(dyn Fn() + Sync),
) -> Result<(Vec<Record>, u64), Failure> {
    if stop.load(Ordering::Relaxed) {
        return Err(stopped());
    }
    for scene in dataset.scenes(shard)? {
        let scene = scene?;
        grids.write(scene.scene_id as usize, &scene.tsdf)?;
        scene_done();
        if stop.load(Ordering::Relaxed) {
            return Err(stopped());
        }
    }
    let samples = schema::samples_of(&dataset.read_attempts(shard)?, &dataset.info().gripper);
    let records: Vec<Record> = samples.iter().filter_map(|sample| record(sample, &dataset.info().grid)).collect();
    let outside = samples.len() - records.len();
    Ok((records, outside as u64))
}

/// The sample of an attempt, or `None` if its grasp's origin is outside the grid.
fn record(attempt: &AttemptRecord, grid: &Grid) -> Option<Record> {
    let label = attempt.label();
    let grasp = Grasp {
        workspace_from_grasp: attempt.workspace_from_grasp,
        // Only a held object's width is a target.
        width_m: attempt.width_m.filter(|_| label == 1).unwrap_or(0.0),
    };
    let voxels = grasp.to_voxels(grid)?;
    Some(Record {
        scene: attempt.scene_id as u32,
        attempt: attempt.attempt_id,
        voxel: voxels.index.map(|index| index as u8),
        rule: attempt.rule,
        label,
        rotation: voxels.rotation.to_array(),
        width_voxels: voxels.width_voxels,
    })
}
