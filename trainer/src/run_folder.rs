//! The folder of a run: its lock and its files.
//!
//! ```text
//! config.toml          the recipe, every key written out; written first
//! last.safetensors     weights, optimiser, progress: what --resume continues from
//! best.safetensors     weights of the best epoch so far
//! metrics.jsonl        one line per epoch
//! ```

use std::fmt::Display;
use std::io;
use std::path::{Path, PathBuf};

use network::checkpoint::{self, Checkpoint};
use program::{Context as _, ExitCode, Failure, FolderLock, differences, names_in, unread, write};
use shards::Dataset;

use crate::config::Config;
use crate::schedule::Schedule;

/// A run's folder, locked against other writers while this value exists.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    _lock: FolderLock,
}

const CONFIG: &str = "config.toml";
/// The checkpoint of the epoch with the best test accuracy.
pub const BEST: &str = "best.safetensors";
/// The latest checkpoint.
const LAST: &str = "last.safetensors";
/// What epochs were like, a line of JSON each.
const METRICS: &str = "metrics.jsonl";

impl RunFolder {
    /// Opens a folder for a run. A new or empty folder begins a run; a folder with a run of this recipe is resumed if
    /// `resume` is set; anything else is refused and not changed. (Epochs may differ, because they only affect when
    /// training ends. With a cosine schedule their number affects the steps and must not differ.)
    ///
    /// # Errors
    /// If the folder is refused or in use, or cannot be read or written.
    pub fn open(path: &Path, config: &Config, resume: bool) -> Result<Self, Failure> {
        let has_results = [LAST, BEST, METRICS].iter().any(|name| path.join(name).exists());
        if let Some(entry) =
            first_entry(path).context(format_args!("failed to read the run's folder {}", path.display()))?
        {
            // Other programs also have files of that name.
            let Ok(begun_with) = begun_with(path) else {
                return Err(refused(
                    format!("the folder holds {entry:?} and no run, give an empty or a new one"),
                    path,
                ));
            };
            if has_results && !resume {
                return Err(refused("the folder holds a run already, --resume continues it", path));
            }
            if has_results {
                check_config(&begun_with, config, path)?;
            } // else the run ended before its first checkpoint
        }
        Ok(Self { _lock: FolderLock::take(path)?, path: path.to_owned() })
    }

    /// Writes the recipe. Call it after [`Self::last`], so that a refused run changes nothing.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write_config(&self, config: &Config) -> Result<(), Failure> {
        write(&self.path.join(CONFIG), config.to_toml())
    }

    /// The checkpoint to continue from, or `None` if the run has none yet.
    ///
    /// # Errors
    /// If the checkpoint is damaged or was trained on other datasets.
    pub fn last(&self, datasets: &[Dataset]) -> Result<Option<Checkpoint>, Failure> {
        let path = self.path.join(LAST);
        if !path.exists() {
            return Ok(None);
        }
        let found = checkpoint::read(&path)?;
        let ids: Vec<&str> = found.dataset_id.split('+').collect();
        if ids.len() != datasets.len() || !datasets.iter().zip(ids).all(|(dataset, id)| dataset.has_id(id)) {
            let (was, is) = (found.dataset_id, id_of(datasets));
            return Err(refused(format!("the run was begun on another dataset, {was}, not {is}"), &self.path));
        }
        Ok(Some(found))
    }

    /// Writes the checkpoint to continue from.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save_last(&self, checkpoint: &Checkpoint) -> Result<(), Failure> {
        checkpoint::save(checkpoint, &self.path.join(LAST))
    }

    /// Writes the weights of the best epoch.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn save_best(&self, checkpoint: &Checkpoint) -> Result<(), Failure> {
        let weights = Checkpoint { moments: None, ..checkpoint.clone() };
        checkpoint::save(&weights, &self.path.join(BEST))
    }

    /// Rewrites `metrics.jsonl`, so that it never ends with a partial line.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write_metrics(&self, lines: &[String]) -> Result<(), Failure> {
        let text: String = lines.iter().flat_map(|line| [line.as_str(), "\n"]).collect();
        write(&self.path.join(METRICS), text)
    }
}

/// What a checkpoint says it was trained on.
pub(crate) fn id_of(datasets: &[Dataset]) -> String {
    let ids: Vec<&str> = datasets.iter().map(Dataset::id).collect();
    ids.join("+")
}

/// Largest text in a run's folder, in bytes; in `metrics.jsonl` an epoch takes half a kilobyte.
const TEXT_BYTES_MAX: u64 = 64 << 20;

/// The text of a run's `metrics.jsonl`; empty if there is no such file.
///
/// # Errors
/// If it cannot be read.
pub(crate) fn read_metrics(run: &Path) -> Result<String, Failure> {
    let path = run.join(METRICS);
    if path.exists() { read_text(&path) } else { Ok(String::new()) }
}

/// The recipe in the folder of a run.
///
/// # Errors
/// If it is not there, cannot be read or is damaged.
fn begun_with(run: &Path) -> Result<Config, Failure> {
    let path = run.join(CONFIG);
    let damaged = |error| Failure::new(ExitCode::Data, format!("damaged recipe of the run: {error}"));
    Config::parse(&read_text(&path)?, &path).map_err(damaged)
}

fn read_text(path: &Path) -> Result<String, Failure> {
    let text = |bytes| String::from_utf8(bytes).map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error));
    program::read(path, TEXT_BYTES_MAX).and_then(text).map_err(|error| unread(path, &error))
}

fn refused(text: impl Display, path: &Path) -> Failure {
    Failure::new(ExitCode::Config, format!("{text}: {}", path.display()))
}

/// Any entry of a folder except our lock and our staging files; `None` if there is no folder.
fn first_entry(path: &Path) -> io::Result<Option<String>> {
    let is_foreign = |name: &String| name != FolderLock::NAME && !name.ends_with(".tmp");
    match names_in(path) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
        names => Ok(names?.into_iter().filter(is_foreign).min()),
    }
}

/// Refuses to resume with another recipe than that which the run was begun with.
fn check_config(begun_with: &Config, config: &Config, path: &Path) -> Result<(), Failure> {
    let is_cosine = config.training.schedule == Schedule::Cosine;
    let [was, is]: [serde_json::Value; 2] =
        [begun_with, config].map(|config| toml::from_str(&config.to_toml()).unwrap_or_default());
    let mut other = differences("", &was, &is);
    other.retain(|said| is_cosine || !said.starts_with("training.epochs "));
    if other.is_empty() {
        return Ok(());
    }
    let why = if is_cosine { "; a cosine schedule depends on training.epochs" } else { "" };
    let text = format!("the run was begun with another configuration, which differs in {}{why}", other.join(", "));
    Err(refused(text, path))
}
