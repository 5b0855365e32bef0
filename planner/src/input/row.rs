//! A scene of a dataset as input of a plan, in the same form as in training.

use schema::{Grid, SceneRows, VoxelGrid};
use shards::{Dataset, DatasetInfo, Location, ReadError};

use crate::input::error::InputError;

/// A scene's grid and rows.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadRow {
    /// The grid.
    pub voxels: VoxelGrid,
    /// The scene's rows: its objects and its attempts with their outcomes.
    pub rows: SceneRows,
    /// The dataset's info.
    pub info: DatasetInfo,
    /// The dataset's id.
    pub dataset_id: String,
}

/// Reads a scene of the dataset at `location`.
///
/// # Errors
/// [`InputError::Row`] if it cannot be read, [`InputError::Value`] if its grid is not the planner's.
pub fn read_row(location: &Location, scene_id: u64) -> Result<ReadRow, InputError> {
    let unread = |error: ReadError| InputError::Row(Box::new(error));
    let dataset = Dataset::open(location).map_err(unread)?;
    check_grid(&dataset.info().grid).map_err(|error| error.at(&location.to_string()))?;
    let rows = dataset.read_scene(scene_id).map_err(unread)?;
    let voxels = VoxelGrid::new(dataset.info().grid, rows.scene.tsdf.clone());
    let voxels = voxels.map_err(|error| InputError::Damaged(format!("{error}: scene {scene_id} of {location}")))?;
    Ok(ReadRow { voxels, rows, info: dataset.info().clone(), dataset_id: dataset.id().to_owned() })
}

fn check_grid(grid: &Grid) -> Result<(), InputError> {
    let wanted = Grid::PAPER;
    if grid.resolution == wanted.resolution && (grid.size_m - wanted.size_m).abs() < 1e-6 {
        return Ok(());
    }
    Err(InputError::Value(format!(
        "the dataset's grid must have {} voxels a side over {} m, got {} over {} m",
        wanted.resolution, wanted.size_m, grid.resolution, grid.size_m
    )))
}

#[cfg(test)]
mod tests {
    use program::{Exit, ExitCode};
    use shards::{Draft, synthetic};

    use super::*;

    fn dataset(resolution: usize) -> (tempfile::TempDir, Location) {
        let folder = tempfile::tempdir().unwrap();
        let mut info = synthetic::info(7, 1, 20, 10);
        info.grid = Grid { resolution, ..Grid::PAPER };
        let draft = Draft::begin(folder.path(), &info).unwrap();
        let mut writer = draft.shard(0).unwrap();
        for scene in info.scenes_of(0) {
            writer.push(&synthetic::scene_rows(scene, info.seed, &info)).unwrap();
        }
        writer.commit().unwrap();
        draft.finalize().unwrap();
        let location = Location::parse(folder.path()).unwrap();
        (folder, location)
    }

    #[test]
    fn a_scene_is_read_as_it_was_written() {
        let (_folder, location) = dataset(40);
        let row = read_row(&location, 1).unwrap();
        let written = synthetic::scene_rows(1, row.info.seed, &row.info);
        assert_eq!(row.voxels.values, written.scene.tsdf);
        assert_eq!(row.rows, written);
        let error = read_row(&location, 2).unwrap_err();
        assert_eq!(
            (error.exit_code(), error.to_string()),
            (ExitCode::Config, "scene must be below 2, got 2".to_owned())
        );
    }

    #[test]
    fn other_grids_and_places_without_a_dataset_are_refused() {
        let (folder, location) = dataset(8);
        let message = read_row(&location, 0).unwrap_err().to_string();
        assert!(message.contains("40 voxels a side over 0.3 m, got 8 over 0.3 m"), "{message}");
        let nowhere = Location::parse(folder.path().join("nowhere")).unwrap();
        assert_eq!(read_row(&nowhere, 0).unwrap_err().exit_code(), ExitCode::Config);
    }
}
