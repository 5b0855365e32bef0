//! A dataset as a folder of pages that lead to each other: all scenes with filters, each scene in space with the
//! replays of its attempts, the report.

use std::collections::BTreeSet;
use std::io::Write as _;
use std::path::Path;

use program::text::grouped;
use program::{Context, ExitCode, Failure};
use report::document::{Block, Card, Document};
use report::view::View;
use report::view::folder::{
    Facet, INDEX, LISTING, ListedAttempt, ListedScene, Listing, Place, REPORT, Shelf, is_page, scene_file, shared_files,
};
use schema::{AttemptRecord, Outcome, SceneRows, Vec3};
use shards::Dataset;

use crate::replay::{Replays, of_scene};
use crate::statistics::report;
use crate::view::scene_view;

/// Degrees of a range of angles, and the ranges.
const ANGLE_DEG: f32 = 30.0;
const ANGLES: [&str; 6] = ["0 to 30°", "30 to 60°", "60 to 90°", "90 to 120°", "120 to 150°", "150 to 180°"];

/// Makes the folder, or empties one that has such pages.
fn begin(folder: &Path) -> Result<(), Failure> {
    let failed = || format!("failed to write {}", folder.display());
    std::fs::create_dir_all(folder).context(failed())?;
    let entries = std::fs::read_dir(folder).context(failed())?;
    let names = entries.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()));
    let names: BTreeSet<String> = names.collect::<std::io::Result<_>>().context(failed())?;
    if !names.is_empty() && !names.contains(LISTING) {
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
    let mut lists = Lists::begin(folder, Shelf::Scenes, &FACETS, files)?;
    let mut done = Replays::default();
    let info = dataset.info();
    let (mut cards, mut attempts) = (Vec::new(), 0);
    for of_shard in scenes.chunk_by(|a, b| info.shard_of(*a) == info.shard_of(*b)) {
        let shard = info.shard_of(of_shard[0]).unwrap_or_default();
        for rows in dataset.some_scenes(shard, of_shard.to_vec())? {
            let rows = rows?;
            let view = scene_view(info, dataset.id(), &rows);
            let replays = done.kept(|| if has_replays { of_scene(dataset, &rows, &view) } else { Ok(Vec::new()) });
            let listed = rows.attempts.iter().map(|attempt| (listed(attempt), values(&rows, attempt))).collect();
            let id = rows.scene.scene_id;
            lists.add(id, format!("scene {id}"), &view, listed, replays)?;
            cards.push(card(&rows));
            attempts += rows.attempts.len();
            on_page();
        }
    }
    write(folder, REPORT, &report(dataset)?.page(dataset).html())?;
    let facets = lists.finish()?;
    write(folder, INDEX, &index(dataset, facets, cards, attempts).html())?;
    Ok(done)
}

/// The page of all scenes.
fn index(dataset: &Dataset, facets: Vec<Facet>, cards: Vec<Card>, attempts: usize) -> Document {
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
        Block::Filter(facets),
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

/// What attempts can be chosen by, in the order of the values of [`values`], and the order of the choices where neither
/// their names nor their numbers give it.
const FACETS: [(&str, &[&str]); 5] =
    [("outcome", &[]), ("shape", &[]), ("rule", &[]), ("approach off vertical", &ANGLES), ("objects in scene", &[])];
/// The choice that is none if there are no others.
pub(crate) const UNKNOWN: &str = "not measured";

fn values(scene: &SceneRows, attempt: &AttemptRecord) -> [String; FACETS.len()] {
    let target = scene.objects.get(attempt.object_id as usize);
    let down = -(attempt.workspace_from_grasp.rotation * Vec3::Z).z;
    let angle_deg = libm::acosf(down.clamp(-1.0, 1.0)).to_degrees();
    [
        attempt.outcome.name().to_owned(),
        target.map_or_else(String::new, |object| object.shape.name().to_owned()),
        attempt.rule.name().to_owned(),
        ANGLES[((angle_deg / ANGLE_DEG) as usize).min(ANGLES.len() - 1)].to_owned(),
        scene.objects.len().to_string(),
    ]
}

/// The pages of a folder while they are written, and the attempts on them by their properties; choices are those that
/// were met, in order.
pub(crate) struct Lists<'a> {
    folder: &'a Path,
    shelf: Shelf,
    facets: &'static [(&'static str, &'static [&'static str])],
    files: Vec<String>,
    choices: Vec<Vec<String>>,
    scenes: Vec<ListedScene>,
}

