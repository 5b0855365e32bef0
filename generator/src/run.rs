//! Generating shards: scenes are built in parallel, rows are written in order, and a shard is committed when it is
//! complete. A separate thread encodes rows while the others simulate.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use program::text::percent;
use program::{Context as _, Exit, ExitCode, Failure};
use rayon::prelude::*;
use schema::{SceneRejections, SceneRows};
use shards::{Counts, DatasetInfo, Draft, Finalized, Location, ShardWriter};

use crate::build::{NoScene, make_scene_watched};
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
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Rows made by this run, in shards that it committed.
    pub made: Counts,
    /// If the run was stopped before its shards were done, the number of finished scenes of incomplete shards, which
    /// the next one makes again.
    pub stopped: Option<u64>,
    /// The state of the whole dataset; `None` if that was not looked at (see [`LOOK_SHARDS_MAX`]).
    pub dataset: Option<Finalized>,
}

/// Scenes that a run threw away.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Rejected {
    /// Scenes that came to rest.
    kept: u64,
    /// Scenes that were thrown away, for any reason.
    thrown_away: u64,
}

/// The share of rejected scenes above which a run ends, unless another is given. More, and what is left is not what was
/// drawn: the objects that do not come to rest are missing.
pub const REJECTED_SHARE_MAX: f64 = 0.1;
/// Standard deviations by which the share must exceed the limit, so that few scenes decide nothing.
const REJECTED_DEVIATIONS: f64 = 3.0;

impl Rejected {
    /// The share of the scenes that were thrown away.
    fn share(&self) -> f64 {
        self.thrown_away as f64 / (self.kept + self.thrown_away).max(1) as f64
    }

    /// Whether the share is above `share_max` beyond chance.
    fn is_above(&self, share_max: f64) -> bool {
        let (share, tries) = (self.share(), (self.kept + self.thrown_away).max(1) as f64);
        share - REJECTED_DEVIATIONS * (share * (1.0 - share) / tries).sqrt() > share_max
    }
}

impl Exit for NoScene {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::Rejected { .. } => ExitCode::Config,
            Self::Abandoned => ExitCode::TryAgain,
        }
    }
}

/// Generates the shards `wanted` of a dataset, skips existing ones, and completes the dataset if possible. When `stop`
/// is set, the run ends soon: it abandons the scenes under way, and the scenes of incomplete shards are lost.
///
/// # Errors
/// If a scene cannot be built or a shard not be written, or if more than `rejected_max` of the scenes are thrown away;
/// committed shards remain.
pub fn generate(
    config: &Config,
    at: impl Into<Location>,
    wanted: &[u32],
    rejected_max: f64,
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
        tracing::info!(shard, "skipped: an earlier run committed it");
        on_event(Event::Skipped { attempts: attempts_of(&info, shard) });
    }
    let mut rejected = Rejected::default();
    let run = Run { config, draft: &draft, rejected_max, stop, on_event };
    let (made, stopped) = thread::scope(|scope| {
        let (send, receive) = sync_channel(1);
        let writer = thread::Builder::new().spawn_scoped(scope, || run.write_shards(receive));
        let writer = writer.context("failed to start the writer's thread")?;
        let is_stopped = run.build_scenes(&missing, &mut rejected, &send);
        drop(send);
        let made: Counts = writer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        let finished = rejected.kept - made.scenes;
        Ok::<_, Failure>((made, is_stopped?.then_some(finished)))
    })?;
    let looks = is_all || info.shard_count <= LOOK_SHARDS_MAX;
    Ok(Report { made, stopped, dataset: looks.then(|| complete(&draft)).transpose()? })
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

/// What the threads of a run share.
#[derive(Clone, Copy)]
struct Run<'a> {
    config: &'a Config,
    draft: &'a Draft,
    rejected_max: f64,
    stop: &'a AtomicBool,
    on_event: &'a (dyn Fn(Event) + Sync),
}

