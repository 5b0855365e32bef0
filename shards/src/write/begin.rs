//! Begins a dataset: an empty location becomes the dataset, the same dataset is opened, and anything else is refused.

use program::{ExitCode, Failure};
use serde_json::Value;

use crate::format::layout;
use crate::store::{Patience, Storage, is_staging};
use crate::{DatasetInfo, Draft, Location, Table};

/// Maximum number of reported differences.
const DIFFERENCES_MAX: usize = 4;

impl Draft {
    /// Publishes `meta/info.json`, or finds an equal one.
    ///
    /// # Errors
    /// [`Failure`] if the info is out of range, the location contains another dataset or other files, or the storage
    /// fails.
    pub fn begin(at: impl Into<Location>, info: &DatasetInfo) -> Result<Self, Failure> {
        let problems = info.problems();
        if !problems.is_empty() {
            return Err(Failure::new(ExitCode::Config, problems.join("; ")));
        }
        Self::begin_in(Storage::open(&at.into(), Patience::Writer)?, info)
    }

    pub(crate) fn begin_in(storage: Storage, info: &DatasetInfo) -> Result<Self, Failure> {
        let refused = |text| Err(Failure::new(ExitCode::Config, text));
        let at = storage.location("");
        if let Some(dir) = storage.folder().filter(|dir| dir.is_file()) {
            return refused(format!("the dataset must go to a folder, got a file: {}", dir.display()));
        }
        let text = info.to_json();
        // Again after the look: another process may be beginning the same dataset, and publishes the info first.
        let has_info = || storage.size(layout::INFO).map(|size| size.is_some());
        if !has_info()?
            && let Some(entry) = first_foreign_entry(&storage)?
            && !has_info()?
        {
            return refused(format!("it holds {entry:?} and no {}: give an empty or a new place: {at}", layout::INFO));
        }
        if let Some(existing) = storage.publish_new(layout::INFO, text.as_bytes())?
            && existing != text.as_bytes()
        {
            let Some(differences) = differences(&existing, &text) else {
                let at = storage.location(layout::INFO);
                return Err(Failure::new(ExitCode::Data, format!("not a dataset's info; it is damaged: {at}")));
            };
            let differences = differences.join(", ");
            return refused(format!("it holds another dataset, which differs in {differences}: {at}"));
        }
        storage.check_creates_once(layout::INFO, text.as_bytes())?;
        for folder in Table::ALL.map(Table::name).into_iter().chain(["meta/shards"]) {
            storage.create_folder(folder)?;
        }
        storage.flush(&["meta", ""])?;
        Ok(Self { storage, info: info.clone(), dataset_id: info.dataset_id() })
    }
}

/// The first entry of a location that an interrupted beginning of a dataset would not have left. Hidden files and
/// `lost+found` are ignored.
fn first_foreign_entry(storage: &Storage) -> Result<Option<String>, Failure> {
    let is_foreign = |name: &String| !name.starts_with('.') && name != "lost+found" && name != "meta";
    let in_meta =
        storage.names("meta")?.into_iter().filter(|name| !is_staging(name)).map(|name| format!("meta/{name}"));
    Ok(storage.names("")?.into_iter().filter(is_foreign).chain(in_meta).min())
}

/// The differences; `None` if the existing info is damaged.
fn differences(existing: &[u8], asked: &str) -> Option<Vec<String>> {
    let existing = serde_json::from_slice::<Value>(existing).ok()?;
    let asked = serde_json::from_str(asked).unwrap_or_default();
    let mut found = program::differences("", &existing, &asked);
    if found.is_empty() {
        found.push("its spelling only: was meta/info.json edited by hand?".to_owned());
    }
    let more = found.len().saturating_sub(DIFFERENCES_MAX);
    found.truncate(DIFFERENCES_MAX);
    if more > 0 {
        found.push(format!("{more} more"));
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::*;
    use crate::synthetic;

    fn names(dir: &Path) -> Vec<String> {
        let name = |entry: std::io::Result<fs::DirEntry>| entry.unwrap().file_name().to_string_lossy().into_owned();
        fs::read_dir(dir).unwrap().map(name).collect()
    }

    #[test]
    fn the_same_dataset_may_begin_again_and_another_may_not() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("new/folder");
        let info = synthetic::info(7, 2, 24, 6);
        Draft::begin(&out, &info).unwrap();
        Draft::begin(&out, &info).unwrap();
        let mut other = synthetic::info(8, 2, 24, 6);
        other.gripper.friction = 0.5;
        let error = Draft::begin(&out, &other).unwrap_err();
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
        let error = Draft::begin(dir.path(), &synthetic::info(7, 2, 24, 6)).unwrap_err();
        assert_eq!(error.exit_code(), ExitCode::Config);
        assert!(error.to_string().contains("thesis.tex"), "{error}");
        assert_eq!(names(dir.path()), ["thesis.tex"]);
    }

    #[test]
    fn what_a_killed_beginning_leaves_is_taken_over() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("meta")).unwrap();
        fs::write(dir.path().join("meta/.info.json#host-1-a.tmp"), "{").unwrap();
        fs::write(dir.path().join(".gitkeep"), "").unwrap();
        Draft::begin(dir.path(), &synthetic::info(7, 2, 24, 6)).unwrap();
        assert_eq!(
            names(&dir.path().join("meta")).iter().filter(|name| !is_staging(name)).count(),
            2,
            "info.json, shards/"
        );
    }

    #[test]
    fn a_file_where_the_folder_should_be_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        fs::write(&file, "").unwrap();
        let error = Draft::begin(&file, &synthetic::info(7, 2, 24, 6)).unwrap_err();
        assert_eq!(error.exit_code(), ExitCode::Config);
    }
}