impl<'a> Lists<'a> {
    /// Makes or empties the folder of the pages with these names.
    pub(crate) fn begin(
        folder: &'a Path,
        shelf: Shelf,
        facets: &'static [(&'static str, &'static [&'static str])],
        files: Vec<String>,
    ) -> Result<Self, Failure> {
        begin(folder)?;
        Ok(Self { folder, shelf, facets, files, choices: vec![Vec::new(); facets.len()], scenes: Vec::new() })
    }

    /// Writes the next page: a scene with its attempts, of each a value for each facet, and their replays.
    pub(crate) fn add<const N: usize>(
        &mut self,
        id: u64,
        name: String,
        view: &View,
        attempts: Vec<(ListedAttempt, [String; N])>,
        replays: Vec<String>,
    ) -> Result<(), Failure> {
        let mut place = |(choices, value): (&mut Vec<String>, &String)| {
            let found = choices.iter().position(|choice| choice == value);
            found.unwrap_or_else(|| (choices.push(value.clone()), choices.len() - 1).1) as u32
        };
        let mut row = |(attempt, values): &(ListedAttempt, [String; N])| {
            [attempt.attempt].into_iter().chain(self.choices.iter_mut().zip(values).map(&mut place)).collect()
        };
        let rows: Vec<Vec<u32>> = attempts.iter().map(&mut row).collect();
        let attempts: Vec<ListedAttempt> = attempts.into_iter().map(|(attempt, _)| attempt).collect();
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

    /// Writes what the pages share, and gives what can be chosen by.
    pub(crate) fn finish(self) -> Result<Vec<Facet>, Failure> {
        let folder = self.folder;
        for (name, text) in shared_files() {
            write(folder, name, &text)?;
        }
        let listing = self.listing();
        write(folder, LISTING, &listing.script())?;
        Ok(listing.facets)
    }

    /// The listing, its choices in the order in which people read them, without what nothing is known of.
    fn listing(mut self) -> Listing {
        let mut facets = Vec::new();
        for (at, ((name, order), met)) in self.facets.iter().zip(&self.choices).enumerate().rev() {
            let rows = self.scenes.iter_mut().flat_map(|scene| &mut scene.attempts);
            if met.iter().all(|choice| choice == UNKNOWN) {
                rows.for_each(|row| {
                    row.remove(at + 1);
                });
                continue;
            }
            let mut choices = met.clone();
            choices.sort_by_key(|choice| {
                let place = order.iter().position(|other| other == choice);
                (Outcome::from_name(choice), place, choice.parse::<usize>().ok(), choice.clone())
            });
            let place = |choice| choices.iter().position(|other| other == choice).unwrap_or_default() as u32;
            let places: Vec<u32> = met.iter().map(place).collect();
            rows.for_each(|row| row[at + 1] = places[row[at + 1] as usize]);
            facets.push(Facet { name: (*name).to_owned(), choices });
        }
        facets.reverse();
        Listing { shelf: self.shelf, facets, scenes: self.scenes }
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
        let mut lists = Lists::begin(place.path(), Shelf::Scenes, &FACETS, files).unwrap();
        for scene in &scenes {
            let rows = scene.attempts.iter().map(|attempt| (listed(attempt), values(scene, attempt))).collect();
            lists.add(scene.scene.scene_id, String::new(), &View::new(""), rows, Vec::new()).unwrap();
        }
        let listing = lists.listing();
        let names: Vec<&str> = listing.facets.iter().map(|facet| facet.name.as_str()).collect();
        assert_eq!(names, FACETS.map(|(name, _)| name));
        for (scene, listed) in scenes.iter().zip(&listing.scenes) {
            assert_eq!((scene.scene.scene_id, scene.attempts.len()), (listed.id, listed.attempts.len()));
            for (attempt, row) in scene.attempts.iter().zip(&listed.attempts) {
                assert_eq!(row[0], attempt.attempt_id);
                let told = |facet: usize| listing.facets[facet].choices[row[facet + 1] as usize].as_str();
                assert_eq!((told(0), told(2)), (attempt.outcome.name(), attempt.rule.name()));
                assert_eq!(told(1), scene.objects[attempt.object_id as usize].shape.name());
                assert_eq!(told(4), scene.objects.len().to_string());
            }
        }
        let outcomes = &listing.facets[0].choices;
        assert!(outcomes.iter().filter_map(|name| Outcome::from_name(name)).is_sorted(), "{outcomes:?}");
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
