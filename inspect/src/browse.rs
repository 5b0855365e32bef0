//! A dataset as a folder of pages that lead to each other: all scenes, each scene in space with the replays of its
//! attempts, the report.

use std::io::Write as _;
use std::path::Path;

use program::text::grouped;
use program::{Context, ExitCode, Failure};
use report::document::{Block, Card, Document};
use report::view::View;
use report::view::folder::{
    INDEX, LISTING, ListedAttempt, ListedScene, Listing, Place, REPORT, Shelf, is_page, scene_file, shared_files,
};
use schema::{AttemptRecord, SceneRows};
use shards::Dataset;

use crate::replay::{Replays, of_scene};
use crate::statistics::report;
use crate::view::scene_view;

/// Makes the folder, or empties one that has such pages.
fn begin(folder: &Path) -> Result<(), Failure> {
    let failed = || format!("failed to write {}", folder.display());
    std::fs::create_dir_all(folder).context(failed())?;
    let names = program::names_in(folder).context(failed())?;
    if !names.is_empty() && !names.iter().any(|name| name == LISTING) {
        let text = format!("the folder must be new, empty or one of graspmill dataset browse: {}", folder.display());
        return Err(Failure::new(ExitCode::Config, text));
    }
    // The listing first: a folder that has it may be emptied again.
    write(folder, LISTING, "")?;
    for name in names.iter().filter(|name| is_page(name)) {
        std::fs::remove_file(folder.join(name)).context(failed())?;
    }
    Ok(())
}

/// Writes the pages of these scenes, which ascend, to a new or empty folder, or over pages of an earlier call. A scene
/// at a time is in memory. Where attempts cannot be executed again, as in datasets of another engine, the pages have no
/// replays. `on_page` is called after each scene.
///
/// # Errors
/// If the folder has files of others, a scene cannot be read, or a file not written.
pub fn browse(
    dataset: &Dataset,
    scenes: &[u64],
    folder: &Path,
    has_replays: bool,
    on_page: &dyn Fn(),
) -> Result<Replays, Failure> {
    let files = scenes.iter().map(|scene| scene_file(*scene)).collect();
    let mut lists = Lists::begin(folder, Shelf::Scenes, files)?;
    let mut done = Replays::default();
    let info = dataset.info();
    let (mut cards, mut attempts) = (Vec::new(), 0);
    for of_shard in scenes.chunk_by(|a, b| info.shard_of(*a) == info.shard_of(*b)) {
        let shard = info.shard_of(of_shard[0]).unwrap_or_default();
        for rows in dataset.some_scenes(shard, of_shard.to_vec())? {
            let rows = rows?;
            let view = scene_view(info, dataset.id(), &rows);
            let replays = done.kept(|| if has_replays { of_scene(dataset, &rows, &view) } else { Ok(Vec::new()) });
            let listed = rows.attempts.iter().map(listed).collect();
            let id = rows.scene.scene_id;
            lists.add(id, format!("scene {id}"), &view, listed, replays)?;
            cards.push(card(&rows));
            attempts += rows.attempts.len();
            on_page();
        }
    }
    write(folder, REPORT, &report(dataset)?.page(dataset).html())?;
    lists.finish()?;
    write(folder, INDEX, &index(dataset, cards, attempts).html())?;
    Ok(done)
}

/// The page of all scenes.
fn index(dataset: &Dataset, cards: Vec<Card>, attempts: usize) -> Document {
    let (info, name) = (dataset.info(), dataset.location().name());
    let [scenes, of_scenes] = [cards.len() as u64, info.scene_count].map(grouped);
    let [attempts, of_attempts] = [attempts as u64, info.attempt_count].map(grouped);
    let more = if scenes == of_scenes { "" } else { " \"graspmill dataset browse --scenes N\" shows more." };
    let text = format!(
        "{scenes} of {of_scenes} scenes, with {attempts} of {of_attempts} attempts.{more} A name leads to its \
         scene, which can be turned; a grasp there leads to its replay."
    );
    let blocks = vec![
        Block::Text(text),
        Block::Links(vec![("Report: what the whole dataset holds".to_owned(), REPORT.to_owned())]),
        Block::Filter,
        Block::Gallery(cards),
    ];
    let footer = format!("graspmill dataset browse, Graspmill {}; dataset {}", env!("CARGO_PKG_VERSION"), dataset.id());
    Document { title: format!("{name}: scenes"), blocks, footer }
}

