//! A small synthetic dataset on disk.

use std::path::{Path, PathBuf};

use schema::SceneRows;
use shards::{DatasetInfo, Draft, Finalized, ShardSummary};

use crate::synthetic;

/// 2 shards, 10 scenes, 58 attempts, 8³ voxels.
pub(crate) fn info(seed: u64) -> DatasetInfo {
    sized(seed, 2, 58, 6)
}

/// An info on a coarse grid.
pub(crate) fn sized(seed: u64, shards: u32, attempts: u64, per_scene: u32) -> DatasetInfo {
    let mut info = synthetic::info(seed, shards, attempts, per_scene);
    info.grid.resolution = 8;
    info
}

/// The rows of a shard.
pub(crate) fn rows(info: &DatasetInfo, shard: u32) -> Vec<SceneRows> {
    info.scenes_of(shard).map(|scene| synthetic::scene_rows(scene, info.seed, info)).collect()
}

/// Writes one shard.
pub(crate) fn write_shard(draft: &Draft, shard: u32) -> ShardSummary {
    let mut writer = draft.shard(shard).unwrap();
    for rows in rows(draft.info(), shard) {
        writer.push(&rows).unwrap();
    }
    writer.commit().unwrap()
}

/// Writes a whole dataset.
pub(crate) fn write(dir: &Path, info: &DatasetInfo) {
    let draft = Draft::begin(dir, info).unwrap();
    for shard in 0..info.shard_count {
        write_shard(&draft, shard);
    }
    assert!(matches!(draft.finalize().unwrap(), Finalized::Complete(_)));
}

/// Every file under a folder, with its bytes, in order.
pub(crate) fn files(dir: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![dir.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                found.push((path.strip_prefix(dir).unwrap().to_owned(), std::fs::read(&path).unwrap()));
            }
        }
    }
    found.sort();
    found
}
