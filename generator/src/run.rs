//! Generating shards: scenes are built in parallel, rows are written in order, and a shard is committed when it is
//! complete. A separate thread encodes rows while the others simulate.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use program::{Context as _, Exit, ExitCode, Failure};
use rayon::prelude::*;
use schema::SceneRows;
use shards::{Counts, DatasetInfo, Draft, Finalized, Location, ShardWriter};

use crate::build::{NoScene, make_scene};
use crate::config::Config;

/// Scenes of a parallel batch, from one shard or several: enough that cores rarely wait for the last scene of a batch.
/// A scene takes a quarter of a megabyte; at most three batches are in memory (being built, waiting, being written).
const SCENES_AT_ONCE: usize = 128;

/// A process that makes a part of the shards checks the others and completes the dataset if it can, up to this many
/// shards. With more, thousands of processes would each read thousands of markers.
pub const LOOK_SHARDS_MAX: u32 = 1_000;

/// Up to this many shards are checked one by one; each takes four sequential requests to a store.
const ASKED_ONE_BY_ONE_MAX: usize = 32;

/// Progress of a run.
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

impl Exit for NoScene {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Config
    }
}

/// Generates the shards `wanted` of a dataset, skips existing ones, and completes the dataset if possible. When `stop`
/// is set, the run ends soon and drops its incomplete shard.
///
/// # Errors
/// If a scene cannot be built or a shard not be written; committed shards remain.
pub fn generate(
    config: &Config,
    at: impl Into<Location>,
    wanted: &[u32],
    stop: &AtomicBool,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Report, Failure> {
    let info = config.dataset_info();
    let draft = Draft::begin(at, &info)?;
    let is_all = wanted.len() == info.shard_count as usize;
    let missing = missing_of(&draft, wanted)?;
    if missing.len() < wanted.len() {
        draft.flush()?; // the process that made the others may have been killed before its flush
    }
    for shard in wanted.iter().copied().filter(|shard| missing.binary_search(shard).is_err()) {
        on_event(Event::Skipped { shard, attempts: attempts_of(&info, shard) });
    }
    let (made, is_stopped) = thread::scope(|scope| {
        let (send, receive) = sync_channel(1);
        let writer = thread::Builder::new().spawn_scoped(scope, || write_shards(&draft, receive, on_event));
        let writer = writer.context("failed to start the writer's thread")?;
        let is_stopped = build_scenes(config, &info, &missing, stop, on_event, &send);
        drop(send);
        let made = writer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        Ok::<_, Failure>((made, is_stopped?))
    })?;
    let looks = is_all || info.shard_count <= LOOK_SHARDS_MAX;
    Ok(Report { made, is_stopped, dataset: looks.then(|| complete(&draft)).transpose()? })
}

/// The missing shards among `wanted`: checks each, or lists all at once if `wanted` is a large part of the dataset.
fn missing_of(draft: &Draft, wanted: &[u32]) -> Result<Vec<u32>, Failure> {
    if wanted.len() > ASKED_ONE_BY_ONE_MAX && 4 * wanted.len() >= draft.info().shard_count as usize {
        let missing = draft.missing()?;
        return Ok(wanted.iter().copied().filter(|shard| missing.binary_search(shard).is_ok()).collect());
    }
    let is_missing = |shard: &u32| Ok(if draft.is_committed(*shard)? { None } else { Some(*shard) });
    wanted.iter().filter_map(|shard| is_missing(shard).transpose()).collect()
}

/// Completes the dataset if all markers exist.
fn complete(draft: &Draft) -> Result<Finalized, Failure> {
    let missing = draft.unmarked()?;
    Ok(if missing.is_empty() { draft.finalize()? } else { Finalized::Incomplete { missing } })
}

/// Builds the scenes of `shards` in parallel and sends them in order, each with its shard. Returns whether the run was
/// stopped. Also ends early if the receiver is gone.
fn build_scenes(
    config: &Config,
    info: &DatasetInfo,
    shards: &[u32],
    stop: &AtomicBool,
    on_event: &(dyn Fn(Event) + Sync),
    send: &SyncSender<Vec<(u32, SceneRows)>>,
) -> Result<bool, Failure> {
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

/// Writes scenes as they arrive and commits a shard when it has all its scenes; an incomplete shard is dropped.
fn write_shards(
    draft: &Draft,
    receive: Receiver<Vec<(u32, SceneRows)>>,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Counts, Failure> {
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