impl Run<'_> {
    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Builds the scenes of `shards` in parallel and sends them in order, each with its shard. If the run is stopped,
    /// those up to the first unfinished one are sent, and true is returned. Also ends early if the receiver is gone.
    fn build_scenes(
        &self,
        shards: &[u32],
        rejected: &mut Rejected,
        send: &SyncSender<Vec<(u32, SceneRows)>>,
    ) -> Result<bool, Failure> {
        let info = self.draft.info();
        let scenes: Vec<(u32, u64)> =
            shards.iter().flat_map(|shard| info.scenes_of(*shard).map(|scene_id| (*shard, scene_id))).collect();
        for batch in scenes.chunks(SCENES_AT_ONCE) {
            let built: Result<Vec<Option<(u32, SceneRows)>>, NoScene> =
                batch.par_iter().with_max_len(1).map(|(shard, id)| self.build(*shard, *id)).collect();
            let built = built?;
            let in_order = built.iter().take_while(|scene| scene.is_some()).count();
            let is_whole = in_order == built.len();
            let mut built: Vec<(u32, SceneRows)> = built.into_iter().flatten().collect();
            for (_, rows) in &built {
                let SceneRejections { unsettled, empty, unstable } = rows.scene.rejections;
                rejected.kept += 1;
                rejected.thrown_away += u64::from(unsettled + empty + unstable);
            }
            built.truncate(in_order);
            let is_stopped = !is_whole || self.is_stopped();
            if !is_stopped && rejected.is_above(self.rejected_max) {
                return Err(too_many(rejected, self.rejected_max));
            }
            let is_over = built.last().map(|(_, rows)| rows.scene.scene_id) == scenes.last().map(|(_, id)| *id);
            if send.send(built).is_err() {
                break;
            }
            if is_stopped && !(is_whole && is_over) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Builds a scene; nothing if the run is stopped before it is finished.
    fn build(&self, shard: u32, scene_id: u64) -> Result<Option<(u32, SceneRows)>, NoScene> {
        if self.is_stopped() {
            return Ok(None);
        }
        let attempts = self.draft.info().attempts_of_scene(scene_id);
        let made = make_scene_watched(self.config, scene_id, attempts, &mut |_| {
            if self.is_stopped() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        let rows = match made {
            Err(NoScene::Abandoned) => return Ok(None),
            made => made?,
        };
        let positives = rows.attempts.iter().map(|a| u64::from(a.label())).sum();
        (self.on_event)(Event::Scene { attempts: rows.attempts.len() as u64, positives });
        Ok(Some((shard, rows)))
    }

    /// Writes scenes as they arrive and commits a shard when it has all its scenes. Returns the counts of what was
    /// committed.
    fn write_shards(&self, receive: Receiver<Vec<(u32, SceneRows)>>) -> Result<Counts, Failure> {
        let mut made = Counts::zero();
        let mut open: Option<(u64, ShardWriter)> = None;
        for (shard, rows) in receive.into_iter().flatten() {
            let (missing, mut writer) = match open.take() {
                Some(open) => open,
                None => (self.draft.info().scenes_of(shard).count() as u64, self.draft.shard(shard)?),
            };
            writer.push(&rows)?;
            if missing > 1 {
                open = Some((missing - 1, writer));
            } else {
                made.add(&writer.commit()?.counts);
                tracing::info!(shard, "committed");
            }
        }
        Ok(made)
    }
}

fn too_many(rejected: &Rejected, share_max: f64) -> Failure {
    let (share, tries) = (percent(rejected.share()), rejected.kept + rejected.thrown_away);
    let text = format!(
        "{share} of the first {tries} scenes were thrown away, more than --rejected-max {share_max}. Leave \
         objects out that do not come to rest, or allow more"
    );
    Failure::new(ExitCode::Config, text)
}

/// Attempts of a shard.
#[must_use]
pub fn attempts_of(info: &DatasetInfo, shard: u32) -> u64 {
    info.scenes_of(shard).map(|scene| u64::from(info.attempts_of_scene(scene))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_scenes_decide_nothing_and_many_do() {
        let of = |kept, thrown_away| Rejected { kept, thrown_away };
        assert!(!of(3, 3).is_above(0.1) && !of(128, 14).is_above(0.1) && !Rejected::default().is_above(0.1));
        assert!(of(50, 204).is_above(0.1) && of(100, 40).is_above(0.1) && !of(50, 204).is_above(1.0));
    }

    #[test]
    fn the_share_the_tries_and_the_limit_are_said() {
        let text = too_many(&Rejected { kept: 100, thrown_away: 28 }, 0.1).to_string();
        assert!(
            text.starts_with("21.9 % of the first 128 scenes were thrown away, more than --rejected-max 0.1"),
            "{text}"
        );
    }
}
