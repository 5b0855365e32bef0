//! Grasps that are there to be labelled again.

use std::collections::BTreeMap;
use std::path::Path;

use program::{Context as _, ExitCode, Failure};
use schema::Pose;
use shards::{PlainColumn, read_plain_table};

use super::stored::{GRASPS_MAX, poses};

/// Reads the poses of a table as `graspmill objects annotate` writes it: in the object's frame; the grasp's has
/// +z approach, +y closing, its origin midway between the tips. The package makes such a table of the files of others.
///
/// # Errors
/// [`Failure`] if the file cannot be read, is damaged, or is not such a table.
pub fn given_grasps(path: &Path) -> Result<Vec<Pose>, Failure> {
    std::fs::metadata(path).context(format_args!("failed to read {}", path.display()))?;
    if path.extension().is_none_or(|ending| ending != "parquet") {
        let rule = "the program of the Python package reads other files than .parquet: pip install graspmill[grasps]";
        return Err(Failure::new(ExitCode::Config, format!("{rule}: {}", path.display())));
    }
    let columns: BTreeMap<String, PlainColumn> = read_plain_table(path, GRASPS_MAX)?.into_iter().collect();
    let wrong = |text: String| Failure::new(ExitCode::Data, format!("{text}: {}", path.display()));
    let unit = |pose: Pose| Pose::from_parts(pose.translation, pose.rotation.normalize());
    Ok(poses(&columns).map_err(wrong)?.into_iter().map(unit).collect())
}
