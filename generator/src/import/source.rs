//! What an import makes objects of: meshes and robot descriptions, found in folders, each with a name of its own.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf, absolute};

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
/// paths, each once. A mesh that a description names is a part of it and no object of its own. Files of one name in
/// several folders are named by what tells the folders apart, whatever the order of the paths. `described` is the file
/// in which the Python package says what it made of descriptions.
///
/// # Errors
/// For a folder that cannot be listed, or that has nothing to import.
pub fn sources(paths: &[PathBuf], described: Option<&Path>) -> Result<Vec<Source>, Failure> {
    let described = described.map(Described::all).transpose()?.unwrap_or_default();
    let of = |file: &Path| described.get(&file.canonicalize().ok()?);
    let mut found: Vec<PathBuf> = Vec::new();
    for path in paths {
        if !path.is_dir() {
            found.push(path.clone());
            continue;
        }
        let before = found.len();
        list(path, 0, &mut BTreeSet::new(), &mut found)?;
        if found.len() == before {
            let endings = ENDINGS.join(", .");
            return Err(unusable(format!("there is no .{endings}, .urdf or MuJoCo .xml file: {}", path.display())));
        }
    }
    let parts: BTreeSet<&PathBuf> = found.iter().filter_map(|file| of(file)).flat_map(|one| &one.parts).collect();
    found.retain(|file| !file.canonicalize().is_ok_and(|file| parts.contains(&file)));
    let mut once = BTreeSet::new();
    found.retain(|file| once.insert(whole(file)));
    let below = |file: PathBuf| {
        let mut way = way(&file);
        way.pop();
        (file, way)
    };
    let named = named(one_format(found).into_iter().map(below).collect()).into_iter();
    Ok(named.map(|(name, file)| Source { name, described: of(&file).cloned(), file }).collect())
}

/// Of the files of a folder that have one name but for the ending, the one that comes first in [`ENDINGS`]: they are
/// the same mesh in several formats.
fn one_format(found: Vec<PathBuf>) -> Vec<PathBuf> {
    let place = |file: &Path| ENDINGS.iter().position(|one| ending(file).as_deref() == Some(one));
    let mut first: BTreeMap<PathBuf, usize> = BTreeMap::new();
    for (file, place) in found.iter().filter_map(|file| Some((file, place(file)?))) {
        let first = first.entry(file.with_extension("")).or_insert(place);
        *first = place.min(*first);
    }
    let is_chosen = |file: &PathBuf| {
        let first =
            first.get(&file.with_extension("")).filter(|first| place(file).is_some_and(|place| place > **first));
        if let Some(first) = first {
            tracing::warn!("its .{} is imported, not {}", ENDINGS[*first], file.display());
        }
        first.is_none()
    };
    found.into_iter().filter(is_chosen).collect()
}

/// Adds the files below a folder, which is so deep in the one that was given. A folder that links lead to again is
/// listed once.
fn list(folder: &Path, depth: usize, seen: &mut BTreeSet<PathBuf>, found: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let unlisted = |error| unusable(format!("failed to list the folder: {error}: {}", folder.display()));
    if !seen.insert(folder.canonicalize().map_err(unlisted)?) {
        return Ok(());
    }
    let entries = std::fs::read_dir(folder).map_err(unlisted)?.collect::<Result<Vec<_>, _>>().map_err(unlisted)?;
    let mut entries: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).collect();
    entries.sort();
    for entry in entries {
        if entry.is_dir() {
            if depth < DEPTH_MAX {
                list(&entry, depth + 1, seen, found)?;
            }
        } else if is_description(&entry) || ending(&entry).is_some_and(|ending| ENDINGS.contains(&ending.as_str())) {
            found.push(entry);
        }
    }
    Ok(())
}