/// A scene with all its attempts, in words.
fn card(rows: &SceneRows) -> Card {
    let held = rows.attempts.iter().filter(|attempt| attempt.label() == 1).count();
    let (objects, attempts) = (rows.objects.len(), rows.attempts.len());
    Card {
        title: format!("Scene {}", grouped(rows.scene.scene_id)),
        caption: format!("{objects} object{}; {held} of {attempts} attempts held", if objects == 1 { "" } else { "s" }),
        link: scene_file(rows.scene.scene_id),
    }
}

fn listed(attempt: &AttemptRecord) -> ListedAttempt {
    let width = attempt.width_m.map_or_else(String::new, |width_m| format!(", {:.1} mm", width_m * 1000.0));
    ListedAttempt {
        attempt: attempt.attempt_id,
        id: format!("{}/{}", attempt.scene_id, attempt.attempt_id),
        outcome: attempt.outcome,
        words: format!("{} at object {}{width}", attempt.rule.name(), attempt.object_id),
    }
}

/// The pages of a folder while they are written, and the attempts on them.
pub(crate) struct Lists<'a> {
    folder: &'a Path,
    shelf: Shelf,
    files: Vec<String>,
    scenes: Vec<ListedScene>,
}

impl<'a> Lists<'a> {
    /// Makes or empties the folder of the pages with these names.
    pub(crate) fn begin(folder: &'a Path, shelf: Shelf, files: Vec<String>) -> Result<Self, Failure> {
        begin(folder)?;
        Ok(Self { folder, shelf, files, scenes: Vec::new() })
    }

    /// Writes the next page: a scene with its attempts and their replays.
    pub(crate) fn add(
        &mut self,
        id: u64,
        name: String,
        view: &View,
        attempts: Vec<ListedAttempt>,
        replays: Vec<String>,
    ) -> Result<(), Failure> {
        let rows = attempts.iter().map(|attempt| (attempt.attempt, attempt.outcome)).collect();
        let (at, file) = (self.scenes.len(), self.files[self.scenes.len()].clone());
        let place = Place {
            shelf: self.shelf,
            previous: at.checked_sub(1).map(|at| self.files[at].clone()),
            next: self.files.get(at + 1).cloned(),
            replays: attempts.iter().map(|attempt| attempt.attempt).zip(replays).collect(),
            attempts,
        };
        write(self.folder, &file, &view.page_in(&place))?;
        self.scenes.push(ListedScene { id, name, file, attempts: rows });
        Ok(())
    }

    /// Writes what the pages share.
    pub(crate) fn finish(self) -> Result<(), Failure> {
        for (name, text) in shared_files() {
            write(self.folder, name, &text)?;
        }
        write(self.folder, LISTING, &Listing { shelf: self.shelf, scenes: self.scenes }.script())
    }
}

/// Pages can be made again: they are not worth waiting for the disk.
pub(crate) fn write(folder: &Path, name: &str, text: &str) -> Result<(), Failure> {
    let path = folder.join(name);
    program::create(&path)
        .and_then(|mut file| file.write_all(text.as_bytes()))
        .context(format_args!("failed to write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    #[test]
    fn attempts_are_listed_by_what_their_rows_say() {
        let mut info = synthetic::info(5, 1, 60, 20);
        info.grid.resolution = 16;
        let scenes: Vec<SceneRows> = (0..3).map(|scene| synthetic::scene_rows(scene, info.seed, &info)).collect();
        let place = tempfile::tempdir().unwrap();
        let files = ["a", "b", "c"].map(str::to_owned).to_vec();
        let mut lists = Lists::begin(place.path(), Shelf::Scenes, files).unwrap();
        for scene in &scenes {
            let rows = scene.attempts.iter().map(listed).collect();
            lists.add(scene.scene.scene_id, String::new(), &View::new(""), rows, Vec::new()).unwrap();
        }
        for (scene, listed) in scenes.iter().zip(&lists.scenes) {
            let rows: Vec<_> = scene.attempts.iter().map(|attempt| (attempt.attempt_id, attempt.outcome)).collect();
            assert_eq!((scene.scene.scene_id, rows), (listed.id, listed.attempts.clone()));
        }
    }

    #[test]
    fn a_folder_of_others_is_left_alone_and_one_of_ours_is_emptied() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("new/pages");
        begin(&folder).unwrap();
        for name in ["scene-7.html", "notes.txt"] {
            std::fs::write(folder.join(name), "").unwrap();
        }
        begin(&folder).unwrap();
        let is_there = ["scene-7.html", "notes.txt", LISTING].map(|name| folder.join(name).exists());
        assert_eq!(is_there, [false, true, true]);
        std::fs::remove_file(folder.join(LISTING)).unwrap();
        let error = begin(&folder).unwrap_err();
        assert_eq!(error.exit_code(), ExitCode::Config);
        assert!(folder.join("notes.txt").exists());
    }
}
