//! A dataset as a folder of pages that lead to each other: all scenes with filters, each scene in space, the report;
//! and the replays that `generator` wrote there, for this crate knows no physics.

use std::collections::BTreeSet;
use std::path::Path;

use program::text::grouped;
use program::{Context, ExitCode, Failure};
use report::document::{Block, Document};
use report::view::Class;
use report::view::folder::{
    Facet, INDEX, LISTING, ListedAttempt, ListedScene, Listing, Place, REPORT, is_scene_or_replay, replay_file,
    scene_file, shared_files,
};
use schema::{AttemptRecord, Outcome, SceneRows, Vec3};
use shards::Dataset;

use crate::pictures::picture;
use crate::statistics::report;
use crate::view::{attempt_label, scene_view};

/// Degrees of a range of angles, and the ranges.
const ANGLE_DEG: f32 = 30.0;
const ANGLES: [&str; 6] = ["0 to 30°", "30 to 60°", "60 to 90°", "90 to 120°", "120 to 150°", "150 to 180°"];

/// Makes the folder, or empties one that has such pages.
///
/// # Errors
/// If it has files of others, or cannot be written.
pub fn begin_browsing(folder: &Path) -> Result<(), Failure> {
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
    for name in names.iter().filter(|name| is_scene_or_replay(name)) {
        std::fs::remove_file(folder.join(name)).context(failed())?;
    }
    Ok(())
}

/// Writes the pages of these scenes, in order. Attempts lead to their replays as far as they lie in the folder.
///
/// # Errors
/// If a scene cannot be read or a file not written.
pub fn browse(dataset: &Dataset, scenes: &[u64], folder: &Path) -> Result<(), Failure> {
    let info = dataset.info();
    let rows = scenes.iter().map(|scene| dataset.read_scene(*scene)).collect::<Result<Vec<SceneRows>, _>>()?;
    let (listing, mut pictures) = (listing(&rows), Vec::new());
    for (at, scene) in rows.iter().enumerate() {
        let view = scene_view(info, dataset.id(), scene);
        let link = |attempt: &AttemptRecord| {
            let file = replay_file(attempt.scene_id, attempt.attempt_id);
            folder.join(&file).is_file().then_some(file)
        };
        let opens = |attempt: &AttemptRecord| {
            let (class, label) = (Class::Grasp(attempt.outcome), attempt_label(attempt));
            let line = view.lines.iter().position(|line| line.class == class && line.label == label)?;
            Some((line, link(attempt)?))
        };
        let place = Place {
            previous: at.checked_sub(1).map(|before| scene_file(scenes[before])),
            next: scenes.get(at + 1).map(|scene| scene_file(*scene)),
            links: vec![("all scenes".to_owned(), INDEX.to_owned()), ("report".to_owned(), REPORT.to_owned())],
            opens: scene.attempts.iter().filter_map(opens).collect(),
            attempts: scene.attempts.iter().map(|attempt| listed(attempt, link(attempt))).collect(),
        };
        write(folder, &scene_file(scene.scene.scene_id), &view.page_in(&place))?;
        pictures.push(picture(info, scene, true));
    }
    let attempts: usize = rows.iter().map(|scene| scene.attempts.len()).sum();
    let name = dataset.location().name();
    let text = format!(
        "{} of {} scenes, with {} of {} attempts. A picture leads to its scene, which can be turned; a grasp there leads to its replay.",
        grouped(scenes.len() as u64),
        grouped(info.scene_count),
        grouped(attempts as u64),
        grouped(info.attempt_count)
    );
    let blocks = vec![
        Block::Text(text),
        Block::Links(vec![("Report: what the whole dataset holds".to_owned(), REPORT.to_owned())]),
        Block::Filter(listing.facets.clone()),
        Block::Legend(Outcome::ALL.to_vec()),
        Block::Gallery(pictures),
    ];
    let footer = format!("graspmill dataset browse, Graspmill {}; dataset {}", env!("CARGO_PKG_VERSION"), dataset.id());
    let index = Document { title: format!("{name}: scenes"), blocks, footer };
    write(folder, REPORT, &report(dataset)?.page(dataset, Some(scenes))?.html()?)?;
    for (name, text) in shared_files() {
        write(folder, name, &text)?;
    }
    write(folder, LISTING, &listing.script())?;
    write(folder, INDEX, &index.html()?)
}

