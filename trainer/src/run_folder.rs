//! The folder of a run: its lock and its files.
//!
//! ```text
//! config.toml          the recipe, every key written out; written first
//! last.safetensors     weights, optimiser, progress: what --resume continues from
//! best.safetensors     weights of the best epoch so far
//! metrics.jsonl        one line per epoch
//! loss.svg, .png       the losses by epoch, drawn from metrics.jsonl
//! accuracy.svg, .png   the accuracies by epoch, drawn from metrics.jsonl
//! tensorboard/         the same numbers, and the loss of steps, as TensorBoard's events
//! ```

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use network::checkpoint::{self, Checkpoint, CheckpointError};
use program::{Exit, ExitCode, publish};
use shards::Dataset;

use crate::config::Config;
use crate::schedule::Schedule;

/// A run's folder, locked against other writers while this value exists.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    lock: File,
}

/// Closing the file is not enough: a child process that another thread is starting may hold it open a moment longer.
impl Drop for RunFolder {
    fn drop(&mut self) {
        let _ = self.lock.unlock();
    }
}

/// Why a run cannot begin or resume in a folder.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The folder contains a run.
    #[error("the folder holds a run already, --resume continues it: {}", .0.display())]
    Occupied(PathBuf),
    /// The folder contains something else than a run.
    #[error("the folder holds {entry:?} and no run, give an empty or a new one: {}", .path.display())]
    Foreign {
        /// The first thing found.
        entry: String,
        /// The folder.
        path: PathBuf,
    },
    /// Another process is training in this folder.
    #[error("another process trains in this folder: {}", .0.display())]
    Busy(PathBuf),
    /// The recipe differs.
    #[error("the run was begun with another configuration, which differs in {}: {}", .keys.join(", "), .path.display())]
    OtherConfig {
        /// Keys, each with the old and the new value.
        keys: Vec<String>,
        /// The folder.
        path: PathBuf,
    },
    /// The dataset differs.
    #[error("the run was begun on another dataset, {was}, not {is}: {}", .path.display())]
    OtherDataset {
        /// Id of the dataset that the run was begun on.
        was: String,
        /// Id of the dataset given now.
        is: String,
        /// The folder.
        path: PathBuf,
    },
    /// The checkpoint cannot be read or written.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A file cannot be read or written.
    #[error("failed to {action}: {source}: {}", .path.display())]
    Io {
        /// The operation.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

impl Exit for RunError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::Occupied(_) | Self::Foreign { .. } | Self::OtherConfig { .. } | Self::OtherDataset { .. } => {
                ExitCode::Config
            }
            Self::Io { source, .. } if source.kind() == io::ErrorKind::InvalidData => ExitCode::Data, // not UTF-8
            Self::Busy(_) | Self::Io { .. } => ExitCode::TryAgain,
            Self::Checkpoint(error) => error.exit_code(),
        }
    }
}

pub(crate) const CONFIG: &str = "config.toml";
const LAST: &str = "last.safetensors";
const BEST: &str = "best.safetensors";
pub(crate) const METRICS: &str = "metrics.jsonl";
const LOCK: &str = ".lock";

impl RunFolder {
    /// Opens a folder for a run. A new or empty folder begins a run; a folder with a run of this recipe is resumed if
    /// `resume` is set; anything else is refused and not changed. (Epochs and patience may differ, because they only
    /// affect when training ends. With a cosine schedule the number of epochs affects the steps and must not differ.)
    ///
    /// # Errors
    /// [`RunError`].
    pub fn open(path: &Path, config: &Config, resume: bool) -> Result<Self, RunError> {
        let io = |action| move |source| RunError::Io { action, path: path.to_owned(), source };
        let has_results = [LAST, BEST, METRICS].iter().any(|name| path.join(name).exists());
        match first_entry(path).map_err(io("read the run's folder"))? {
            Some(entry) if !has_recipe(path) => return Err(RunError::Foreign { entry, path: path.to_owned() }),
            Some(_) if has_results && !resume => return Err(RunError::Occupied(path.to_owned())),
            Some(_) if has_results => check_config(path, config)?,
            _ => {} // empty, or a run that ended before its first checkpoint
        }
        fs::create_dir_all(path).map_err(io("make the run's folder"))?;
        let lock = File::options().create(true).append(true).open(path.join(LOCK));
        let lock = lock.map_err(io("make the run's lock"))?;
        match lock.try_lock() {
            Err(TryLockError::WouldBlock) => return Err(RunError::Busy(path.to_owned())),
            Ok(()) | Err(TryLockError::Error(_)) => {} // without support for locks, trust the user
        }
        Ok(Self { path: path.to_owned(), lock })
    }

