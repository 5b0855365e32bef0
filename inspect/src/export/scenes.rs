//! Scenes for simulators: a folder a scene, which needs no other file.
//!
//! ```text
//! scene-000000017/scene.json                      plain numbers: poses, masses, cameras, the hand, the attempts
//!                 scene.xml, hand.xml             MJCF
//!                 NAME.urdf, meshes/NAME.obj      URDF: the table, the container, every object, the hand
//!                 scene.usda, hand.usda           USD
//! ```
//!
//! Objects have the convex parts of our physics; a dataset does not keep the meshes from which they were made.

mod description;
mod mjcf;
mod urdf;
mod usda;
mod world;

use std::fs;
use std::io::{self, ErrorKind};
use std::path::Path;

use program::{Context, ExitCode, Failure};
use schema::SceneRows;
use settings::words;
use shards::{Dataset, DatasetInfo};

use super::{ExportCounts, ExportOrigin, SceneSelection, failed, part};
use world::World;

/// The folders of an export, in which its files lie.
pub(super) const FOLDERS: [&str; 1] = [""];

words! {
    /// What a simulator reads.
    pub enum SceneFormat {
        /// MuJoCo's XML.
        Mjcf = "mjcf",
        /// URDF, with the poses in `scene.json`.
        Urdf = "urdf",
        /// USD as text, with UsdPhysics.
        Usda = "usda",
    }
}

/// Writes a scene's files into a folder, which is made if it does not exist. Files of the same names are replaced.
///
/// # Errors
/// [`Failure`] if the folder is a file, or a file cannot be written.
pub fn export_scene(
    info: &DatasetInfo,
    dataset_id: &str,
    rows: &SceneRows,
    format: SceneFormat,
    folder: &Path,
) -> Result<(), Failure> {
    if folder.is_file() {
        let text = format!("the scene must go to a folder, got a file: {}", folder.display());
        return Err(Failure::new(ExitCode::Config, text));
    }
    let world = World::new(info, dataset_id, rows);
    let mut files = match format {
        SceneFormat::Mjcf => of_two("xml", mjcf::scene(&world), mjcf::hand(world.hand)),
        SceneFormat::Urdf => urdf::files(&world),
        SceneFormat::Usda => of_two("usda", usda::scene(&world), usda::hand(world.hand)),
    };
    files.push(("scene.json".to_owned(), description::json(&world)?));
    let folders = [folder.to_owned(), folder.join(urdf::MESHES)];
    let needed = if files.iter().any(|(name, _)| name.starts_with(urdf::MESHES)) { 2 } else { 1 };
    for folder in &folders[..needed] {
        fs::create_dir_all(folder).context(format_args!("failed to make the folder {}", folder.display()))?;
    }
    files.iter().try_for_each(|(name, text)| program::write(&folder.join(name), text))
}

fn of_two(ending: &str, scene: String, hand: String) -> Vec<(String, String)> {
    vec![(format!("scene.{ending}"), scene), (format!("hand.{ending}"), hand)]
}

/// Writes everything but `export.json`, and of the scenes those that are not there.
pub(super) fn write(
    dataset: &Dataset,
    format: SceneFormat,
    selection: Option<&SceneSelection>,
    folder: &Path,
    origin: &ExportOrigin,
    scenes_done: &mut dyn FnMut(u64),
) -> Result<ExportCounts, Failure> {
    let info = dataset.info();
    let is_wanted = |scene_id: u64| selection.is_none_or(|selection| selection.has(scene_id));
    let mut counts = ExportCounts::default();
    for shard in 0..dataset.shard_count() {
        if !info.scenes_of(shard).any(is_wanted) {
            continue;
        }
        for rows in dataset.rows(shard)? {
            let rows = rows?;
            if !is_wanted(rows.scene.scene_id) {
                continue;
            }
            let path = folder.join(format!("scene-{:09}", rows.scene.scene_id));
            if !path.is_dir() {
                let unfinished = part(&path);
                remove(&unfinished).context(failed(&unfinished))?;
                export_scene(info, dataset.id(), &rows, format, &unfinished)?;
                fs::rename(&unfinished, &path).context(failed(&path))?;
            }
            counts.scenes += 1;
            counts.grasps += rows.attempts.len() as u64;
            counts.positives += rows.attempts.iter().map(|attempt| u64::from(attempt.label())).sum::<u64>();
            scenes_done(1);
        }
    }
    counts.attempts = counts.grasps;
    program::write(&folder.join("README.md"), page(origin, format))?;
    Ok(counts)
}

/// Removes what a killed run left of a scene.
fn remove(folder: &Path) -> io::Result<()> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        removed => removed,
    }
}

fn page(origin: &ExportOrigin, format: SceneFormat) -> String {
    let ExportOrigin { exporter_version, dataset_id, dataset_code_version, dataset_seed, .. } = origin;
    let how = match format {
        SceneFormat::Mjcf => {
            "`scene.xml` is a model for MuJoCo: `mujoco.MjModel.from_xml_path(\"scene.xml\")`. `hand.xml` is the hand, in its \
             grasp frame;\nvelocities of its two actuators close it."
        }
        SceneFormat::Urdf => {
            "`table.urdf` and `container.urdf` are in the workspace's frame and stand still. `object_N.urdf` goes to the pose\n\
             `workspace_from_object` of `scene.json`, `hand.urdf` to a `workspace_from_grasp`."
        }
        SceneFormat::Usda => {
            "`scene.usda` is a stage with UsdPhysics: metres, kilograms, z up. `hand.usda` is the hand, in its grasp frame."
        }
    };
    format!(
        "# Grasp scenes as {name}

Exported by Graspmill {exporter_version} from dataset `{dataset_id}` (made by {dataset_code_version} from seed {dataset_seed}).

A folder a scene, which needs no other file. Objects are at rest, of the convex parts of the simulation that made the labels.

{how}

`scene.json` has poses, masses, frictions, inertias, cameras, the hand and the attempts with their outcomes, as numbers.
",
        name = format.name().to_uppercase(),
    )
}