/// A path from the root.
fn whole(path: &Path) -> PathBuf {
    absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// The names on the way from the root to a file or folder, and its own.
fn way(path: &Path) -> Vec<String> {
    let mut way = Vec::new();
    for part in whole(path).components() {
        match part {
            Component::Normal(name) => way.push(plain(&name.to_string_lossy())),
            Component::ParentDir => way.truncate(way.len().saturating_sub(1)),
            _ => {}
        }
    }
    way
}

/// Gives every file a name. Before a name that files in several folders would have come the folders that not all of
/// them have; they stand alone if it is the only such name. Then a number. Capital letters make no other name: not
/// every disk tells such files apart.
fn named(found: Vec<(PathBuf, Vec<String>)>) -> Vec<(String, PathBuf)> {
    let stem = |file: &Path| plain(&file.file_stem().map_or_else(Default::default, |stem| stem.to_string_lossy()));
    let small = |name: &str| name.to_ascii_lowercase();
    let mut ways: BTreeMap<String, BTreeSet<Vec<String>>> = BTreeMap::new();
    for (file, way) in &found {
        ways.entry(small(&stem(file))).or_default().insert(way.clone());
    }
    let is_one = ways.values().filter(|all| all.len() > 1).count() == 1;
    let base = |(file, way): &(PathBuf, Vec<String>)| {
        let stem = stem(file);
        match folders(way, &ways[&small(&stem)]) {
            folders if folders.is_empty() => stem,
            folders if is_one => folders,
            folders => format!("{folders}_{stem}"),
        }
    };
    let mut order: Vec<usize> = (0..found.len()).collect();
    order.sort_by_cached_key(|place| whole(&found[*place].0));
    let (mut taken, mut names) = (BTreeSet::new(), vec![String::new(); found.len()]);
    for place in order {
        let base = base(&found[place]);
        // The end of a name tells more than its beginning.
        let cut = |text: &str, most: usize| text[text.len().saturating_sub(most)..].to_owned();
        let mut name = cut(&base, NAME_MAX);
        for number in 2_usize.. {
            if taken.insert(small(&name)) {
                break;
            }
            let suffix = format!("_{number}");
            name = cut(&base, NAME_MAX - suffix.len()) + &suffix;
        }
        names[place] = name;
    }
    names.into_iter().zip(found.into_iter().map(|(file, _)| file)).collect()
}

/// The folders on a way, without those that all of some ways have at their beginning or at their end.
fn folders(way: &[String], all: &BTreeSet<Vec<String>>) -> String {
    let begin = (0..way.len()).take_while(|n| all.iter().all(|other| other.get(*n) == way.get(*n))).count();
    let ends = |n: &usize| all.iter().all(|other| other[begin..].ends_with(&way[way.len() - n..]));
    let end = (1..=way.len() - begin).take_while(ends).count();
    way[begin..way.len() - end].join("_")
}

/// A name of characters that need no quotes as a key of a table.
fn plain(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' }).collect()
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
        assert_eq!(names(&["a/x/m.obj", "b/x/m.obj", "a/y/m.obj"]), ["a_x", "b_x", "a_y"]);
        assert_eq!(names(&["a/bowl.obj", "b/Cup 1.obj", "c/plate-A.obj"]), ["bowl", "Cup_1", "plate-A"]);
        assert_eq!(names(&["a/mesh.obj", "mesh.obj"]), ["a", "mesh"]);
        assert_eq!(
            names(&["can.xml", "milk.xml", "meshes/can.obj", "meshes/milk.obj", "meshes/nut.obj"]),
            ["can", "milk", "meshes_can", "meshes_milk", "nut"]
        );
        assert_eq!(names(&["a/can.obj", "b/can.obj", "b/can.xml"]), ["a", "b", "b_2"]);
    }

    #[test]
    fn files_of_a_glob_are_named_as_those_of_the_folder_above_whatever_their_order() {
        let place = tempfile::tempdir().unwrap();
        let [mug, spoon] = ["Mug", "spoon"].map(|name| place.path().join(name));
        let [of_mug, of_spoon] = [&mug, &spoon].map(|folder| folder.join("textured.obj"));
        for (folder, file) in [(&mug, &of_mug), (&spoon, &of_spoon)] {
            std::fs::create_dir(folder).unwrap();
            std::fs::write(file, "").unwrap();
        }
        let again = spoon.join("../Mug/./textured.obj");
        let above = place.path().to_owned();
        for (given, expected) in [
            (vec![above], ["Mug", "spoon"]),
            (vec![mug, spoon.clone()], ["Mug", "spoon"]),
            (vec![of_mug.clone(), of_spoon.clone(), of_mug.clone()], ["Mug", "spoon"]),
            (vec![of_spoon, of_mug], ["spoon", "Mug"]),
            (vec![again, spoon], ["Mug", "spoon"]),
        ] {
            let found: Vec<String> = sources(&given, None).unwrap().into_iter().map(|source| source.name).collect();
            assert_eq!(found, expected, "{given:?}");
        }
    }

    #[test]
    fn a_mesh_in_several_formats_is_one_object() {
        let found = ["a/can.stl", "a/can.obj", "a/can.xml", "b/can.ply", "a/can.1.obj"];
        let left = one_format(found.map(PathBuf::from).to_vec());
        assert_eq!(left, ["a/can.obj", "a/can.xml", "b/can.ply", "a/can.1.obj"].map(Path::new));
    }

    #[test]
    fn no_two_objects_have_one_name_and_none_is_too_long() {
        // Not even on a disk that takes capital letters for small ones; numbers follow the paths, in whatever order.
        let files = ["Cube.obj", "CUBE.obj", "cube.stl", "cube_2.obj"];
        assert_eq!(names(&files), ["Cube_2", "CUBE", "cube_3", "cube_2_2"]);
        let [a, b, c, d] = files;
        assert_eq!(names(&[d, c, b, a]), ["cube_2_2", "cube_3", "CUBE", "Cube_2"]);
        let long = "x".repeat(60) + ".obj";
        let got = names(&[&long, &long.to_uppercase()]);
        assert!(got.iter().all(|name| name.len() == NAME_MAX) && got[0] != got[1], "{got:?}");
    }
}
