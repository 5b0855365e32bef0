//! Grasps that are there to be labelled again: poses, and labels if they have some.

use std::collections::BTreeMap;
use std::path::Path;

use program::{Context as _, ExitCode, Failure};
use schema::{ObjectGrasps, Outcome, Pose};
use serde_json::{Value, json};
use shards::{PlainColumn, read_plain_table};

use super::stored::{GRASPS_MAX, poses};

/// The grasps of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct GivenGrasps {
    /// In the object's frame; the grasp's has +z approach, +y closing, its origin midway between the tips.
    pub object_from_grasps: Vec<Pose>,
    /// Whether each held, if the file says so.
    pub held: Option<Vec<bool>>,
}

impl GivenGrasps {
    /// Reads the poses of a table as `graspmill objects annotate` writes it, and its labels if it has them. The package
    /// makes such a table of the files of others.
    ///
    /// # Errors
    /// [`Failure`] if the file cannot be read, is damaged, or is not such a table.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        std::fs::metadata(path).context(format_args!("failed to read {}", path.display()))?;
        if path.extension().is_none_or(|ending| ending != "parquet") {
            let rule =
                "the program of the Python package reads other files than .parquet: pip install graspmill[grasps]";
            return Err(Failure::new(ExitCode::Config, format!("{rule}: {}", path.display())));
        }
        let columns: BTreeMap<String, PlainColumn> = read_plain_table(path, GRASPS_MAX)?.into_iter().collect();
        let wrong = |text: String| Failure::new(ExitCode::Data, format!("{text}: {}", path.display()));
        let unit = |pose: Pose| Pose::from_parts(pose.translation, pose.rotation.normalize());
        let object_from_grasps = poses(&columns).map_err(wrong)?.into_iter().map(unit).collect();
        let held = match columns.get("held") {
            Some(PlainColumn::Whole(held)) => Some(held.iter().map(|held| *held == 1).collect()),
            _ => None,
        };
        Ok(Self { object_from_grasps, held })
    }

    /// How far the file's labels agree with those of a set of the same grasps: `given_held`, `same` of `grasps`, and
    /// Cohen's `kappa`, null where one side has one label alone; nothing if the file has no labels.
    #[must_use]
    pub fn agreement(&self, set: &ObjectGrasps) -> Option<Value> {
        let theirs = self.held.as_ref()?;
        let same = theirs.iter().zip(&set.grasps).filter(|(held, grasp)| **held == (grasp.outcome == Outcome::Held));
        let (same, all) = (same.count(), theirs.len() as f64);
        let given_held = theirs.iter().filter(|held| **held).count();
        let [a, b] = [given_held, set.count(Outcome::Held)].map(|held| held as f64 / all);
        let chance = a * b + (1.0 - a) * (1.0 - b);
        let kappa = (chance < 1.0).then(|| (same as f64 / all - chance) / (1.0 - chance));
        Some(json!({ "given_held": given_held, "same": same, "grasps": theirs.len(), "kappa": kappa }))
    }
}
