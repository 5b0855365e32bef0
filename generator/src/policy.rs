//! The judge whose best grasps a dataset executes: on-policy data.

use std::sync::Arc;

use grasps::Judge;
use network::checkpoint::{Checkpoint, read_digested};
use program::Failure;
use schema::{Grid, Gripper};
use serde::{Serialize, Serializer};
use settings::{Reader, Setting, Value};

/// A judge's weights.
#[derive(Debug, Clone)]
pub struct Policy {
    checkpoint: Arc<Checkpoint>,
    /// SHA-256 of the file: a part of the dataset's identity.
    sha256: String,
}

impl Policy {
    /// The judge, prepared.
    ///
    /// # Errors
    /// If these are another network's weights, or those of a judge of another gripper or grid.
    pub(crate) fn judge(&self, gripper: &Gripper, grid: &Grid) -> Result<Judge, Failure> {
        Judge::new(&self.checkpoint, gripper, grid)
    }
}

impl PartialEq for Policy {
    fn eq(&self, other: &Self) -> bool {
        self.sha256 == other.sha256
    }
}

/// A setting that is read by its path.
impl Setting for Policy {
    type Limits = ();

    fn kind((): &()) -> String {
        "the path of a judge's weights".to_owned()
    }

    fn read(value: &Value, (): &(), reader: &mut Reader<'_>) -> Option<Self> {
        let name = String::read(value, &(), reader)?;
        let read = read_digested(&reader.folder().join(name));
        let (checkpoint, sha256) = read.map_err(|failure| reader.report(format_args!("policy: {failure}"))).ok()?;
        Some(Self { checkpoint: Arc::new(checkpoint), sha256 })
    }
}

/// Written as the digest of its file.
impl Serialize for Policy {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.sha256)
    }
}
