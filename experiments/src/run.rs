//! A complete experiment: rounds in parallel, and a journal from which an interrupted run continues.
//!
//! A round runs on one thread: its planning stays on that thread (a separate pool), so that its times are those of one
//! core and contain no work of other rounds.

use std::collections::BTreeSet;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;

use program::{Context as _, ExitCode, Failure, thread_pool};

use crate::config::Config;
use crate::journal::{Identity, Journal};
use crate::offer::Plans;
use crate::record::{Ending, Round};
use crate::round::play;

/// Runs all rounds that are not in the journal of `folder` on `threads` threads and calls `on_round` after each.
/// Returns the rounds in order, all of them unless `stop` was set. The folder is there, with the caller's
/// [`program::FolderLock`].
///
/// # Errors
/// If a round fails, a file cannot be written, or the folder holds another experiment.
pub fn run(
    config: &Config,
    planner: &dyn Plans,
    threads: usize,
    folder: &Path,
    stop: &AtomicBool,
    on_round: &(dyn Fn(&Round) + Sync),
) -> Result<Vec<Round>, Failure> {
    let identity = Identity {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        model: planner.id(),
        config: config.digest.clone(),
        seeds: config.keys.seeds.clone(),
        // With one seed the number of rounds may change; with several seeds rounds are numbered consecutively.
        rounds: if config.keys.seeds.len() > 1 { config.keys.rounds } else { 0 },
    };
    let (journal, mut rounds) = Journal::open(folder, &identity)?;
    rounds.retain(|round| round.round < config.round_count());
    rounds.iter().for_each(on_round);
    let played: BTreeSet<u64> = rounds.iter().map(|round| round.round).collect();
    let missing: Vec<u64> = (0..config.round_count()).filter(|round| !played.contains(round)).collect();
    let play_one = |round: &u64| -> Result<Option<Round>, Failure> {
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let round = play(config, planner, *round)?;
        // A planner that a stop interrupted gave no answer: another run plays the round.
        if round.ending == Ending::NoAnswer && stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        journal.push(&round)?;
        on_round(&round);
        Ok(Some(round))
    };
    rounds.extend(in_threads(threads, &missing, &play_one)?);
    rounds.sort_by_key(|round| round.round);
    Ok(rounds)
}

/// Runs rounds on a number of threads.
fn in_threads(
    threads: usize,
    missing: &[u64],
    play_one: &(dyn Fn(&u64) -> Result<Option<Round>, Failure> + Sync),
) -> Result<Vec<Round>, Failure> {
    let next = AtomicUsize::new(0);
    let work = || -> Result<Vec<Round>, Failure> {
        let pool = thread_pool(1)?;
        let mut played = Vec::new();
        while let Some(round) = missing.get(next.fetch_add(1, Ordering::Relaxed)) {
            match pool.install(|| play_one(round)) {
                Ok(Some(round)) => played.push(round),
                Ok(None) => break,
                Err(error) => {
                    // The other threads end after their current rounds.
                    next.store(missing.len(), Ordering::Relaxed);
                    return Err(error);
                }
            }
        }
        Ok(played)
    };
    let all: Vec<Result<Vec<Round>, Failure>> = thread::scope(|scope| {
        let start = |_| thread::Builder::new().spawn_scoped(scope, work);
        let workers: io::Result<Vec<_>> = (0..threads.max(1)).map(start).collect();
        let workers = workers.inspect_err(|_| next.store(missing.len(), Ordering::Relaxed));
        let workers = workers.context("failed to start a round's thread")?;
        let panicked = |_| Err(Failure::new(ExitCode::Internal, "a round ended in a defect of the program"));
        Ok::<_, Failure>(workers.into_iter().map(|worker| worker.join().unwrap_or_else(panicked)).collect())
    })?;
    Ok(all.into_iter().collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
}
