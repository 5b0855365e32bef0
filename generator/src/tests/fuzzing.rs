//! The functions of the fuzz targets `generator_config` and `objects`, and tests that replay their seeds and past
//! findings. They must return for any bytes, and an accepted config must give a readable dataset.

use std::path::Path;

use schema::{Gripper, Physics};
use settings::Document;
use shards::DatasetInfo;

use crate::dataset_info::physics_of;
use crate::measured::Measured;
use crate::mesh::Mesh;
use crate::mesh_file::READERS;
use crate::{Config, Overrides};

/// The text of a config, a NUL, the text of a gripper's file.
///
/// # Errors
/// What is wrong with the texts.
///
/// # Panics
/// If a config is accepted whose dataset would be refused.
pub fn config(data: &[u8]) -> Result<(), String> {
    let mut parts = data.split(|byte| *byte == 0).map(String::from_utf8_lossy);
    let mut next = || parts.next().unwrap_or_default();
    let config = Document::parse(&next(), Path::new("fuzzed"))
        .and_then(|document| Config::read(document, Overrides::default()))
        .map_err(|e| e.to_string());
    let gripper = Gripper::from_toml(&next()).map_err(|e| e.to_string());
    let infos: Vec<DatasetInfo> = config.iter().map(Config::dataset_info).collect();
    let with_gripper =
        infos.iter().zip(&gripper).map(|(info, gripper)| DatasetInfo { gripper: gripper.clone(), ..info.clone() });
    for info in infos.iter().cloned().chain(with_gripper) {
        let back = DatasetInfo::from_json(info.to_json());
        assert_eq!(back.map(as_used), Ok(as_used(info)), "an accepted config makes what can be read");
    }
    config.and(gripper).map(drop)
}

/// A byte that chooses the kind of file (OBJ, STL, PLY, GLB), then the file.
///
/// # Errors
/// What is wrong with the file.
///
/// # Panics
/// If what is measured of it cannot be.
pub fn object(data: &[u8]) -> Result<(), String> {
    let (kind, bytes) = data.split_first().ok_or("it is empty")?;
    let (corners, triangles) = READERS[usize::from(*kind) % READERS.len()](bytes)?;
    let measured = Measured::of(Mesh::new(&corners, &triangles, 1.0)?);
    assert!(measured.solid.is_none_or(|solid| solid.volume_m3 > 0.0), "what encloses nothing is no solid");
    Ok(())
}

/// An info, and of its laws, whose numbers may change in their last digit when they are read, what [`crate::repeat`]
/// takes from them.
fn as_used(info: DatasetInfo) -> (DatasetInfo, Result<Physics, String>) {
    let physics = physics_of(&info.config).map_err(|e| e.to_string());
    (DatasetInfo { config: serde_json::Value::Null, ..info }, physics)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    const CONFIGS: [&str; 3] =
        ["configs/generate/paper.toml", "configs/generate/demo.toml", "scripts/crosscheck/coulomb.toml"];

    /// The seeds and past findings of a target by name.
    fn seeds(target: &str) -> Vec<(String, Vec<u8>)> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds").join(target);
        let mut paths: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
        paths.into_iter().map(|path| (name(&path), fs::read(&path).unwrap())).collect()
    }

    /// Seeds named `whole-…` are accepted.
    #[test]
    fn seeds_and_past_findings_of_the_config_are_survived() {
        for (name, bytes) in seeds("generator_config") {
            let result = config(&bytes);
            assert_eq!(result.is_ok(), name.starts_with("whole-"), "{name}: {result:?}");
        }
    }

    /// Also those of objects, and each of them cut off, and with bytes changed.
    #[test]
    fn seeds_of_objects_are_survived_whatever_is_changed_in_them() {
        let all = seeds("objects");
        assert!(all.len() >= 5);
        for (name, bytes) in all {
            let result = object(&bytes);
            assert_eq!(result.is_ok(), name.starts_with("whole-"), "{name}: {result:?}");
            for place in (1..bytes.len()).step_by(bytes.len() / 60 + 1) {
                let _ = object(&bytes[..place]); // an error is an answer
                for value in [0, b'9', 0x7f, 0xff] {
                    let mut changed = bytes.clone();
                    changed[place] = value;
                    let _ = object(&changed);
                }
            }
        }
    }

    /// Writes the seeds again: `cargo test --workspace write_the_seeds -- --ignored`.
    #[test]
    #[ignore = "writes fuzz/seeds"]
    fn write_the_seeds() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds/generator_config");
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let gripper = fs::read_to_string(root.join("configs/grippers/parallel_jaw_80.toml")).unwrap();
        for path in CONFIGS.map(|path| root.join(path)) {
            let (name, text) = (path.file_stem().unwrap().to_string_lossy(), fs::read_to_string(&path).unwrap());
            fs::write(folder.join(format!("whole-{name}")), format!("{text}\0{gripper}")).unwrap();
        }
    }
}
