//! Generating shards: scenes in parallel, rows in order, a shard committed when it is whole. Rows are encoded on a thread
//! of their own, so that the others go on simulating.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use rayon::prelude::*;
use schema::SceneRows;
use shards::{
    BeginError, Counts, DatasetInfo, Draft, ExitCode, FinalizeError, Finalized, Location, ShardWriter, StoreError,
    WriteError,
};

use crate::build::{NoScene, make_scene};
use crate::config::Config;

/// Scenes that are built at once, of one shard or several: enough that the cores do not wait for each other's last scene
/// often. A quarter of a megabyte each; three batches are in memory at most (built, waiting, written).
const SCENES_AT_ONCE: usize = 128;

/// A process that makes a part of a dataset's shards looks at the others, and completes the dataset if it can, up to so many
/// of them: beyond, thousands of processes would look at thousands of markers each.
pub const LOOK_SHARDS_MAX: u32 = 1_000;

/// Shards that are asked for one by one, each of which takes four requests to a store, one after the other.
const ASKED_ONE_BY_ONE_MAX: usize = 32;

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
    /// The state of the whole dataset; `None` if that was not looked at (see [`LOOK_SHARDS_MAX`]).
    pub dataset: Option<Finalized>,
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
    /// Threads could not be started.
    #[error("failed to start threads: {0}")]
    Threads(String),
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
            Self::Threads(_) => ExitCode::TryAgain,
            Self::Write(error) => error.exit_code(),
            Self::Store(error) => error.exit_code(),
            Self::Finalize(error) => error.exit_code(),
        }
    }
}

/// Generates the shards `wanted` of a dataset, skipping those that are there, and completes the dataset if it can. When
/// `stop` is set the run ends soon; a shard that is not whole by then is dropped.
///
/// # Errors
/// [`GenerateError`]; what was committed before stays.
pub fn generate(
    config: &Config,
    at: impl Into<Location>,
    wanted: &[u32],
    stop: &AtomicBool,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Report, GenerateError> {
    let info = config.dataset_info();
    if let Some(index) = wanted.iter().copied().find(|index| *index >= info.shard_count) {
        return Err(GenerateError::NoSuchShard { index, shard_count: info.shard_count });
    }
    let draft = Draft::begin(at, &info)?;
    let is_all = wanted.len() == info.shard_count as usize;
    let missing = missing_of(&draft, wanted)?;
    if missing.len() < wanted.len() {
        draft.flush()?; // whoever made the others may have been killed before
    }
    for shard in wanted.iter().copied().filter(|shard| missing.binary_search(shard).is_err()) {
        on_event(Event::Skipped { shard, attempts: attempts_of(&info, shard) });
    }
    let (made, is_stopped) = std::thread::scope(|scope| {
        let (send, receive) = sync_channel(1);
        let writer = scope.spawn(|| write_shards(&draft, receive, on_event));
        let is_stopped = build_scenes(config, &info, &missing, stop, on_event, &send);
        drop(send);
        let made = writer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        Ok::<_, GenerateError>((made, is_stopped?))
    })?;
    let looks = is_all || info.shard_count <= LOOK_SHARDS_MAX;
    Ok(Report { made, is_stopped, dataset: looks.then(|| complete(&draft)).transpose()? })
}

/// Asks for each, or, if that are many of all, for all at once.
fn missing_of(draft: &Draft, wanted: &[u32]) -> Result<Vec<u32>, StoreError> {
    if wanted.len() > ASKED_ONE_BY_ONE_MAX && 4 * wanted.len() >= draft.info().shard_count as usize {
        let missing = draft.missing()?;
        return Ok(wanted.iter().copied().filter(|shard| missing.binary_search(shard).is_ok()).collect());
    }
    let is_missing = |shard: &u32| Ok(if draft.is_committed(*shard)? { None } else { Some(*shard) });
    wanted.iter().filter_map(|shard| is_missing(shard).transpose()).collect()
}

/// Completes the dataset, after a quick look at whether that can be.
fn complete(draft: &Draft) -> Result<Finalized, GenerateError> {
    let missing = draft.unmarked()?;
    Ok(if missing.is_empty() { draft.finalize()? } else { Finalized::Incomplete { missing } })
}

/// Builds the scenes of `shards` in parallel and sends them on in order, each with its shard; whether it was stopped. Ends
/// early too when nobody listens any more.
fn build_scenes(
    config: &Config,
    info: &DatasetInfo,
    shards: &[u32],
    stop: &AtomicBool,
    on_event: &(dyn Fn(Event) + Sync),
    send: &SyncSender<Vec<(u32, SceneRows)>>,
) -> Result<bool, GenerateError> {
    let scenes: Vec<(u32, u64)> =
        shards.iter().flat_map(|shard| info.scenes_of(*shard).map(|scene_id| (*shard, scene_id))).collect();
    for batch in scenes.chunks(SCENES_AT_ONCE) {
        let build = |(shard, scene_id): &(u32, u64)| {
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let rows = make_scene(config, *scene_id, info.attempts_of_scene(*scene_id))?;
            let positives = rows.attempts.iter().map(|a| u64::from(a.label())).sum();
            on_event(Event::Scene { attempts: rows.attempts.len() as u64, positives });
            Ok(Some((*shard, rows)))
        };
        let built: Result<Vec<Option<_>>, NoScene> = batch.par_iter().with_max_len(1).map(build).collect();
        let built: Option<Vec<_>> = built?.into_iter().collect();
        let Some(built) = built else { return Ok(true) };
        if send.send(built).is_err() {
            break;
        }
    }
    Ok(false)
}

/// Writes scenes as they come, and commits a shard when it has all of its scenes; one that stays without is dropped.
fn write_shards(
    draft: &Draft,
    receive: Receiver<Vec<(u32, SceneRows)>>,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Counts, GenerateError> {
    let mut made = Counts::zero();
    let mut open: Option<(u64, ShardWriter)> = None;
    for (shard, rows) in receive.into_iter().flatten() {
        let (missing, mut writer) = match open.take() {
            Some(open) => open,
            None => (draft.info().scenes_of(shard).count() as u64, draft.shard(shard)?),
        };
        writer.push(&rows)?;
        if missing > 1 {
            open = Some((missing - 1, writer));
        } else {
            made.add(&writer.commit()?.counts);
            on_event(Event::Committed { shard });
        }
    }
    Ok(made)
}

/// Attempts of a shard.
#[must_use]
pub fn attempts_of(info: &DatasetInfo, shard: u32) -> u64 {
    info.scenes_of(shard).map(|scene| u64::from(info.attempts_of_scene(scene))).sum()
}
