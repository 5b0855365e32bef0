//! What an import makes objects of: meshes and robot descriptions, found in folders, each with a name of its own.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use program::Failure;
use schema::NAME_MAX;

use super::described::{Described, is_description};
use crate::mesh_file::{ENDINGS, ending, unusable};

/// Folders within folders, at most.
const DEPTH_MAX: usize = 16;

/// What becomes an object.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// The object's name.
    pub name: String,
    /// A mesh or a description.
    pub file: PathBuf,
    /// What the Python package made of a description.
    pub(super) described: Option<Described>,
}

/// The objects of some paths: files as given, and what is in folders and the folders within them, in the order of their
/// paths. A mesh that a description names is a part of it and no object of its own. Files of one name in several
/// folders are named by what tells the folders apart. `described` is the file in which the Python package says what it
/// made of descriptions.
///
/// # Errors
/// For a folder that cannot be listed, or that has nothing to import.
pub fn sources(paths: &[PathBuf], described: Option<&Path>) -> Result<Vec<Source>, Failure> {
    let described = described.map(Described::all).transpose()?.unwrap_or_default();
    let of = |file: &Path| described.get(&file.canonicalize().ok()?);
    let mut found: Vec<(PathBuf, Vec<String>)> = Vec::new();
    for path in paths {
        let mut seen = BTreeSet::new();
        if !path.is_dir() {
            found.push((path.clone(), Vec::new()));
            continue;
        }
        let before = found.len();
        list(path, &mut Vec::new(), &mut seen, &mut found)?;
        if found.len() == before {
            let endings = ENDINGS.join(", .");
            return Err(unusable(format!("there is no .{endings}, .urdf or MuJoCo .xml file: {}", path.display())));
        }
    }
    let parts: BTreeSet<&PathBuf> = found.iter().filter_map(|(file, _)| of(file)).flat_map(|one| &one.parts).collect();
    found.retain(|(file, _)| !file.canonicalize().is_ok_and(|file| parts.contains(&file)));
    let named = named(one_format(found)).into_iter();
    Ok(named.map(|(name, file)| Source { name, described: of(&file).cloned(), file }).collect())
}

/// Of the files of a folder that have one name but for the ending, the one that comes first in [`ENDINGS`]: they are
/// the same mesh in several formats.
fn one_format(found: Vec<(PathBuf, Vec<String>)>) -> Vec<(PathBuf, Vec<String>)> {
    let place = |file: &Path| ENDINGS.iter().position(|one| ending(file).as_deref() == Some(one));
    let mut first: BTreeMap<PathBuf, usize> = BTreeMap::new();
    for (file, place) in found.iter().filter_map(|(file, _)| Some((file, place(file)?))) {
        let first = first.entry(file.with_extension("")).or_insert(place);
        *first = place.min(*first);
    }
    let is_chosen = |(file, _): &(PathBuf, Vec<String>)| {
        let first =
            first.get(&file.with_extension("")).filter(|first| place(file).is_some_and(|place| place > **first));
        if let Some(first) = first {
            tracing::warn!("its .{} is imported, not {}", ENDINGS[*first], file.display());
        }
        first.is_none()
    };
    found.into_iter().filter(is_chosen).collect()
}

/// Adds the files below a folder, each with the names of the folders on the way to it. A folder that links lead to
/// again is listed once.
fn list(
    folder: &Path,
    way: &mut Vec<String>,
    seen: &mut BTreeSet<PathBuf>,
    found: &mut Vec<(PathBuf, Vec<String>)>,
) -> Result<(), Failure> {
    let unlisted = |error| unusable(format!("failed to list the folder: {error}: {}", folder.display()));
    if !seen.insert(folder.canonicalize().map_err(unlisted)?) {
        return Ok(());
    }
    let entries = std::fs::read_dir(folder).map_err(unlisted)?.collect::<Result<Vec<_>, _>>().map_err(unlisted)?;
    let mut entries: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).collect();
    entries.sort();
    for entry in entries {
        let name = entry.file_name().map_or_else(Default::default, |name| plain(&name.to_string_lossy()));
        if entry.is_dir() {
            if way.len() < DEPTH_MAX {
                way.push(name);
                list(&entry, way, seen, found)?;
                way.pop();
            }
        } else if is_description(&entry) || ending(&entry).is_some_and(|ending| ENDINGS.contains(&ending.as_str())) {
            found.push((entry, way.clone()));
        }
    }
    Ok(())
}

