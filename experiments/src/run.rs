//! A complete experiment: rounds in parallel, a journal from which an interrupted run continues, and the reports at the
//! end.
//!
//! A round runs on one thread: its planning stays on that thread (a separate pool), so that its times are those of one
//! core and contain no work of other rounds.

use std::collections::BTreeSet;
use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Write as _};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;

use planner::Planner;
use program::{Context as _, ExitCode, Failure, thread_pool, unread};

use crate::config::Config;
use crate::files::BYTES_MAX;
use crate::record::Round;
use crate::round::play;

/// The head of the journal: the program and experiment that wrote it.
#[derive(Debug, PartialEq, serde::Serialize, serde::Deserialize)]
struct Identity {
    version: String,
    model: String,
    config: String,
    seeds: Vec<u64>,
    rounds: u64,
}

/// Runs all rounds that are not in the journal of `folder` on `threads` threads and calls `on_round` after each.
/// Returns the rounds in order, all of them unless `stop` was set. The folder is there, with the caller's
/// [`program::FolderLock`].
///
/// # Errors
/// If a round fails, a file cannot be written, or the folder holds another experiment.
pub fn run(
    config: &Config,
    planner: &Planner,
    threads: usize,
    folder: &Path,
    stop: &AtomicBool,
    on_round: &(dyn Fn(&Round) + Sync),
) -> Result<Vec<Round>, Failure> {
    let path = folder.join(JOURNAL);
    let identity = Identity {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        model: planner.model_id.clone(),
        config: config.digest.clone(),
        seeds: config.keys.seeds.clone(),
        // With one seed the number of rounds may change; with several seeds rounds are numbered consecutively.
        rounds: if config.keys.seeds.len() > 1 { config.keys.rounds } else { 0 },
    };
    let mut rounds = journal(&path, &identity)?;
    rounds.retain(|round| round.round < config.round_count());
    rounds.iter().for_each(on_round);
    let played: BTreeSet<u64> = rounds.iter().map(|round| round.round).collect();
    let missing: Vec<u64> = (0..config.round_count()).filter(|round| !played.contains(round)).collect();
    let unwritten = format!("failed to write {}", path.display());
    let file = Mutex::new(OpenOptions::new().append(true).open(&path).context(&unwritten)?);
    let play_one = |round: &u64| -> Result<Option<Round>, Failure> {
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let round = play(config, planner, *round)?;
        append(&file, &round).context(&unwritten)?;
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
    let mut rounds = Vec::new();
    for played in all {
        rounds.extend(played?);
    }
    Ok(rounds)
}

/// The rounds in the journal of `folder`, by number; `None` if there is no journal. A truncated last line is ignored.
/// Nothing is changed.
///
/// # Errors
/// If it cannot be read or is not a journal.
pub fn journalled(folder: &Path) -> Result<Option<Vec<Round>>, Failure> {
    let path = folder.join(JOURNAL);
    if !path.exists() {
        return Ok(None);
    }
    let rounds = whole_lines(&path).and_then(|text| rounds_of(&text));
    let mut rounds = rounds.map_err(|error| unread(&path, &error))?;
    rounds.sort_by_key(|round| round.round);
    Ok(Some(rounds))
}

/// The lines of a journal, without a truncated last one.
fn whole_lines(path: &Path) -> io::Result<String> {
    let mut bytes = program::read(path, BYTES_MAX)?;
    bytes.truncate(bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1));
    String::from_utf8(bytes).map_err(|error| io::Error::new(ErrorKind::InvalidData, error))
}

/// The rounds of a journal. Its first line names the experiment.
fn rounds_of(text: &str) -> io::Result<Vec<Round>> {
    let damaged = |line: usize| io::Error::new(ErrorKind::InvalidData, format!("line {line} is not a round"));
    let round = |(at, line)| serde_json::from_str(line).map_err(|_| damaged(at + 1));
    text.lines().enumerate().skip(1).map(round).collect()
}

/// The journal's name.
const JOURNAL: &str = "journal.jsonl";

fn append(file: &Mutex<File>, line: &impl serde::Serialize) -> io::Result<()> {
    let text = serde_json::to_string(line)? + "\n";
    let mut file = file.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    file.write_all(text.as_bytes())
}

/// The rounds of the journal, which is created if missing. A truncated last line is removed.
fn journal(path: &Path, identity: &Identity) -> Result<Vec<Round>, Failure> {
    if !path.exists() {
        let line = serde_json::to_string(identity).map_err(io::Error::from).context("failed to begin a journal")?;
        program::write(path, line + "\n")?;
        return Ok(Vec::new());
    }
    let other = || {
        let text = "the folder holds another experiment: its experiment.toml, network or program differs";
        Failure::new(ExitCode::Config, format!("{text}: {}", path.display()))
    };
    let text = whole_lines(path).map_err(|error| unread(path, &error))?;
    let first = text.lines().next().and_then(|line| serde_json::from_str::<Identity>(line).ok());
    if first.as_ref() != Some(identity) {
        return Err(other());
    }
    let rounds = rounds_of(&text).map_err(|_| other())?;
    let file = OpenOptions::new().write(true).open(path);
    let cut = file.and_then(|file| file.set_len(text.len() as u64));
    cut.context(format_args!("failed to write {}", path.display()))?;
    Ok(rounds)
}
