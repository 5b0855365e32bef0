//! The objects to be annotated: of meshes, descriptions and catalogues.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use network::checkpoint::digest;
use program::{ExitCode, Failure, unread};
use schema::Vec3;

use super::params::Annotated;
use crate::catalogue::Catalogue;
use crate::import::{ImportParams, LeftOut, import_objects, sources};
use crate::mesh_file::BYTES_MAX;

impl Annotated {
    /// The objects of some paths, catalogues (`.toml`) first, and the files that could not be used. Grasps of a mesh
    /// are given in the mesh's own frame, in metres; those of a catalogue's object in the frame of the catalogue's
    /// numbers. `check` may refuse a mesh by its object's name before any mesh is read.
    ///
    /// # Errors
    /// If nothing can be used, a catalogue is wrong, two objects have one name, or a name cannot name a file.
    pub fn read(
        paths: &[PathBuf],
        params: &ImportParams,
        check: &dyn Fn(&str) -> Result<(), Failure>,
        on_file: &(dyn Fn(&Path, Option<&str>) + Sync),
    ) -> Result<(Vec<Self>, Vec<LeftOut>), Failure> {
        let is_catalogue = |path: &&PathBuf| path.extension().is_some_and(|ending| ending == "toml");
        let (catalogues, meshes): (Vec<&PathBuf>, Vec<&PathBuf>) = paths.iter().partition(is_catalogue);
        let (mut objects, mut left_out) = (Vec::new(), Vec::new());
        for path in catalogues {
            let catalogue = Catalogue::read(path).map_err(refused)?;
            objects.extend(catalogue.objects().iter().map(|object| Self {
                object: object.clone(),
                file: path.display().to_string(),
                file_sha256: None,
                scale_m: 1.0,
                origin_m: object.origin_m,
                warnings: Vec::new(),
            }));
        }
        if !meshes.is_empty() {
            let meshes: Vec<PathBuf> = meshes.into_iter().cloned().collect();
            let sources = sources(&meshes, params.described.as_deref())?;
            sources.iter().try_for_each(|source| check(&source.name))?;
            let imported = import_objects(&sources, params, on_file)?;
            let broken = |text: String| Failure::new(ExitCode::Internal, text);
            let catalogue = Catalogue::parse(&imported.catalogue, Path::new("the imported objects")).map_err(broken)?;
            for (of_file, object) in imported.objects.iter().zip(catalogue.objects()) {
                let bytes = program::read(&of_file.file, BYTES_MAX).map_err(|error| unread(&of_file.file, &error))?;
                objects.push(Self {
                    object: object.clone(),
                    file: of_file.file.display().to_string(),
                    file_sha256: Some(digest(&bytes)),
                    scale_m: of_file.scale_m,
                    origin_m: object.origin_m + Vec3::from_array(of_file.middle_m.map(|m| m as f32)),
                    warnings: of_file.guesses.iter().chain(&of_file.warnings).cloned().collect(),
                });
            }
            left_out = imported.left_out;
        }
        check_names(&objects)?;
        Ok((objects, left_out))
    }
}

fn refused(text: String) -> Failure {
    Failure::new(ExitCode::Config, text)
}

fn check_names(objects: &[Annotated]) -> Result<(), Failure> {
    let mut names = BTreeSet::new();
    for object in objects {
        let name = object.object.body.name();
        let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
        if !name.chars().all(is_plain) {
            let rule = "an object's name must have letters, digits, _, - and ., to name files";
            return Err(refused(format!("{rule}, got {name:?}: {}", object.file)));
        }
        if !names.insert(name) {
            let text = format!("objects must have different names, to name files; two are called {name}");
            return Err(refused(text));
        }
    }
    Ok(())
}
