//! Beginning a dataset: its folder either becomes this dataset, is this dataset already, or is left alone.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::store::{Published, Store, StoreError, is_staging};
use crate::{DatasetInfo, ExitCode, Table, layout};

/// Why a dataset cannot begin in a folder.
#[derive(Debug, thiserror::Error)]
pub enum BeginError {
    /// The info is out of range.
    #[error("{}", .0.join("; "))]
    Range(Vec<String>),
    /// The folder holds something that is no dataset.
    #[error("the folder holds {entry:?} and no {info}: give an empty or a new one: {}", .dir.display(), info = layout::INFO)]
    NotEmpty {
        /// The folder.
        dir: PathBuf,
        /// The first thing found.
        entry: String,
    },
    /// What should be a folder is none.
    #[error("the dataset must go to a folder, got a file: {}", .0.display())]
    NotAFolder(PathBuf),
    /// The folder holds another dataset.
    #[error("the folder holds another dataset, which differs in {}: {}", .differences.join(", "), .dir.display())]
    Other {
        /// The folder.
        dir: PathBuf,
        /// The first keys that differ, each with what is there and what was asked for.
        differences: Vec<String>,
    },
    /// The disk refused.
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl BeginError {
    /// The code to end with.
    #[must_use]
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Range(_) | Self::NotEmpty { .. } | Self::NotAFolder(_) | Self::Other { .. } => ExitCode::Config,
            Self::Store(error) => error.exit_code(),
        }
    }
}

/// Most differences that are told.
const DIFFERENCES_MAX: usize = 4;

/// Makes the folders and publishes `meta/info.json`, or finds that they are there with equal contents.
///
/// # Errors
/// [`BeginError`] if the info is out of range, the folder holds another dataset or anything else, or the disk refuses.
pub fn begin_dataset(dir: &Path, info: &DatasetInfo) -> Result<(), BeginError> {
    let problems = info.problems();
    if !problems.is_empty() {
        return Err(BeginError::Range(problems));
    }
    if dir.exists() && !dir.is_dir() {
        return Err(BeginError::NotAFolder(dir.to_owned()));
    }
    let store = Store::new(dir);
    let text = info.to_json();
    // In this order: another process may begin the same dataset just now, and it publishes the info first.
    if let Some(entry) = first_foreign_entry(dir)?
        && store.size(layout::INFO)?.is_none()
    {
        return Err(BeginError::NotEmpty { dir: dir.to_owned(), entry });
    }
    if let Published::Existing(existing) = store.publish_new(layout::INFO, text.as_bytes())?
        && existing != text.as_bytes()
    {
        let differences = differences(&existing, &text);
        return Err(BeginError::Other { dir: dir.to_owned(), differences });
    }
    for folder in Table::ALL.map(Table::name).into_iter().chain(["meta/shards"]) {
        store.create_folder(&store.path(folder))?;
    }
    Ok(())
}

/// The first entry of a folder that a dataset killed at its very beginning would not have left. Hidden files and
/// `lost+found` are nobody's.
fn first_foreign_entry(dir: &Path) -> Result<Option<String>, StoreError> {
    let mut foreign: Vec<String> = names(dir)?;
    foreign.retain(|name| !name.starts_with('.') && name != "lost+found" && name != "meta");
    let mut in_meta = names(&dir.join("meta"))?;
    in_meta.retain(|name| !is_staging(name));
    foreign.extend(in_meta.into_iter().map(|name| format!("meta/{name}")));
    foreign.sort();
    Ok(foreign.into_iter().next())
}

fn names(dir: &Path) -> Result<Vec<String>, StoreError> {
    let listed = match fs::read_dir(dir) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        listed => listed.and_then(|entries| {
            entries.map(|entry| entry.map(|e| e.file_name().to_string_lossy().into_owned())).collect()
        }),
    };
    listed.map_err(|source| StoreError { action: "list a folder", at: dir.into(), source })
}

fn differences(existing: &[u8], asked: &str) -> Vec<String> {
    let Ok(existing) = serde_json::from_slice::<Value>(existing) else {
        return vec![format!("that its {} is damaged", layout::INFO)];
    };
    let asked = serde_json::from_str(asked).unwrap_or_default();
    let mut found = Vec::new();
    compare("", &existing, &asked, &mut found);
    if found.is_empty() {
        found.push("its spelling only: was meta/info.json edited by hand?".to_owned());
    }
    let more = found.len().saturating_sub(DIFFERENCES_MAX);
    found.truncate(DIFFERENCES_MAX);
    if more > 0 {
        found.push(format!("{more} more"));
    }
    found
}

fn compare(path: &str, existing: &Value, asked: &Value, found: &mut Vec<String>) {
    match (existing, asked) {
        (Value::Object(a), Value::Object(b)) => {
            let mut keys: Vec<&String> = a.keys().chain(b.keys().filter(|key| !a.contains_key(*key))).collect();
            keys.sort();
            for key in keys {
                let inner = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                let missing = Value::String("nothing".to_owned());
                compare(&inner, a.get(key).unwrap_or(&missing), b.get(key).unwrap_or(&missing), found);
            }
        }
        (a, b) if a == b => {}
        (a, b) => found.push(format!("{path} ({a} there, {b} asked for)")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    #[test]
    fn the_same_dataset_may_begin_again_and_another_may_not() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("new/folder");
        let info = synthetic::info(7, 2, 24, 6);
        begin_dataset(&out, &info).unwrap();
        begin_dataset(&out, &info).unwrap();
        let mut other = synthetic::info(8, 2, 24, 6);
        other.gripper.friction = 0.5;
        let error = begin_dataset(&out, &other).unwrap_err();
        assert_eq!(error.exit_code(), ExitCode::Config);
        let message = error.to_string();
        assert!(
            message.contains("gripper.friction (1.0 there, 0.5 asked for), seed (7 there, 8 asked for)"),
            "{message}"
        );
    }

    #[test]
    fn a_folder_of_someone_else_is_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("thesis.tex"), "do not lose").unwrap();
        let error = begin_dataset(dir.path(), &synthetic::info(7, 2, 24, 6)).unwrap_err();
        assert_eq!(error.exit_code(), ExitCode::Config);
        assert!(error.to_string().contains("thesis.tex"), "{error}");
        assert_eq!(names(dir.path()).unwrap(), ["thesis.tex"]);
    }

    #[test]
    fn what_a_killed_beginning_leaves_is_taken_over() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("meta")).unwrap();
        fs::write(dir.path().join("meta/.info.json#0.tmp"), "{").unwrap();
        fs::write(dir.path().join(".gitkeep"), "").unwrap();
        begin_dataset(dir.path(), &synthetic::info(7, 2, 24, 6)).unwrap();
        assert_eq!(names(&dir.path().join("meta")).unwrap().len(), 2, "info.json and shards/");
    }

    #[test]
    fn a_file_where_the_folder_should_be_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        fs::write(&file, "").unwrap();
        let error = begin_dataset(&file, &synthetic::info(7, 2, 24, 6)).unwrap_err();
        assert_eq!(error.exit_code(), ExitCode::Config);
    }
}