fn listed(attempt: &AttemptRecord, link: Option<String>) -> ListedAttempt {
    let width = attempt.width_m.map_or_else(String::new, |width_m| format!(", {:.1} mm", width_m * 1000.0));
    ListedAttempt {
        attempt: attempt.attempt_id,
        id: format!("{}/{}", attempt.scene_id, attempt.attempt_id),
        outcome: attempt.outcome,
        words: format!("{} at object {}{width}", attempt.rule.name(), attempt.object_id),
        link,
    }
}

/// What attempts can be chosen by, in the order of the values of [`values`].
const FACETS: [&str; 5] = ["outcome", "shape", "rule", "approach off vertical", "objects in scene"];

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

/// The scenes' attempts by their properties; choices are those that there are.
fn listing(scenes: &[SceneRows]) -> Listing {
    let all = || scenes.iter().flat_map(|scene| scene.attempts.iter().map(move |attempt| values(scene, attempt)));
    let choices = |facet: usize| {
        let mut choices: Vec<String> =
            all().map(|values| values[facet].clone()).collect::<BTreeSet<_>>().into_iter().collect();
        match facet {
            0 => choices.sort_by_key(|name| Outcome::from_name(name)),
            3 => choices.sort_by_key(|name| ANGLES.iter().position(|angle| angle == name)),
            4 => choices.sort_by_key(|count| count.parse::<usize>().ok()),
            _ => {}
        }
        choices
    };
    let facet = |(at, name): (usize, &str)| Facet { name: name.to_owned(), choices: choices(at) };
    let facets: Vec<Facet> = FACETS.into_iter().enumerate().map(facet).collect();
    let place = |facet: &Facet, value: &String| {
        facet.choices.iter().position(|choice| choice == value).unwrap_or_default() as u32
    };
    let listed = |scene: &SceneRows| {
        let row = |attempt: &AttemptRecord| {
            let values = values(scene, attempt);
            let places = facets.iter().zip(&values).map(|(facet, value)| place(facet, value));
            [attempt.attempt_id].into_iter().chain(places).collect()
        };
        ListedScene { id: scene.scene.scene_id, attempts: scene.attempts.iter().map(row).collect() }
    };
    Listing { scenes: scenes.iter().map(listed).collect(), facets }
}

/// Pages can be made again: they are not worth waiting for the disk.
fn write(folder: &Path, name: &str, text: &str) -> Result<(), Failure> {
    let path = folder.join(name);
    std::fs::write(&path, text).context(format_args!("failed to write {}", path.display()))
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
        let listing = listing(&scenes);
        let names: Vec<&str> = listing.facets.iter().map(|facet| facet.name.as_str()).collect();
        assert_eq!(names, FACETS);
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
        begin_browsing(&folder).unwrap();
        for name in ["scene-7.html", "replay-7-1.html", "notes.txt"] {
            std::fs::write(folder.join(name), "").unwrap();
        }
        begin_browsing(&folder).unwrap();
        let is_there = ["scene-7.html", "replay-7-1.html", "notes.txt", LISTING].map(|name| folder.join(name).exists());
        assert_eq!(is_there, [false, false, true, true]);
        std::fs::remove_file(folder.join(LISTING)).unwrap();
        let error = begin_browsing(&folder).unwrap_err();
        assert_eq!(error.exit_code(), ExitCode::Config);
        assert!(folder.join("notes.txt").exists());
    }
}
