//! Descriptions of bodies, URDF and models of MuJoCo (MJCF). The Python package reads them and gives their meshes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use program::{ExitCode, Failure};
use serde::Deserialize;

use crate::mesh::Mesh;
use crate::mesh_file::{BYTES_MAX, ending, read_mesh, unusable};

/// What the package made of a description (`python/graspmill/formats/objects.py`).
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Described {
    /// The file of its shapes as one mesh, in its units.
    mesh: PathBuf,
    /// What it weighs, if it says so.
    pub(super) mass_kg: Option<f64>,
    /// The meshes that it names.
    pub(super) parts: Vec<PathBuf>,
    /// Why it cannot be used, and whether it is damaged.
    refused: Option<(String, bool)>,
}

impl Described {
    /// Reads what the package made of descriptions, by their paths without links.
    pub(super) fn all(path: &Path) -> Result<BTreeMap<PathBuf, Self>, Failure> {
        let refused = |what: String| unusable(format!("failed to read what was described: {what}: {}", path.display()));
        let bytes = program::read(path, BYTES_MAX).map_err(|error| refused(error.to_string()))?;
        serde_json::from_slice(&bytes).map_err(|error| refused(error.to_string()))
    }

    /// The mesh of a file; one unit is `scale_m` metres.
    pub(super) fn mesh(&self, file: &Path, scale_m: f64) -> Result<Mesh, Failure> {
        match &self.refused {
            Some((reason, is_damaged)) => {
                Err(Failure::new(if *is_damaged { ExitCode::Data } else { ExitCode::Config }, reason.clone()))
            }
            None => read_mesh(file, &self.mesh, scale_m),
        }
    }
}

/// Whether a file is a description. There are other XML files, too, so those of MuJoCo are known by their outermost
/// element.
pub(super) fn is_description(file: &Path) -> bool {
    let is_model = |bytes: Vec<u8>| {
        let root = b"<mujoco";
        bytes.windows(root.len() + 1).any(|at| at.starts_with(root) && matches!(at[root.len()], b'>' | b' ' | b'\n'))
    };
    match ending(file).as_deref() {
        Some("urdf") => true,
        Some("xml") => program::read(file, BYTES_MAX).is_ok_and(is_model),
        _ => false,
    }
}