    /// Writes the recipe. Call it after [`Self::last`], so that a refused run changes nothing.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub fn write_config(&self, config: &Config) -> Result<(), RunError> {
        self.publish(CONFIG, config.to_toml().as_bytes())
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The checkpoint to continue from, or `None` if the run has none yet.
    ///
    /// # Errors
    /// [`RunError`] if the checkpoint is damaged or was trained on another dataset.
    pub fn last(&self, dataset: &Dataset) -> Result<Option<Checkpoint>, RunError> {
        let found = match checkpoint::read(&self.path.join(LAST)) {
            Err(CheckpointError::Missing(_)) => return Ok(None),
            found => found?,
        };
        if !dataset.has_id(&found.dataset_id) {
            let (was, is) = (found.dataset_id, dataset.id().to_owned());
            return Err(RunError::OtherDataset { was, is, path: self.path.clone() });
        }
        Ok(Some(found))
    }

    /// Writes the checkpoint to continue from.
    ///
    /// # Errors
    /// [`RunError::Checkpoint`].
    pub fn save_last(&self, checkpoint: &Checkpoint) -> Result<(), RunError> {
        Ok(checkpoint::save(checkpoint, &self.path.join(LAST))?)
    }

    /// Writes the weights of the best epoch.
    ///
    /// # Errors
    /// [`RunError::Checkpoint`].
    pub fn save_best(&self, checkpoint: &Checkpoint) -> Result<(), RunError> {
        let weights = Checkpoint { moments: None, ..checkpoint.clone() };
        Ok(checkpoint::save(&weights, &self.path.join(BEST))?)
    }

    /// The lines of `metrics.jsonl`; none if there is no such file.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub fn metrics(&self) -> Result<Vec<String>, RunError> {
        let path = self.path.join(METRICS);
        match fs::read_to_string(&path) {
            Ok(text) => Ok(text.lines().map(str::to_owned).collect()),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
            Err(source) => Err(RunError::Io { action: "read the metrics", path, source }),
        }
    }

    /// Rewrites `metrics.jsonl`, so that it never ends with a partial line.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub fn write_metrics(&self, lines: &[String]) -> Result<(), RunError> {
        let text: String = lines.iter().flat_map(|line| [line.as_str(), "\n"]).collect();
        self.publish(METRICS, text.as_bytes())
    }

    fn publish(&self, name: &str, bytes: &[u8]) -> Result<(), RunError> {
        let path = self.path.join(name);
        publish(&path, bytes).map_err(|source| RunError::Io { action: "write a file of the run", path, source })
    }
}

/// The path of a run's checkpoint by its name for users: `best` or `last`.
#[must_use]
pub fn checkpoint_path(run: &Path, name: &str) -> PathBuf {
    run.join(format!("{name}.safetensors"))
}

/// Any entry of a folder except our lock and our staging files; `None` if there is no folder.
fn first_entry(path: &Path) -> io::Result<Option<String>> {
    let entries = match fs::read_dir(path) {
        Ok(entries) => entries,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(e),
    };
    let mut names = Vec::new();
    for entry in entries {
        let name = entry?.file_name().to_string_lossy().into_owned();
        if name != LOCK && !name.ends_with(".tmp") {
            names.push(name);
        }
    }
    Ok(names.into_iter().min())
}

/// Whether the folder's `config.toml` is a recipe; other programs also have files of that name.
fn has_recipe(path: &Path) -> bool {
    Config::load(Some(&path.join(CONFIG))).is_ok()
}

fn check_config(path: &Path, config: &Config) -> Result<(), RunError> {
    let file = path.join(CONFIG);
    let io = |source| RunError::Io { action: "read the run's configuration", path: file.clone(), source };
    let table = |text: &str| text.parse::<toml::Table>().unwrap_or_default();
    let text = fs::read_to_string(&file).map_err(io)?;
    // Parsed and serialised again: a recipe without a newer key means its default.
    let text = Config::parse(&text, &file).map_or(text, |config| config.to_toml());
    let was = flatten(&table(&text), "");
    let is = keys(config);
    let epochs_shape_steps = config.training.schedule == Schedule::Cosine;
    let keys: Vec<String> = is
        .iter()
        .filter(|(key, _)| key != "training.patience_epochs" && (key != "training.epochs" || epochs_shape_steps))
        .filter_map(|(key, value)| {
            let before = was.iter().find(|(other, _)| other == key).map_or("nothing", |(_, value)| value);
            let why = if key == "training.epochs" { ": a cosine schedule depends on it" } else { "" };
            (before != value).then(|| format!("{key} ({before} then, {value} now{why})"))
        })
        .collect();
    if keys.is_empty() { Ok(()) } else { Err(RunError::OtherConfig { keys, path: path.to_owned() }) }
}

/// The keys of a recipe with their values; keys of tables as `table.key`.
pub(crate) fn keys(config: &Config) -> Vec<(String, String)> {
    flatten(&config.to_toml().parse::<toml::Table>().unwrap_or_default(), "")
}

fn flatten(table: &toml::Table, prefix: &str) -> Vec<(String, String)> {
    let rows = table.iter().map(|(key, value)| match value {
        toml::Value::Table(inner) => flatten(inner, &format!("{prefix}{key}.")),
        value => vec![(format!("{prefix}{key}"), value.to_string())],
    });
    rows.collect::<Vec<_>>().concat()
}