/// Gives every file a name. Of a name that several files would have, each takes the name of its folder, without the
/// folders that all of them have, as long as necessary; then a number.
fn named(found: Vec<(PathBuf, Vec<String>)>) -> Vec<(String, PathBuf)> {
    let stem = |file: &Path| plain(&file.file_stem().map_or_else(Default::default, |stem| stem.to_string_lossy()));
    let mut ways: BTreeMap<String, Vec<Vec<String>>> = BTreeMap::new();
    for (file, way) in &found {
        ways.entry(stem(file)).or_default().push(way.clone());
    }
    let base = |(file, way): &(PathBuf, Vec<String>)| {
        let stem = stem(file);
        if ways[&stem].len() == 1 { stem } else { by_folder(&stem, way, &ways[&stem]) }
    };
    // A folder of many such files is no name for any of them.
    let mut stems: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for one in &found {
        stems.entry(base(one)).or_default().insert(stem(&one.0));
    }
    let mut taken = BTreeSet::new();
    let mut all = Vec::with_capacity(found.len());
    for one in &found {
        let (stem, base) = (stem(&one.0), base(one));
        let base = if stems[&base].len() > 1 && base != stem { format!("{base}_{stem}") } else { base };
        // The end of a name tells more than its beginning.
        let cut = |text: &str, most: usize| text[text.len().saturating_sub(most)..].to_owned();
        let mut name = cut(&base, NAME_MAX);
        for number in 2_usize.. {
            if taken.insert(name.clone()) {
                break;
            }
            let suffix = format!("_{number}");
            name = cut(&base, NAME_MAX - suffix.len()) + &suffix;
        }
        all.push((name, one.0.clone()));
    }
    all
}

/// The name of a file by the folders on its way, where files at `all` ways have the same `stem`.
fn by_folder(stem: &str, way: &[String], all: &[Vec<String>]) -> String {
    let shared = (1..).take_while(|n| all.iter().all(|other| other.len() >= *n && ends(other, *n) == ends(way, *n)));
    let kept = |way: &[String], shared: usize| way[..way.len().saturating_sub(shared)].to_vec();
    let shared = shared.last().unwrap_or(0);
    let (own, others) = (kept(way, shared), all.iter().map(|other| kept(other, shared)).collect::<Vec<_>>());
    for count in 1..=own.len() {
        if others.iter().filter(|other| ends(other, count) == ends(&own, count)).count() == 1 {
            return ends(&own, count).join("_");
        }
    }
    stem.to_owned()
}

/// The last folders of a way.
fn ends(way: &[String], count: usize) -> &[String] {
    &way[way.len().saturating_sub(count)..]
}

/// A name of characters that need no quotes in a table or a query.
fn plain(name: &str) -> String {
    name.to_ascii_lowercase().chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(files: &[&str]) -> Vec<String> {
        let way = |file: &str| file.split('/').rev().skip(1).map(plain).collect::<Vec<_>>().into_iter().rev().collect();
        let found = files.iter().map(|file| (PathBuf::from(file), way(file))).collect();
        named(found).into_iter().map(|(name, _)| name).collect()
    }

    #[test]
    fn files_of_one_name_are_named_by_their_folders() {
        let ycb = ["002_chef_can/google_16k/textured.obj", "025_mug/google_16k/textured.obj"];
        assert_eq!(names(&ycb), ["002_chef_can", "025_mug"]);
        assert_eq!(names(&["a/x/m.obj", "b/x/m.obj", "a/y/m.obj"]), ["a_x", "b_x", "y"]);
        assert_eq!(names(&["a/bowl.obj", "b/Cup 1.obj"]), ["bowl", "cup_1"]);
        assert_eq!(names(&["a/mesh.obj", "mesh.obj"]), ["a", "mesh"]);
        assert_eq!(
            names(&["can.xml", "milk.xml", "meshes/can.obj", "meshes/milk.obj", "meshes/nut.obj"]),
            ["can", "milk", "meshes_can", "meshes_milk", "nut"]
        );
    }

    #[test]
    fn a_mesh_in_several_formats_is_one_object() {
        let found = ["a/can.stl", "a/can.obj", "a/can.xml", "b/can.ply", "a/can.1.obj"];
        let left = one_format(found.map(|file| (PathBuf::from(file), Vec::new())).to_vec());
        let left: Vec<&Path> = left.iter().map(|(file, _)| file.as_path()).collect();
        assert_eq!(left, ["a/can.obj", "a/can.xml", "b/can.ply", "a/can.1.obj"].map(Path::new));
    }

    #[test]
    fn no_two_objects_have_one_name_and_none_is_too_long() {
        assert_eq!(
            names(&["Cube.obj", "CUBE.obj", "cube.stl", "cube_2.obj"]),
            ["cube", "cube_2", "cube_3", "cube_2_2"]
        );
        let long = "x".repeat(60) + ".obj";
        let got = names(&[&long, &long.to_uppercase()]);
        assert!(got.iter().all(|name| name.len() == NAME_MAX) && got[0] != got[1], "{got:?}");
    }
}
