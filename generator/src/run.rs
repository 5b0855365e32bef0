//! Generating shards: scenes in parallel, rows in order, a shard committed when it is whole.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;
use schema::SceneRows;
use shards::{
    BeginError, Counts, DatasetInfo, ExitCode, FinalizeError, Finalized, ShardWriter, StoreError, WriteError,
    begin_dataset, finalize, is_committed,
};

use crate::build::{NoScene, make_scene};
use crate::config::Config;

/// Scenes that are built at once, and so held in memory: enough to keep the cores busy, a quarter of a megabyte each.
const SCENES_AT_ONCE: usize = 64;

/// What happens while shards are generated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// A shard was committed by an earlier run.
    Skipped {
        /// The shard.
        shard: u32,
        /// Its attempts.
        attempts: u64,
    },
    /// A scene has been built.
    Scene {
        /// Its attempts.
        attempts: u64,
        /// Its positives.
        positives: u64,
    },
    /// A shard has been committed.
    Committed {
        /// The shard.
        shard: u32,
    },
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Rows made by this run, in shards that it committed.
    pub made: Counts,
    /// Whether the run was stopped before its shards were done.
    pub is_stopped: bool,
    /// The state of the whole dataset.
    pub dataset: Finalized,
}

/// Why a run failed.
#[derive(Debug, thiserror::Error)]
pub enum GenerateError {
    /// The folder cannot take this dataset.
    #[error(transparent)]
    Begin(#[from] BeginError),
    /// A scene could not be built.
    #[error(transparent)]
    Scene(#[from] NoScene),
    /// A shard could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A shard's marker could not be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The dataset could not be completed.
    #[error(transparent)]
    Finalize(#[from] FinalizeError),
    /// There is no such shard.
    #[error("shard index must be below the number of shards, {shard_count}, got {index}")]
    NoSuchShard {
        /// What was asked for.
        index: u32,
        /// Shards in the dataset.
        shard_count: u32,
    },
}

impl GenerateError {
    /// The code to end with.
    #[must_use]
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Begin(error) => error.exit_code(),
            Self::Scene(_) | Self::NoSuchShard { .. } => ExitCode::Config,
            Self::Write(error) => error.exit_code(),
            Self::Store(error) => error.exit_code(),
            Self::Finalize(error) => error.exit_code(),
        }
    }
}

/// Generates the shards `wanted` of a dataset into `dir`, skipping those that are there, and completes the dataset if it
/// can. When `stop` is set the run ends soon; a shard that is not whole by then is dropped.
///
/// # Errors
/// [`GenerateError`]; what was committed before stays.
pub fn generate(
    config: &Config,
    dir: &Path,
    wanted: &[u32],
    stop: &AtomicBool,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Report, GenerateError> {
    let info = config.dataset_info();
    if let Some(index) = wanted.iter().copied().find(|index| *index >= info.shard_count) {
        return Err(GenerateError::NoSuchShard { index, shard_count: info.shard_count });
    }
    begin_dataset(dir, &info)?;
    let mut made = Counts::zero();
    let mut is_stopped = false;
    for shard in wanted.iter().copied() {
        if is_committed(dir, &info, shard)? {
            on_event(Event::Skipped { shard, attempts: attempts_of(&info, shard) });
            continue;
        }
        match write_shard(config, &info, dir, shard, stop, on_event)? {
            Some(counts) => made.add(&counts),
            None => {
                is_stopped = true;
                break;
            }
        }
        on_event(Event::Committed { shard });
    }
    Ok(Report { made, is_stopped, dataset: finalize(dir)? })
}

/// Attempts of a shard.
#[must_use]
pub fn attempts_of(info: &DatasetInfo, shard: u32) -> u64 {
    info.scenes_of(shard).map(|scene| u64::from(info.attempts_of_scene(scene))).sum()
}

/// Writes one shard; `None` if stopped.
fn write_shard(
    config: &Config,
    info: &DatasetInfo,
    dir: &Path,
    shard: u32,
    stop: &AtomicBool,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Option<Counts>, GenerateError> {
    let mut writer = ShardWriter::create(dir, info, shard)?;
    let scene_ids: Vec<u64> = info.scenes_of(shard).collect();
    for ids in scene_ids.chunks(SCENES_AT_ONCE) {
        let built: Vec<Option<Result<SceneRows, NoScene>>> = ids
            .par_iter()
            .with_max_len(1)
            .map(|scene_id| {
                if stop.load(Ordering::Relaxed) {
                    return None;
                }
                let rows = make_scene(config, *scene_id, info.attempts_of_scene(*scene_id));
                if let Ok(rows) = &rows {
                    let positives = rows.attempts.iter().map(|a| u64::from(a.label())).sum();
                    on_event(Event::Scene { attempts: rows.attempts.len() as u64, positives });
                }
                Some(rows)
            })
            .collect();
        for rows in built {
            match rows {
                Some(rows) => writer.push(&rows?)?,
                None => return Ok(None),
            }
        }
    }
    Ok(Some(writer.commit()?.counts))
}
